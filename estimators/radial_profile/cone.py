"""The disparity offset of a pair from a wall that must not come out conical.

On a wall of constant profile R(theta) the disparity rises along every ray from the vanishing point as offset + b rho / R:
the pipe is a cone in (x, y, disparity) whose apex lies at the vanishing point and at the offset. Whatever offset was
assumed, eq. 17 of the RADIUS paper fits it exactly, with slopes
f s(theta) = vanishing point . (cos, sin) - c(theta) (offset error) / b, all about the camera's axis. About another one the
offset error turns that axis, too, by (its place at depth 0) (offset error) / (f b).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimators.radial_profile.fit import Wall
from estimators.radial_profile.model import Array, profile_at

TAPER = 0.012
"""Relative change of a sound pipe's radius per metre (standard deviation), as two ends of the same pipes show it: a pair that
finds its own offset takes such a taper for an offset."""
_BLIND = 4.0
"""By how much more of it, for each part of the way around that is not seen."""


@dataclass(frozen=True)
class Apex:
    """Where the wall's depth lines meet: pixels from the principal point, and the disparity offset with its deviation."""

    u_px: float
    v_px: float
    offset_px: float
    offset_std_px: float


def apex(wall: Wall, seen: Array) -> Apex:
    """The apex of a wall fitted under any offset, from the angles ``seen`` (rad), at least eight of them."""
    turns = [_solve(wall, wall.coefficients, seen)]
    step = np.linalg.cholesky(wall.covariance + 1e-18 * np.eye(len(wall.covariance)))
    for column in step.T:  # the answer hardly bends within the noise: one step along each axis of the covariance
        turns.append(_solve(wall, wall.coefficients + column, seen))
    found = turns[0]
    spread = float(np.sqrt(sum((other[2] - found[2]) ** 2 for other in turns[1:])))
    return Apex(float(found[0]), float(found[1]), (wall.rig.offset_px or 0.0) + float(found[2]), spread)


def own_offset_std(found: Apex, wall: Wall, around: float) -> float:
    """How well one pair alone knows its offset (px): by its noise, and by the taper that a sound pipe may have. ``around`` is
    the share of the way around the pipe that it sees: what it does not see, the vanishing point can make up for."""
    taper = TAPER * wall.rig.range_px_m * (1.0 + _BLIND * (1.0 - around))
    return float(np.hypot(found.offset_std_px, taper))


def _solve(wall: Wall, coefficients: Array, seen: Array) -> Array:
    constant, slope = profile_at(coefficients, seen)
    rows = np.stack([np.cos(seen), np.sin(seen), -constant / wall.rig.baseline_m], axis=1)
    solution = np.linalg.lstsq(rows, wall.rig.focal_px * slope, rcond=None)[0]
    axis, turned = wall.axis, float(solution[2]) / wall.rig.baseline_m
    return np.array(
        [
            solution[0] + wall.rig.focal_px * axis.right + axis.x * turned,
            solution[1] + wall.rig.focal_px * axis.down + axis.y * turned,
            solution[2],
        ]
    )
