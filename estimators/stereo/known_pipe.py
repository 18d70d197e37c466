"""Disparity offset and baseline scale of a rig from a pipe of known diameter.

Two things are asked for and a wall tells two: that it must not come out conical gives the offset, and its diameter then the
scale.
A sound pipe tapers a little and the baseline is usually known well, so both are weighed: the scale is held to one within
``SCALE_PRIOR``, the offset to the cone's apex within its own deviation, and the diameter holds exactly at the depth of the
wall.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimators.radial_profile.cone import own_offset_std
from estimators.stereo.follow import FollowedWall, around

SCALE_PRIOR = 0.01
"""How well a stated baseline is known (relative)."""
DIAMETER_STD = 0.003
"""How well the diameter of a test pipe is known, and how round it is (relative)."""


@dataclass(frozen=True)
class KnownPipe:
    """What a pipe of known diameter tells of the rig: ``offset_px`` with ``offset_std_px``; ``scale`` of the baseline with
    ``scale_std``; ``shift_px`` the disparity less offset at which it was seen; ``cone_px`` the offset by the cone alone."""

    offset_px: float
    offset_std_px: float
    scale: float
    scale_std: float
    shift_px: float
    cone_px: float


def rig_from_known_pipe(followed: FollowedWall, measured_diameter: float, diameter: float) -> KnownPipe:
    """From one followed wall whose mean diameter (m) came out as ``measured_diameter`` under the offset it was followed
    with."""
    wall = followed.wall
    offset = wall.rig.offset_px or 0.0
    shift = wall.rig.range_px_m / (0.5 * (wall.depths[0] + wall.depths[1]))
    cone_std = own_offset_std(followed.cone, wall, around(followed.match, followed.ends))

    def scale(tried: NDArray[np.float64]) -> NDArray[np.float64]:
        return diameter / (measured_diameter * shift / (shift + offset - tried))

    tried = np.arange(followed.cone.offset_px - 6 * cone_std, followed.cone.offset_px + 6 * cone_std, 0.01)
    tried = tried[tried < offset + 0.9 * shift]
    cost = ((tried - followed.cone.offset_px) / cone_std) ** 2 + ((scale(tried) - 1.0) / SCALE_PRIOR) ** 2
    best = float(tried[np.argmin(cost)])
    found = shift + offset - best
    std = float(1.0 / np.sqrt(1.0 / cone_std**2 + (1.0 / (found * SCALE_PRIOR)) ** 2))
    return KnownPipe(best, std, float(scale(np.array(best))), DIAMETER_STD, found, followed.cone.offset_px)


def combined(known: list[KnownPipe]) -> KnownPipe:
    """The mean of several pairs of one rig, weighed by how well each knows the offset."""
    weight = np.array([1.0 / one.offset_std_px**2 for one in known])
    weight /= weight.sum()

    def mean(values: list[float]) -> float:
        return float(weight @ np.array(values))

    return KnownPipe(
        mean([one.offset_px for one in known]),
        float(max(1.0 / np.sqrt(sum(1.0 / one.offset_std_px**2 for one in known)), np.std([one.offset_px for one in known]))),
        mean([one.scale for one in known]),
        max(DIAMETER_STD, float(np.std([one.scale for one in known]))),
        mean([one.shift_px for one in known]),
        mean([one.cone_px for one in known]),
    )
