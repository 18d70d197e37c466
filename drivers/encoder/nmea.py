"""The NMEA sentence of Scantrol's line counters: ``$SCWLP,12.3,M,0.5,M*6E`` is 12.3 m paid out at 0.5 m a unit of time.

The checksum is that of NMEA 0183: the exclusive or of everything between ``$`` and ``*``, as two hexadecimal digits.
"""

from __future__ import annotations

import re
from functools import reduce
from operator import xor

from drivers.encoder.numerals import number_and_step
from drivers.encoder.serial_line import LineEncoder, LineValue

# the talker ahead of WLP differs between makers; the sum makes sure that this is a sentence
_SENTENCE = re.compile(rb"\$([^$*]*)\*([0-9A-Fa-f]{2})\s*")
_METRES = {b"M": 1.0, b"F": 0.3048}


def parse_wlp(line: bytes) -> LineValue | None:
    """What a WLP sentence says, None where it is none or its sum is wrong."""
    match = _SENTENCE.fullmatch(line)
    if match is None or int(match.group(2), 16) != reduce(xor, match.group(1), 0):
        return None
    fields = match.group(1).split(b",")
    if not fields[0].endswith(b"WLP") or len(fields) < 3 or fields[2] not in _METRES:
        return None
    length = number_and_step(fields[1].decode("latin-1"))
    if length is None:
        return None
    unit = _METRES[fields[2]]
    speed = number_and_step(fields[3].decode("latin-1")) if len(fields) > 4 and fields[4] in _METRES else None
    return LineValue(
        value=length[0] * unit,
        unit="m",
        quantum=length[1] * unit,
        speed=None if speed is None else speed[0] * _METRES[fields[4]],
    )


class NmeaEncoder(LineEncoder):
    """A line counter that speaks NMEA 0183, whose own rate is 4800 baud."""

    def __init__(self, port: str, baud: int = 4800) -> None:
        super().__init__(port, baud, "NMEA line counter")

    def parse(self, line: bytes) -> LineValue | None:
        """See ``parse_wlp``."""
        return parse_wlp(line)
