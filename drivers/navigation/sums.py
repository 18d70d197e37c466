"""Checksums of the navigation protocols."""

from __future__ import annotations

from functools import reduce
from operator import xor


def nmea_body(line: bytes) -> bytes | None:
    """What stands between ``$`` and ``*``, None where the exclusive or of it is not the two hexadecimal digits behind."""
    body, star, told = line.strip().partition(b"*")
    if not body.startswith(b"$") or not star or len(told) != 2:
        return None
    try:
        wanted = int(told, 16)
    except ValueError:
        return None
    return body[1:] if reduce(xor, body[1:], 0) == wanted else None


def nmea_line(body: bytes) -> bytes:
    """A whole sentence."""
    return b"$%s*%02X\r\n" % (body, reduce(xor, body, 0))


def crc8(data: bytes) -> int:
    """CRC-8 with the polynomial 0x07, begun at 0, as Water Linked's DVL protocol has it."""
    value = 0
    for byte in data:
        value ^= byte
        for _ in range(8):
            value = ((value << 1) ^ 0x07 if value & 0x80 else value << 1) & 0xFF
    return value
