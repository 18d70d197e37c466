"""A pressure sensor that speaks NMEA 0183's transducer sentence: ``$YXXDR,P,1.4532,B,DEPTH*hh`` is 1.4532 bar, absolute."""

from __future__ import annotations

import math

from drivers.navigation.base import LineSensor
from drivers.navigation.readings import Depth
from drivers.navigation.sums import nmea_body

GRAVITY = 9.80665
ATMOSPHERE_PA = 101325.0
_UNITS = {b"B": 1e5, b"P": 1.0}


def parse_xdr(line: bytes) -> float | None:
    """Pressure (Pa) of the first transducer of kind P in an XDR sentence; None where there is none or the sum is wrong."""
    body = nmea_body(line)
    if body is None:
        return None
    fields = body.split(b",")
    if not fields[0].endswith(b"XDR"):
        return None
    for kind, value, unit in zip(fields[1::4], fields[2::4], fields[3::4], strict=False):
        if kind == b"P" and unit in _UNITS:
            try:
                pressure = float(value) * _UNITS[unit]
            except ValueError:
                return None
            return pressure if math.isfinite(pressure) else None
    return None


class NmeaPressure(LineSensor):
    """The sensor on ``port``; ``density`` of the water (kg/m3), ``surface_pa`` the air's pressure, ``sigma`` of a depth (m)."""

    name = "pressure sensor"

    def __init__(
        self, port: str, baud: int = 4800, density: float = 998.0, surface_pa: float = ATMOSPHERE_PA, sigma: float = 0.02
    ) -> None:
        super().__init__(port, baud)
        if not density > 0 or not sigma > 0:
            raise ValueError("density and sigma must be positive")
        self._density, self._surface_pa, self._sigma = density, surface_pa, sigma

    def parse_line(self, line: bytes, time_s: float) -> Depth | None:
        """Depth from what the sentence says."""
        pressure = parse_xdr(line)
        if pressure is None:
            return None
        return Depth(time_s, (pressure - self._surface_pa) / (self._density * GRAVITY), self._sigma)
