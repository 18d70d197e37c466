"""The reference fit: RANSAC over eq. 17 with the numbers of the RADIUS paper, section 5.2, and of its published code."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimators.radial_profile.model import Array, design

HARMONICS = 6
INLIER_M = 0.005
_SAMPLE, _ITERATIONS, _ROUNDS, _INLIER_SHARE = 50, 10, 3, 0.90


@dataclass(frozen=True)
class ReferenceFit:
    """Coefficients (26,) of eq. 17 and the points (N,) that follow them."""

    coefficients: Array
    inliers: NDArray[np.bool_]


def reference_fit(r: Array, theta: Array, z: Array, rng: np.random.Generator) -> ReferenceFit | None:
    """Fit radii ``r`` (N,) over angle and depth; None where no sample found nine tenths of the points on its surface.

    Ten samples of 50 points; a sample that nine tenths follow within 5 mm is fitted again on those, and the fit with the
    smallest mean error wins. Without one it is tried again, three rounds in all.
    """
    if len(r) < _SAMPLE:
        return None
    best: tuple[float, Array] | None = None
    rows = design(theta, z, HARMONICS)
    for _ in range(_ROUNDS):
        for _ in range(_ITERATIONS):
            sample = rng.integers(len(r), size=_SAMPLE)
            first = np.linalg.lstsq(rows[sample], r[sample], rcond=None)[0]
            inliers = np.abs(rows @ first - r) < INLIER_M
            if np.count_nonzero(inliers) <= _INLIER_SHARE * len(r):
                continue
            second = np.asarray(np.linalg.lstsq(rows[inliers], r[inliers], rcond=None)[0], dtype=np.float64)
            error = float(np.mean(np.abs(rows[inliers] @ second - r[inliers])))
            if best is None or error < best[0]:
                best = error, second
        if best is not None:
            return ReferenceFit(best[1], np.abs(rows @ best[1] - r) < INLIER_M)
    return None
