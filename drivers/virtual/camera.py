"""The CCTV camera of the virtual crawler: a pin-hole, its pixels not quite square, as those of PAL video are not."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.virtual.rig import Pose

Array = NDArray[np.float64]
NEAREST = 0.02
"""A point nearer than this before the camera (m) has no picture."""


@dataclass(frozen=True)
class CctvCamera:
    """Focal lengths and principal point (px), and the picture's size: PAL, some 80 degrees wide."""

    fx: float = 431.25
    fy: float = 460.0
    cx: float = 359.5
    cy: float = 287.5
    width: int = 720
    height: int = 576

    def __post_init__(self) -> None:
        if self.width % 4 or self.height % 4:
            raise ValueError(f"the picture's size must go by fours, not {self.width} x {self.height}")

    @property
    def diagonal(self) -> float:
        """Of the picture (px)."""
        return float(np.hypot(self.width, self.height))

    def project(self, pose: Pose, points: Array) -> Array:
        """Pixels (n, 2) of ``points`` (n, 3) of the pipe frame; nan for those that are not before the camera."""
        seen = (points - pose.position) @ pose.rotation
        with np.errstate(invalid="ignore", divide="ignore"):
            depth = np.where(seen[:, 2] > NEAREST, seen[:, 2], np.nan)
            return np.stack([self.cx + self.fx * seen[:, 0] / depth, self.cy + self.fy * seen[:, 1] / depth], axis=1)

    def vanishing_point(self, pose: Pose) -> tuple[float, float]:
        """(u, v) of the pipe's axis at infinity."""
        x, y, z = (float(value) for value in pose.rotation[2])
        return self.cx + self.fx * x / z, self.cy + self.fy * y / z

    def holds(self, pixels: Array) -> NDArray[np.bool_]:
        """Which of ``pixels`` (n, 2) lie in the picture."""
        u, v = pixels[:, 0], pixels[:, 1]
        return np.asarray((u >= 0) & (u <= self.width - 1) & (v >= 0) & (v <= self.height - 1))


def on_wall(radius: float, chainage: Array, angle: Array) -> Array:
    """Points (..., 3) on the wall of a round pipe (CCTV paper, eq. 4)."""
    chainage, angle = np.broadcast_arrays(chainage, angle)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), chainage], axis=-1)
