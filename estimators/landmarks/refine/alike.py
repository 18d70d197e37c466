"""How far the errors of sightings one after the other are the same error seen again."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

STRETCH = 0.1
"""Way (m) over which the focus of expansion, the counter between two of its steps, or a burst is off in one direction."""
EXPERIENCE = 6.0
"""Stretches' worth of belief that they are not."""
MOST = 20.0


def together(positions: Array, residuals: Array) -> Array:
    """Squared deviation (n,) of sightings with ``residuals`` (n, 2) (standard deviations) at ``positions`` (n,): their own, or
    that of the mean of their stretch where that is worse.

    A burst of false detections that stands in the picture is off by one or two deviations each time, and always to the same
    side: no single one of them is a stray, all of them together are.
    """
    stretch = _stretches(positions)
    count = np.bincount(stretch)
    sums = np.stack([np.bincount(stretch, side) for side in residuals.T], axis=1)
    mean2 = (sums**2).sum(axis=1) / count
    return np.asarray(np.maximum((residuals**2).sum(axis=1), mean2[stretch]), dtype=np.float64)


def _stretches(positions: Array) -> NDArray[np.intp]:
    """Which stretch of the way (n,) each of ``positions`` (n,) lies in, those in a row: the crawler may come by again."""
    cell = np.floor(positions / STRETCH)
    return np.cumsum(np.diff(cell, prepend=cell[:1]) != 0)


def alike(positions: Array, residuals: Array) -> float:
    """How many sightings count as one, at least 1: by how much the sums of their ``residuals`` (n,) or (n, d) over stretches of
    the way at ``positions`` (n,) vary more than sums of independent ones would (the method of batch means)."""
    residuals = residuals.reshape(len(positions), -1)
    stretch = _stretches(positions)
    sums = np.stack([np.bincount(stretch, side) for side in residuals.T], axis=1)
    own = np.bincount(stretch, (residuals**2).sum(axis=1))
    full = np.bincount(stretch) > 1
    if not full.any():
        return 1.0
    excess = float((sums[full] ** 2).sum() / max(own[full].sum(), 1e-12))
    count = float(full.sum())
    return float(np.clip((EXPERIENCE + count * excess) / (EXPERIENCE + count), 1.0, MOST))
