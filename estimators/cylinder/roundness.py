"""How far the circle can be from the mean of a wall that is not quite round and of which only a part is seen.

Where the whole wall is seen, the circle is its mean. Where water hides the invert, an oval and a circle of another radius look
nearly alike, and the radius of the circle is off by more than the wall's deviation from it. The same linear step as the
cylinder's, with the second to fourth harmonic of the radius beside its five parameters and with a prior that pipes are nearly
round, says by how much, and how sure that is.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from estimators.cylinder.geometry import Array, Cylinder
from estimators.cylinder.refinement import FEWEST_POINTS, linearise

HARMONIC_STD = {2: 0.010, 3: 0.003, 4: 0.002}
"""Prior standard deviation of each harmonic over the radius: ovality is what pipes have, the rest is small."""
_REACH = 0.08
"""Share of the radius by which a wall may be off the circle and still be the wall."""
_LEAST_ERROR = 0.05
"""Error that neighbouring points share, at least, in standard deviations of one."""
_ROUNDS = 4


def mean_radius(points: Array, sigma: Array, cylinder: Cylinder) -> tuple[float, float]:
    """(shift, standard deviation) in metres: what to add to the circle's radius for the mean radius of the wall, and its error.

    ``points`` (N, 3) are those that face the axis, ``sigma`` (N,) their ``noise_std``. Patches of 15 degrees by half a radius
    are the witnesses, since neighbouring errors of a depth camera are alike; what they err by is read off themselves. Where
    there are too few of them the prior alone speaks: no shift.
    """
    offset = points - cylinder.point
    along = offset @ cylinder.axis
    distance = np.sqrt(np.maximum(np.einsum("ij,ij->i", offset, offset) - along * along, 0.0)) - cylinder.radius
    chosen = np.abs(distance) < np.maximum(3 * sigma, _REACH * cylinder.radius)
    unknown = 0.0, HARMONIC_STD[2] * cylinder.radius
    if np.count_nonzero(chosen) < FEWEST_POINTS:
        return unknown
    wall = points[chosen].astype(np.float64)
    residual, jacobian, basis, anchor = linearise(wall, cylinder.axis, cylinder.point, cylinder.radius)
    across = (wall - anchor) @ basis
    along = (wall - anchor) @ cylinder.axis
    angle = np.arctan2(across[:, 1], across[:, 0])
    waves = [-cylinder.radius * wave(k * angle) for k in HARMONIC_STD for wave in (np.cos, np.sin)]
    patch = np.floor(angle * (12 / np.pi)).astype(np.int64) + 1000 * np.floor(along * (2 / cylinder.radius)).astype(np.int64)
    table = np.column_stack([jacobian, *waves, residual, sigma[chosen]])
    means, count = _means(table, patch)
    means, count = means[count >= 3], count[count >= 3]
    design, error, spread = means[:, :-2], means[:, -2], means[:, -1] * np.sqrt(1 + 4 / count)
    if len(error) < design.shape[1]:
        return unknown
    precision = np.diag([1e-9] * 5 + [HARMONIC_STD[k] ** -2 for k in HARMONIC_STD for _ in range(2)])
    left, shared, weight = error, 1.0, np.ones(len(error))
    for _ in range(_ROUNDS):
        scaled = left / spread
        shared = max(1.4826 * float(np.median(np.abs(scaled))), _LEAST_ERROR)
        weight = 1 / (np.maximum(np.abs(scaled) / (2 * shared), 1) * (shared * spread) ** 2)  # Huber
        covariance = np.linalg.inv((design * weight[:, None]).T @ design + precision)
        found = -covariance @ (design.T @ (weight * error))
        left = error + design @ found
    return float(found[4]), float(np.sqrt(covariance[4, 4]))


def _means(table: NDArray[np.float64], group: NDArray[np.int64]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Column means of ``table`` per group, and how many rows each has."""
    _, index, count = np.unique(group, return_inverse=True, return_counts=True)
    sums = np.stack([np.bincount(index, column, len(count)) for column in table.T], axis=1)
    return sums / count[:, None], count
