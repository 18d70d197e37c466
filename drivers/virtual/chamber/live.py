"""The virtual chamber in real time: a scanner and navigation sensors on one vehicle that begins its way when it is told to."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from drivers.navigation.scans import Mount, Scan, Scanner
from drivers.virtual.chamber.path import VehiclePath
from drivers.virtual.chamber.scanner import VirtualScanner
from drivers.virtual.chamber.structure import Structure
from drivers.virtual.chamber.wires import NavigationWires
from drivers.virtual.crawler import DriveClock, Plug
from drivers.virtual.faults import FaultScript


class LiveChamber:
    """Twins of one structure. Until ``begin`` the vehicle stands at the start of its way, at the end of it again."""

    def __init__(self, structure: Structure, seed: int) -> None:
        self.structure = structure
        self.path = VehiclePath(structure.description.path, np.random.default_rng([seed, 1]))
        self.clock = DriveClock(self.path.duration_s)
        self.eye = VirtualScanner(structure, self.path)
        self.wires = NavigationWires(self.path, structure.description.navigation, self.clock, np.random.default_rng([seed, 2]))
        self.scanner_faults = FaultScript()
        self._noise = np.random.default_rng([seed, 3])

    @property
    def mount(self) -> Mount:
        """Of the scanner on the vehicle."""
        return self.eye.mount

    def begin(self) -> None:
        """From the start of the way, now."""
        self.clock.begin()

    def scanner(self) -> LiveScanner:
        """The scanner, not open."""
        return LiveScanner(self, self._noise)

    def close(self) -> None:
        """End the wires."""
        self.wires.close()


class LiveScanner(Scanner):
    """A scan each period of the structure's scanner, of the moment at which its sweep was in its middle."""

    name = "virtual scanner"

    def __init__(self, chamber: LiveChamber, rng: np.random.Generator) -> None:
        self._chamber = chamber
        self._rng = rng
        self._period_s = 1.0 / chamber.structure.description.scanner.rate_hz
        self._plug = Plug(self.name, chamber.scanner_faults)
        self._due = 0.0

    def open(self) -> None:
        """Start. Raises SensorMissing where it is unplugged."""
        self._plug.open()
        self._due = time.monotonic()

    def read(self, timeout_s: float = 5.0) -> Scan:
        """The next scan. Raises FrameTimeout, SensorLost."""
        self._plug.wait(self._due, timeout_s, "no scan")
        now_s, now = time.monotonic(), self._chamber.clock.now_s()
        self._due = max(self._due + self._period_s, now_s)
        return replace(self._chamber.eye.scan(now, self._rng), time_s=now_s)

    def close(self) -> None:
        """Never raises, may be called twice."""
        self._plug.close()
