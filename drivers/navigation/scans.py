"""One scan of a scanner or depth camera, from a folder of files or from a twin, and the scanner as the house sees it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Scan:
    """``points`` (N, 3) in the sensor's frame (x right, y down, z forward), each as seen at ``time_s`` + ``late_s`` (N,)."""

    time_s: float
    points: NDArray[np.float64]
    late_s: NDArray[np.float64] | None = None

    @property
    def monotonic_ns(self) -> int:
        """When a live scan was taken on the host's clock."""
        return round(self.time_s * 1e9)


class Scanner(ABC):
    """A scanner that sends whole clouds, its ``time_s`` the host's monotonic clock."""

    name: str = "scanner"
    notice: str = ""

    @abstractmethod
    def open(self) -> None:
        """Start. Raises SensorMissing where there is none."""

    @abstractmethod
    def read(self, timeout_s: float = 5.0) -> Scan:
        """The next scan. Raises FrameTimeout, BadFrame, SensorLost."""

    def reset(self) -> None:
        """Reset the hardware, where it can; the default only closes."""
        self.close()

    @abstractmethod
    def close(self) -> None:
        """Stop and release. Never raises, may be called twice."""


@dataclass(frozen=True)
class Mount:
    """Pose of the scanner on the vehicle: ``rotation`` (3, 3) sensor to body, ``offset`` (3,) in the body's frame."""

    rotation: NDArray[np.float64]
    offset: NDArray[np.float64]


def mount_at(tilt: float, offset: NDArray[np.float64]) -> Mount:
    """Looking forward and ``tilt`` (rad) down. Sensor axes: x right, y down, z forward; body: forward, right, down."""
    forward = np.array([np.cos(tilt), 0.0, np.sin(tilt)])
    right = np.array([0.0, 1.0, 0.0])
    return Mount(np.column_stack([right, np.cross(forward, right), forward]), offset)
