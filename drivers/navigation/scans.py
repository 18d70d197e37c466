"""One scan of a scanner or depth camera, from a folder of files or from a twin."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Scan:
    """``points`` (N, 3) in the sensor's frame (x right, y down, z forward), each as seen at ``time_s`` + ``late_s`` (N,)."""

    time_s: float
    points: NDArray[np.float64]
    late_s: NDArray[np.float64] | None = None


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
