"""What each picture says of the camera: where it goes, where the pipe's axis lies, which joints it sees, what hinders it.

Flow tells the focus of expansion while the crawler drives and pictures come fast; two rings in a picture tell it too, and the
camera's offset from the pipe's axis beside. Where neither has told it yet (a picture a second), it is where the pipe is dark.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from device.landmarks.smoothing import SeenJoint
from estimators.flow import Flow, Tracker
from estimators.foe import Foe, FoeConfig, Follower, estimate, video_aspect
from estimators.odometry import Position
from estimators.rings import (
    AxisView,
    FocalRadius,
    JointConfig,
    JointMap,
    Ring,
    RingMap,
    axis_view,
    dark_centre,
    find,
    joint_centres,
)
from estimators.view_checks import Watch

Gray = NDArray[np.uint8]

SLOW = 0.02
"""Below this speed (m/s) motion is too small to tell where the camera goes."""
SURE_PX = 8.0
"""Standard deviation of a centre from flow that is worth more than a second ring."""
RINGS_EVERY_M = 0.05
"""Rings are looked for after so much way: from the same place the same rings are seen."""
DARK_PX = 30.0
"""How far (px) the dark of the pipe may lie from its axis."""
LEANS_TO_TRUST = 10
LEAN_MEMORY = 40
"""Pictures with two rings over which the camera's offset is averaged: it changes slowly."""
SPARSE_STD = 0.1
SOLVE_GROWTH = 1.15
"""The joints are solved anew when there are so many times more rings."""


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
    """Takes the grey pictures (H, W) of one drive in their order.

    ``centre`` is the principal point, None for the middle; ``known`` is sqrt(fx fy) R and ``aspect`` fx / fy, where they are
    known. ``sparse``: the pictures are too far apart in time for flow, and a position is as wrong as the counter and the
    picture are apart.
    """

    def __init__(
        self,
        centre: tuple[float, float] | None,
        known: FocalRadius | None,
        seed: int,
        sparse: bool = False,
        aspect: float | None = None,
    ) -> None:
        self._sparse = sparse
        self._pixels = aspect
        self._foe = FoeConfig()
        self._centre = centre
        self._rng = np.random.default_rng(seed)
        self._tracker = Tracker()
        self._follower: Follower | None = None
        self._watch = Watch()
        self._pictures = 0
        self._leans: deque[NDArray[np.float64]] = deque(maxlen=LEAN_MEMORY)
        self._map = RingMap(known, JointConfig(position_std=SPARSE_STD) if sparse else None)
        self._looked_at: float | None = None
        self._ellipses: tuple[tuple[tuple[float, float], tuple[float, float], float], ...] = ()
        self._solved = self._finished = 0
        self._joints = JointMap((), known)

    def look(self, gray: Gray, number: int, time_s: float, position: Position | None) -> Look:
        """One picture, the drive's ``number``-th."""
        if self._follower is None:
            height, width = gray.shape
            self._follower = Follower(self._centre or ((width - 1) / 2, (height - 1) / 2))
            self._foe = FoeConfig(aspect=self._pixels or video_aspect(width, height))
        found, foe = (None, None) if self._sparse else self._flow(gray, position)
        if position is not None and self._far_enough(position.chainage):
            self._rings(gray, number, position.chainage)
        lean = self._lean()
        axis = float(lean[0]), float(lean[1])
        chainage = None if position is None or self._sparse else position.chainage
        quantum = 0.0 if position is None else 2.0 * position.std
        failed = self._watch.add(gray, time_s, found, foe, self._follower.centre, chainage, quantum, axis)
        return Look(self._follower.centre, self._std(), axis, self._ellipses, tuple(check.code for check in failed))

    def forget(self) -> None:
        """The next picture does not follow the last one: there was a pause."""
        self._tracker, self._watch = Tracker(), Watch()
        self._pictures = 0

    def solve(self, last: bool = False) -> JointMap:
        """The joints and F = sqrt(fx fy) R so far; ``last``: from all rings, however few are new."""
        rings = len(self._map)
        if rings != self._finished if last else rings >= SOLVE_GROWTH * self._solved + 10:
            self._solved = rings
            self._finished = rings if last else 0
            self._joints = self._map.solve(last)
        return self._joints

    def joints(self, last: bool = False) -> list[dict[str, Any]]:
        """The pipe joints found so far: {"chainage_m", "sightings", "sigma_chainage_m"}."""
        return [
            {
                "chainage_m": round(joint.chainage, 3),
                "sightings": len(joint.sightings),
                "sigma_chainage_m": round(joint.std, 4),
            }
            for joint in self.solve(last).joints
        ]

    def sightings(self) -> list[SeenJoint]:
        """Which joint was seen when, and how large."""
        return [
            SeenJoint(k, seen.frame, seen.ring.across)
            for k, joint in enumerate(self.solve(last=True).joints)
            for seen in joint.sightings
        ]

    def centres(self) -> dict[int, AxisView]:
        """Focus of expansion and lean by picture, from the rings of the whole drive: what stills have in place of flow. Where
        the pipe bends, rings of a single picture lead into the next pipe."""
        return joint_centres(self.solve(last=True).joints)

    @property
    def aspect(self) -> float:
        """fx / fy as the rings show it, 1 where they do not."""
        return self._map.aspect

    def _flow(self, gray: Gray, position: Position | None) -> tuple[Flow | None, Foe | None]:
        assert self._follower is not None  # look() made it
        self._pictures += 1
        found = self._tracker.step(gray)
        if found is None:
            return None, None
        moving = position is None or abs(position.speed) > SLOW
        foe = estimate(found, self._rng, self._foe, np.asarray(self._follower.centre))
        self._follower.update(foe, moving, self._pictures)
        self._pictures = 0
        return found, foe

    def _far_enough(self, chainage: float) -> bool:
        if self._looked_at is not None and abs(chainage - self._looked_at) < RINGS_EVERY_M:
            return False
        self._looked_at = chainage
        return True

    def _rings(self, gray: Gray, number: int, chainage: float) -> None:
        assert self._follower is not None  # look() made it
        rings = find(gray, dark_centre(gray) if self._sparse else self._follower.centre, aspect=self.aspect)
        self._ellipses = tuple(_ellipse(ring) for ring in rings)
        self._map.add(number, chainage, rings)
        foe = None if self._sparse or self._std() > SURE_PX else (self._follower.centre, self._std())
        view = axis_view(rings, foe=foe)
        if view is not None:
            self._leans.append(view.lean)
        if self._sparse:  # flow knows better, where there is any
            seen = (
                (np.asarray(dark_centre(gray), dtype=np.float64), DARK_PX**2 * np.eye(2))
                if view is None
                else (view.centre, view.covariance)
            )
            self._follower.update(Foe(*seen, 1.0, len(rings)), True, 1)

    def _lean(self) -> NDArray[np.float64]:
        """The pipe's axis from the camera (2,) in radii: the median of what single pictures say, among which there are rings
        that are none; little is believed of a few."""
        if not self._leans:
            return np.zeros(2)
        return np.asarray(np.median(self._leans, axis=0) * len(self._leans) / (len(self._leans) + LEANS_TO_TRUST))

    def _std(self) -> float:
        assert self._follower is not None  # look() made it
        return math.sqrt(float(np.trace(self._follower.covariance)) / 2)


def _ellipse(ring: Ring) -> tuple[tuple[float, float], tuple[float, float], float]:
    return ring.centre, (2 * ring.across, 2 * ring.upright), 0.0
