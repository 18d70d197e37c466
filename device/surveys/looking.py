"""What each picture says of the camera: where it goes, where the pipe's axis lies, which joints it sees, what hinders it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from device.surveys.landmark_smoothing import SeenJoint
from estimators.flow import Tracker
from estimators.foe import Follower, estimate
from estimators.odometry import Position

Gray = NDArray[np.uint8]

SLOW = 0.02
"""Below this speed (m/s) motion is too small to tell where the camera goes."""


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
        self._tracker = Tracker()
        self._follower: Follower | None = None
        self._pictures = 0

    def look(self, gray: Gray, time_s: float, position: Position | None) -> Look:
        """One picture."""
        if self._follower is None:
            height, width = gray.shape
            self._follower = Follower(self._centre or ((width - 1) / 2, (height - 1) / 2))
        self._pictures += 1
        found = self._tracker.step(gray)
        moving = position is None or abs(position.speed) > SLOW
        centre, covariance = self._follower.centre, self._follower.covariance
        if found is not None:
            foe = estimate(found, self._rng, around=np.asarray(centre)) if moving else None
            centre, covariance = self._follower.update(foe, moving, self._pictures)
            self._pictures = 0
        return Look(centre, math.sqrt(float(np.trace(covariance)) / 2))

    def joints(self) -> list[dict[str, Any]]:
        """The pipe joints found so far: {"chainage_m", "sightings"}."""
        return []

    def sightings(self) -> list[SeenJoint]:
        """Which joint was seen when, and how large."""
        return []
