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
from estimators.radial_profile.model import Array, profile_rows

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
    step = np.linalg.cholesky(wall.covariance + 1e-18 * np.eye(len(wall.covariance)))
    # the answer hardly bends within the noise: one step along each axis of the covariance
    found, *others = _solved(wall, np.vstack([wall.coefficients, wall.coefficients + step.T]), seen)
    spread = float(np.sqrt(sum((other[2] - found[2]) ** 2 for other in others)))
    return Apex(float(found[0]), float(found[1]), (wall.rig.offset_px or 0.0) + float(found[2]), spread)


def own_offset_std(found: Apex, wall: Wall, around: float) -> float:
    """How well one pair alone knows its offset (px): by its noise, and by the taper that a sound pipe may have. ``around`` is
    the share of the way around the pipe that it sees: what it does not see, the vanishing point can make up for."""
    taper = TAPER * wall.rig.range_px_m * (1.0 + _BLIND * (1.0 - around))
    return float(np.hypot(found.offset_std_px, taper))


def _solved(wall: Wall, coefficients: Array, seen: Array) -> Array:
    """(N, 3): place of the apex and offset error (px) for each of ``coefficients`` (N, 2 + 4 K)."""
    still, sloping = profile_rows(seen, wall.harmonics)
    constant, slope = coefficients @ still.T, coefficients @ sloping.T
    around = np.broadcast_to(np.stack([np.cos(seen), np.sin(seen)], axis=-1), (*constant.shape, 2))
    rows = np.concatenate([around, -constant[..., None] / wall.rig.baseline_m], axis=-1)
    turned = rows.transpose(0, 2, 1)
    solution = np.linalg.solve(turned @ rows, turned @ (wall.rig.focal_px * slope[..., None]))[..., 0]
    axis, turn = wall.axis, solution[:, 2] / wall.rig.baseline_m
    middle = wall.rig.focal_px * axis.right + axis.x * turn, wall.rig.focal_px * axis.down + axis.y * turn
    return np.column_stack([solution[:, 0] + middle[0], solution[:, 1] + middle[1], solution[:, 2]])
