"""Water Linked's DVL A50 and A125 over serial, protocol 2.x: ``wrz`` lines, from 115200 baud.

    wrz,vx,vy,vz,valid,altitude,fom,covariance,time_of_validity,time_of_transmission,time,status*crc8

Velocities (m/s) are along the DVL's axes forward, right, down; ``valid`` is y or n; ``covariance`` nine numbers with ``;``.
"""

from __future__ import annotations

import math

from drivers.navigation.base import LineSensor
from drivers.navigation.readings import Velocity
from drivers.navigation.sums import crc8

LEAST_SIGMA = 0.002
"""No covariance is believed below this (m/s): the DVL's own resolution."""


def parse_wrz(line: bytes, time_s: float) -> Velocity | None:
    """What a ``wrz`` line says, None where it is none or its sum is wrong."""
    body, star, told = line.strip().rpartition(b"*")
    fields = body.split(b",")
    try:
        if not star or int(told, 16) != crc8(body) or fields[0] != b"wrz" or len(fields) < 9 or fields[4] not in (b"y", b"n"):
            return None
        x, y, z = (float(field) for field in fields[1:4])
        covariance = [float(part) for part in fields[7].split(b";")]
    except ValueError:
        return None
    if len(covariance) != 9 or not all(map(math.isfinite, (x, y, z, *covariance))):
        return None
    spread = (covariance[0] + covariance[4] + covariance[8]) / 3
    return Velocity(time_s, (x, y, z), max(LEAST_SIGMA, math.sqrt(max(spread, 0.0))), fields[4] == b"y")


def wrz_line(velocity: tuple[float, float, float], valid: bool, sigma: float, micros: int) -> bytes:
    """A whole line, as the twin sends it."""
    spread = sigma**2
    covariance = ";".join(f"{spread if i % 4 == 0 else 0.0:.3e}" for i in range(9))
    x, y, z = velocity
    sure = "y" if valid else "n"
    body = f"wrz,{x:.3f},{y:.3f},{z:.3f},{sure},1.30,{sigma:.3f},{covariance},{micros},{micros + 20000},180.0,0".encode()
    return b"%s*%02x\r\n" % (body, crc8(body))


class WaterLinkedDvl(LineSensor):
    """The DVL on ``port``."""

    name = "DVL"

    def __init__(self, port: str, baud: int = 115200) -> None:
        super().__init__(port, baud)

    def parse_line(self, line: bytes, time_s: float) -> Velocity | None:
        """See ``parse_wrz``."""
        return parse_wrz(line, time_s)
