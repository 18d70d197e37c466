"""What each picture says of the camera: where it goes, where the pipe's axis lies, which joints it sees, what hinders it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from device.surveys.landmark_smoothing import SeenJoint
from estimators.odometry import Position

Gray = NDArray[np.uint8]


@dataclass(frozen=True)
class Look:
    """``centre`` focus of expansion (px) with its std; ``axis`` of the pipe as seen from the camera in radii, right and down;
    ``codes`` of the self-checks."""

    centre: tuple[float, float]
    centre_std: float
    axis: tuple[float, float] = (0.0, 0.0)
    ellipses: tuple[tuple[tuple[float, float], tuple[float, float], float], ...] = ()
    codes: tuple[str, ...] = ()


class Looking:
    """Takes the grey pictures (H, W) of one drive in their order. ``centre`` is the principal point, None for the middle."""

    def __init__(self, centre: tuple[float, float] | None, seed: int) -> None:
        self._centre = centre
        self._rng = np.random.default_rng(seed)

    def look(self, gray: Gray, time_s: float, position: Position | None) -> Look:
        """One picture."""
        height, width = gray.shape
        centre = self._centre or ((width - 1) / 2, (height - 1) / 2)
        return Look(centre, 0.01 * width)

    def joints(self) -> list[dict[str, Any]]:
        """The pipe joints found so far: {"chainage_m", "sightings"}."""
        return []

    def sightings(self) -> list[SeenJoint]:
        """Which joint was seen when, and how large."""
        return []
