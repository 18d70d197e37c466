"""The navigation sensors as the rest of the house sees them: one abstract class, one reading at a time."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod

from drivers.base import BadFrame, FrameTimeout
from drivers.encoder.serial_line import SerialLine, shown
from drivers.navigation.readings import NavReading


class NavigationSensor(ABC):
    """One DVL, pressure sensor or AHRS on a serial line.

    A driver implements ``_parse``, which is given whatever bytes have come and keeps what is not yet whole.
    """

    name: str = "navigation sensor"
    notice: str = ""

    def __init__(self, port: str, baud: int) -> None:
        self._line = SerialLine(self.name, port, baud)
        self._waiting: list[NavReading] = []
        self.rejected = 0
        """Messages that were none since ``open``: torn, of a wrong checksum, of another kind."""

    def open(self) -> None:
        """Start. Raises SensorMissing where there is no such port."""
        self.rejected = 0
        self._waiting = []
        self._reset()
        self._line.open()

    def read(self, timeout_s: float = 1.0) -> NavReading:
        """The next reading, its time the host's monotonic clock. Raises FrameTimeout, BadFrame, SensorLost."""
        deadline = time.monotonic() + timeout_s
        refused = b""
        while not self._waiting:
            data = self._line.some(max(0.0, deadline - time.monotonic()))
            before = self.rejected
            self._waiting = self._parse(data, self._line.newest_ns / 1e9)
            if self.rejected > before:
                refused = data
            if not self._waiting and time.monotonic() >= deadline:
                if refused:
                    raise BadFrame(f"The {self.name} sends what is no reading, {shown(refused)}: check its baud rate.")
                raise FrameTimeout(f"The {self.name} sent no reading for {timeout_s:.3g} s.")
        return self._waiting.pop(0)

    def reset(self) -> None:
        """None of them can be reset from here: closed, to be opened again."""
        self.close()

    def close(self) -> None:
        """Stop and release. Never raises, may be called twice."""
        self._line.close()

    @abstractmethod
    def _reset(self) -> None:
        """Forget what is not yet whole."""

    @abstractmethod
    def _parse(self, data: bytes, time_s: float) -> list[NavReading]:
        """The readings that ``data`` completes; counts in ``rejected`` what is none."""


class LineSensor(NavigationSensor):
    """A sensor that speaks in lines: a driver implements ``parse_line``."""

    _LIMIT = 1024

    def _reset(self) -> None:
        self._rest = b""

    def _parse(self, data: bytes, time_s: float) -> list[NavReading]:
        *lines, self._rest = (self._rest + data).replace(b"\r", b"\n").split(b"\n")
        if len(self._rest) > self._LIMIT:
            self._rest = b""
            self.rejected += 1
        found = []
        for line in lines:
            if not line:
                continue
            reading = self.parse_line(line, time_s)
            if reading is None:
                self.rejected += 1
            else:
                found.append(reading)
        return found

    @abstractmethod
    def parse_line(self, line: bytes, time_s: float) -> NavReading | None:
        """What a line without its end says, None where it is no reading."""
