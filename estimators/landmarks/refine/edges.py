"""The two ends of a long thing from the outlines of its sightings.

An outline shows the thing from its near end to its far end, or less: what is too near has left the picture, and what is too
far off the detector does not see. So the near edge of an outline is the thing's own near end or the near limit, and its far
edge the far end or the far limit. In inverse depth, where pixel noise is even, all is fitted at once by robust least squares:
both ends, both limits, by how much this detector's outlines stand out beyond the thing, and how far its wall is from the axis.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from estimators.landmarks.refine.alike import alike

Array = NDArray[np.float64]

LOOSE = 1.0
"""No end is less sure than this (m): where no sighting shows one it is about where the last ones are."""
LIMIT_STD = 0.3
"""Standard deviation of the logarithm of either limit, of what is believed of it before."""
NEAR_BLUR, FAR_BLUR = 0.1, 0.15
"""How sharp the limits are, as a share of the depth: they are not the same at each clock position and in each picture."""
OWN = 0.5
"""How much each edge is off by itself, as a share of how much both are together."""
TAIL = 4.0
"""Squared deviations from which on an edge pulls less and less (Cauchy's loss): it is something else's."""
SHORTEST = 0.02
"""What is shorter (m) has no ends."""
LEAST = 5
"""An end that fewer outlines show may be anywhere beyond."""
_GRID = 16
STEP = 1e-4
"""Of the numerical derivatives (m, and as a share)."""


@dataclass(frozen=True)
class Edges:
    """What n outlines show of one thing: ``positions`` (n,) of the camera (m), inverse depth (1/m) of the ``near`` and of the
    ``far`` edge (n,), and the standard deviation ``std`` (n,) of both together."""

    positions: Array
    near: Array
    far: Array
    std: Array


@dataclass(frozen=True)
class Ends:
    """``low`` and ``high`` (m) with ``covariance`` (2, 2)."""

    low: float
    high: float
    covariance: Array


def fit_edges(edges: Edges, window: tuple[float, float], stand_out: float, share: float) -> Ends:
    """The ends of one thing, seen between two depths of about ``window`` (m).

    ``stand_out`` (1/m) is the standard deviation of by how much outlines stand out, ``share`` of the logarithm of how much
    further from the axis than the pipe's radius the thing lies.
    """
    scale = np.array([LOOSE, LOOSE, LIMIT_STD, LIMIT_STD, stand_out, stand_out, share])
    begin = _begin(edges, window)
    count = 2 * len(edges.positions)

    def residuals(state: Array) -> Array:
        return np.concatenate([_residuals(edges, state), (state - begin) / scale])

    def loss(square: Array) -> Array:
        """Cauchy's for the edges, none for what is believed before: rho and its two derivatives (3, n)."""
        over = 1 + square[:count]
        known = square[count:]
        cauchy = np.stack([np.log(over), 1 / over, -1 / over**2])
        return np.concatenate([cauchy, np.stack([known, np.ones_like(known), np.zeros_like(known)])], axis=1)

    robust: Any = loss
    fit = least_squares(residuals, begin, loss=robust, f_scale=np.sqrt(TAIL), x_scale=np.minimum(scale, 0.1), max_nfev=60)
    off = _residuals(edges, fit.x)
    weight = 1 / (1 + off**2 / TAIL)
    jac = _slopes(edges, fit.x)
    ratio = max(float((weight * off**2).sum() / max(weight.sum() - 7, 1.0)), 1.0)
    common = alike(edges.positions, (weight * off).reshape(2, -1).T)
    prior = np.diag(scale**-2)
    information = jac.T @ (jac * weight[:, None]) / (ratio * common) + prior
    covariance = np.linalg.inv(information)[:2, :2]
    for end, shown in enumerate(_shown(edges, fit.x)):
        if shown < LEAST:
            covariance[end, end] += LOOSE**2
    return Ends(float(fit.x[0]), float(fit.x[1]), (covariance + covariance.T) / 2)


def _shown(edges: Edges, state: Array) -> tuple[int, int]:
    """How many outlines show the one end and the other, rather than a limit."""
    low, high = state[0] - edges.positions, state[1] - edges.positions
    return int((low >= np.exp(state[2])).sum()), int((high <= np.exp(state[3])).sum())


def _slopes(edges: Edges, state: Array) -> Array:
    """d residuals / d state (2 n, 7)."""
    steps = STEP * np.eye(len(state))
    return np.stack([(_residuals(edges, state + d) - _residuals(edges, state - d)) / (2 * STEP) for d in steps], axis=1)


def _begin(edges: Edges, window: tuple[float, float]) -> Array:
    """Where the fit starts: the best pair of ends on a grid, the limits as they are believed to be."""
    near, far = window
    seen = np.clip(edges.near, 1 / far, 1 / near)
    whole = edges.positions + 1 / seen
    order = np.argsort(whole)
    part = np.cumsum(seen[order] ** 4) / (seen**4).sum()
    first, last = (float(whole[order][np.searchsorted(part, q)]) for q in (0.02, 0.98))
    limits = [np.log(near), np.log(far), 0.0, 0.0, 0.0]
    starts = [
        np.array([low, high, *limits])
        for low in np.linspace(first - 0.2, last, _GRID)
        for high in np.linspace(first, last + 0.5, _GRID)
        if high - low > SHORTEST
    ]
    return min(starts, key=lambda state: float(np.log1p(_residuals(edges, state) ** 2 / TAIL).sum()))


def _residuals(edges: Edges, state: Array) -> Array:
    """Expected minus seen (2 n,) in standard deviations: near edges, then far ones beside what the near ones tell of them."""
    low, high = state[0] - edges.positions, state[1] - edges.positions
    near, far = np.exp(state[2]), np.exp(state[3])
    cut_near, cut_far = low < near, high > far
    low, high = np.where(cut_near, near, low), np.where(cut_far, far, np.maximum(high, near))
    wall = np.exp(state[6])
    off_near, off_far = wall / low + state[4] - edges.near, wall / high - state[5] - edges.far
    # an outline is off as a whole, and each of its edges a little beside
    shift2 = edges.std**2
    near2 = (1 + OWN**2) * shift2 + np.where(cut_near, NEAR_BLUR / near, 0.0) ** 2
    far2 = (1 + OWN**2) * shift2 + np.where(cut_far, FAR_BLUR / far, 0.0) ** 2
    beside = (off_far - shift2 / near2 * off_near) / np.sqrt(far2 - shift2**2 / near2)
    return np.concatenate([off_near / np.sqrt(near2), beside])
