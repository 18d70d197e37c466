"""AHRS: VectorNav's ``$VNYMR`` sentence (text), and Xsens' MTData2 messages (binary).

    $VNYMR,yaw,pitch,roll,mx,my,mz,ax,ay,az,gx,gy,gz*hh      degrees, body forward right down, rates in rad/s

MTData2 is ``FA FF 36 length data sum``: all bytes after FA sum to 0 modulo 256. In ``data``, each item is a two-byte number, a
length and big-endian floats: 0x2030 Euler angles (degrees), 0x8020 rate of turn (rad/s); the last four bits of the number tell
format (0: float32) and frame (4: NED, 0: ENU).
"""

from __future__ import annotations

import math
import struct

from drivers.navigation.base import LineSensor, NavigationSensor
from drivers.navigation.readings import Attitude, NavReading, Triple
from drivers.navigation.sums import nmea_body

SIGMA = math.radians(0.3)
_HEAD = b"\xfa\xff"
_MTDATA2 = 0x36
_EULER, _TURN = 0x2030, 0x8020


def euler_rates(angles: Triple, body: Triple) -> Triple:
    """Rates of roll, pitch and yaw from turning rates about the body's axes (rad/s)."""
    roll, pitch, _ = angles
    p, q, r = body
    across = q * math.sin(roll) + r * math.cos(roll)
    steep = max(abs(math.cos(pitch)), 1e-6)
    return p + across * math.tan(pitch), q * math.cos(roll) - r * math.sin(roll), across / steep


def parse_vnymr(line: bytes, time_s: float, sigma: float = SIGMA) -> Attitude | None:
    """What a VNYMR sentence says, None where it is none or its sum is wrong."""
    body = nmea_body(line)
    fields = [] if body is None else body.split(b",")
    if len(fields) != 13 or fields[0] != b"VNYMR":
        return None
    try:
        numbers = [float(field) for field in fields[1:]]
    except ValueError:
        return None
    if not all(map(math.isfinite, numbers)):
        return None
    yaw, pitch, roll = (math.radians(value) for value in numbers[:3])
    angles = (roll, pitch, yaw)
    return Attitude(time_s, angles, euler_rates(angles, (numbers[9], numbers[10], numbers[11])), sigma)


def parse_mtdata2(data: bytes, time_s: float, sigma: float = SIGMA) -> Attitude | None:
    """What the items of one MTData2 message say; None where no Euler angles are among them."""
    angles: Triple | None = None
    turn: Triple | None = None
    level = False
    position = 0
    while position + 3 <= len(data):
        number, length = struct.unpack_from(">HB", data, position)
        item = data[position + 3 : position + 3 + length]
        position += 3 + length
        if len(item) != length:
            return None
        form, frame = number & 0x03, number & 0x0C
        if number & 0xFFF0 not in (_EULER, _TURN) or form != 0 or length != 12:
            continue
        x, y, z = struct.unpack(">fff", item)
        if not all(map(math.isfinite, (x, y, z))):
            return None
        if number & 0xFFF0 == _EULER:
            roll, pitch, yaw = (math.radians(value) for value in (x, y, z))
            if frame == 0:  # ENU, the body forward left up
                pitch, yaw = -pitch, math.pi / 2 - yaw
            angles = (roll, pitch, math.atan2(math.sin(yaw), math.cos(yaw)))
            level = frame == 0
        else:
            turn = (x, y, z)
    if angles is None:
        return None
    if turn is not None and level:
        turn = (turn[0], -turn[1], -turn[2])
    return Attitude(time_s, angles, None if turn is None else euler_rates(angles, turn), sigma)


def mtdata2_message(angles: Triple, turn: Triple) -> bytes:
    """A whole message in the NED frame, as the twin sends it: roll, pitch, yaw (rad) and turning rates about the body's
    axes."""
    data = struct.pack(">HBfff", _EULER | 4, 12, *(math.degrees(a) for a in angles))
    data += struct.pack(">HBfff", _TURN | 4, 12, *turn)
    rest = bytes([0xFF, _MTDATA2, len(data)]) + data
    return b"\xfa" + rest + bytes([-sum(rest) & 0xFF])


class VectorNavAhrs(LineSensor):
    """An AHRS that sends VNYMR."""

    name = "AHRS"

    def __init__(self, port: str, baud: int = 115200) -> None:
        super().__init__(port, baud)

    def parse_line(self, line: bytes, time_s: float) -> Attitude | None:
        """See ``parse_vnymr``."""
        return parse_vnymr(line, time_s)


class XsensAhrs(NavigationSensor):
    """An AHRS that sends MTData2."""

    name = "AHRS"

    def __init__(self, port: str, baud: int = 115200) -> None:
        super().__init__(port, baud)

    def _reset(self) -> None:
        self._buffer = bytearray()

    def _parse(self, data: bytes, time_s: float) -> list[NavReading]:
        self._buffer += data
        found: list[NavReading] = []
        while True:
            begin = self._buffer.find(_HEAD)
            if begin < 0:
                keep = 1 if self._buffer[-1:] == _HEAD[:1] else 0
                self.rejected += len(self._buffer) > keep
                del self._buffer[: len(self._buffer) - keep]
                return found
            if begin > 0:
                self.rejected += 1
                del self._buffer[:begin]
            if len(self._buffer) < 4:
                return found
            length = 5 + self._buffer[3]
            if len(self._buffer) < length:
                return found
            message = bytes(self._buffer[:length])
            if sum(message[1:]) & 0xFF:
                self.rejected += 1
                del self._buffer[:2]  # not the whole length: a real message may begin inside
                continue
            del self._buffer[:length]
            reading = parse_mtdata2(message[4:-1], time_s) if message[2] == _MTDATA2 else None
            if reading is None:
                self.rejected += message[2] == _MTDATA2
            else:
                found.append(reading)
