"""The tether encoder as the rest of the house sees it: one abstract class, one reading."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Literal

Unit = Literal["counts", "m"]


@dataclass(frozen=True)
class Reading:
    """One reading: ``value`` in ``unit``, unwrapped, so that it never jumps when a counter overflows.

    ``monotonic_ns`` is when it was taken on the host's clock; ``media_s`` its time in a recording, None for a live encoder.
    ``quantum`` is the step that the source resolves, in ``unit``. ``tension`` and ``speed`` are what some counters tell
    beside, None elsewhere.
    """

    value: float
    monotonic_ns: int
    unit: Unit = "counts"
    quantum: float = 1.0
    media_s: float | None = None
    speed: float | None = None
    tension: float | None = None

    @property
    def time_s(self) -> float:
        """Seconds on the clock that this reading's run is measured with."""
        return self.monotonic_ns / 1e9 if self.media_s is None else self.media_s


class Encoder(ABC):
    """One tether encoder.

    A driver implements ``_open``, ``_read`` and ``close``; it never overrides ``open`` or ``read``. Calibration (counts per
    metre, direction, zero) is not the driver's: see ``drivers.encoder.calibration``.
    """

    name: str = "tether encoder"
    notice: str = ""
    rejected: int = 0
    """Lines that were no reading since ``open``: garbage, torn, wrong checksum."""

    def open(self) -> None:
        """Start. Raises SensorMissing where there is no such port, SensorLost where nothing sensible comes."""
        self.rejected = 0
        self._open()

    def read(self, timeout_s: float = 1.0) -> Reading:
        """Wait for the next reading. Raises FrameTimeout, SensorLost, BadFrame, or EndOfRecording."""
        return self._read(timeout_s)

    @abstractmethod
    def _open(self) -> None: ...

    @abstractmethod
    def _read(self, timeout_s: float) -> Reading: ...

    def reset(self) -> None:
        """Reset the hardware, where it can. The encoder is closed afterwards; the default does no more than that."""
        self.close()

    @abstractmethod
    def close(self) -> None:
        """Stop and release. Never raises, may be called twice."""
