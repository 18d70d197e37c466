"""The two ends of a long thing from its sightings' one point each, where a detector draws no outlines.

What the point is of is not known, and is for the sightings to say (LAWS); nor is how near and how far the detector sees. Both
go into the covariance: the ends are those of all laws together, each weighed by how well it explains what was seen.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

Array = NDArray[np.float64]

LAWS = ("point", "anywhere", "middle", "centroid", "outline")
"""Where on the part that shows a detector may put its one point: it always hits the same spot; it hits anywhere; it hits the
middle along the pipe; the centroid of the patch in the picture, which is near its near edge; the middle between the edges in
the picture."""
FAR_STD = 0.15
"""Standard deviation of the logarithm of how far the detector sees a long thing, beside how far it sees points."""
KNOWN = 0.2
"""A near limit surer than this is looked for near where it is thought to be."""
LOOSEST = 0.5
"""No end is less sure than this (m) under a law: where the likelihood is flat its curvature tells nothing."""
_QUANTILES = (np.arange(12) + 0.5) / 12
_STRAY = 0.05
_LACK = 0.3
"""Weight of a frame with or without a sighting as such: misses come in bursts, several frames are worth one."""
_GRID = 24
_STEPS = np.array([0.02, 0.02, 0.03, 0.03])
"""Of the numerical curvature: (m, m, -, -)."""


@dataclass(frozen=True)
class Centroids:
    """``positions`` (n,) of the camera (m), inverse depth ``seen`` (n,) of each sighting (1/m) with its standard deviation
    ``std`` (n,): pixel noise is even in 1/Z where it is anything but in Z. ``unseen`` (k,) are the positions of frames without
    a sighting: where it should have shown they speak against it."""

    positions: Array
    seen: Array
    std: Array
    unseen: Array


@dataclass(frozen=True)
class Window:
    """The thing shows from ``near`` to ``far`` (m) ahead: farther or nearer by FAR_STD, and not from ``near`` on but from
    further off by ``near_std``, as logarithms: nothing is seen beyond the picture's border, but a detector may see less."""

    near: float
    far: float
    near_std: float


@dataclass(frozen=True)
class Extent:
    """``low`` to ``high`` (m) along the pipe with ``covariance`` (2, 2), and the likeliest law of LAWS."""

    low: float
    high: float
    covariance: Array
    law: str


def fit_centroids(data: Centroids, window: Window, common: float = 1.0) -> Extent:
    """The extent of one thing from its sightings on the way past it, by maximum likelihood. A part of them may be stray.
    So many sightings as ``common`` says have one error in common."""
    step = max(1, len(data.positions) // 150)
    thin = Centroids(data.positions[::step], data.seen[::step], data.std[::step], data.unseen[::step])
    low, high = _range(data)
    sooner = (0.0,) if window.near_std < KNOWN else (0.0, window.near_std)
    found: list[tuple[float, Array, Array, str]] = []
    for law in LAWS:

        def cost(state: Array, law: str = law, data: Centroids = data) -> float:
            return -_likelihood(law, state, data, window)

        if law == "point":
            spots = np.linspace(low - 0.1, high + 0.1, 2 * _GRID)
            first = min(spots, key=lambda spot: cost(np.array([spot, spot, 0.0, 0.0]), data=thin))
            at, value = _minimum(lambda x: cost(x[[0, 0, 1, 2]]), np.array([first, 0.0, 0.0]))
            state = at[[0, 0, 1, 2]]
            # Two ends are one number more: the simpler explanation wins unless they earn it.
            value -= 0.5 * float(np.log(len(data.positions)))
        else:
            span = max(high - low, 0.2)
            lows = np.linspace(low - 0.5, low + 0.6 * span, _GRID)
            highs = np.linspace(high - 0.6 * span, high + 0.5, _GRID)
            starts = [np.array([a, b, 0.0, c]) for a in lows for b in highs for c in sooner if b - a > 0.05]
            state, value = _minimum(cost, min(starts, key=lambda start: cost(start, data=thin)))
        covariance = np.zeros((2, 2)) if law == "point" else common * _covariance(cost, state)
        found.append((value, state[:2], covariance, law))
    return _together(found, common)


def _range(data: Centroids) -> tuple[float, float]:
    """Where (m) nearly all of the sightings lie on the wall, those from afar counting little."""
    with np.errstate(divide="ignore", invalid="ignore"):
        chainage = data.positions + 1.0 / np.maximum(data.seen, 1e-3)
        sure = data.std / np.maximum(data.seen, 1e-3) ** 2
    weight = 1.0 / (sure**2 + 0.05**2)
    order = np.argsort(chainage)
    share = np.cumsum(weight[order]) / weight.sum()
    low, high = (float(chainage[order][np.searchsorted(share, q)]) for q in (0.02, 0.98))
    return low, high


def _together(found: list[tuple[float, Array, Array, str]], common: float) -> Extent:
    """One extent of those that the laws gave: [cost, ends, covariance, law]. A point is one only where that is likeliest."""
    best = min(found, key=lambda one: one[0])
    if best[3] == "point":
        return Extent(float(best[1][0]), float(best[1][1]), best[2], "point")
    long = [one for one in found if one[3] != "point"]
    weight = np.exp(-np.array([one[0] - best[0] for one in long]) / common)
    weight /= weight.sum()
    ends = sum((w * one[1] for w, one in zip(weight, long, strict=True)), np.zeros(2))
    covariance = np.zeros((2, 2))
    for w, one in zip(weight, long, strict=True):
        off = one[1] - ends
        covariance += w * (one[2] + np.outer(off, off))
    return Extent(float(ends[0]), float(ends[1]), covariance, best[3])


def _covariance(cost: Callable[[Array], float], state: Array) -> Array:
    """(2, 2) of the ends at the minimum ``state`` (4,) of ``cost``, from its curvature."""
    count, here = len(state), cost(state)
    away = [_STEPS[k] * np.eye(count)[k] for k in range(count)]
    curve = np.empty((count, count))
    for i in range(count):
        for j in range(i + 1):
            if i == j:
                change = cost(state + away[i]) - 2 * here + cost(state - away[i])
            else:
                both = cost(state + away[i] + away[j]) + cost(state - away[i] - away[j])
                change = (both - cost(state + away[i] - away[j]) - cost(state - away[i] + away[j])) / 4
            curve[i, j] = curve[j, i] = change / (_STEPS[i] * _STEPS[j])
    values, vectors = np.linalg.eigh(curve)
    covariance = (vectors / np.maximum(values, LOOSEST**-2)) @ vectors.T
    return np.asarray(covariance[:2, :2], dtype=np.float64)


def _minimum(cost: Callable[[Array], float], start: Array) -> tuple[Array, float]:
    """Where ``cost`` is least, from ``start`` on, and how much it is there."""
    simplex = np.vstack([start, start + 0.1 * np.eye(len(start))])
    options: Any = {"xatol": 1e-3, "fatol": 1e-2, "maxiter": 300, "initial_simplex": simplex}
    fit = minimize(cost, start, method="Nelder-Mead", options=options)
    return np.asarray(fit.x, dtype=np.float64), float(fit.fun)


def _likelihood(law: str, state: Array, data: Centroids, window: Window) -> float:
    """ln p of the sightings, and of the lack of them, of a thing of ``state`` under ``law``: its two ends (m), and the
    logarithms of how much farther than thought the detector sees, and of how much farther off it ceases to see."""
    low, high, farther, sooner = (float(value) for value in state)
    if high < low:
        return -1e12
    near, far = window.near * float(np.exp(max(sooner, 0.0))), window.far * float(np.exp(farther))
    if far <= near:
        return -1e12
    if law == "point":
        low = high = (low + high) / 2
    shows = (high - data.positions >= near) & (low - data.positions <= far)
    first = np.where(shows, np.maximum(low - data.positions, near), near)
    last = np.where(shows, np.maximum(np.minimum(high - data.positions, far), first + 1e-6), near + 1e-6)
    std = data.std
    if law in ("point", "middle"):
        spots = (2.0 / (first + last))[:, None]
    elif law == "outline":
        spots = ((1 / first + 1 / last) / 2)[:, None]
    elif law == "centroid":
        # Of a strip of even width on the wall: its picture narrows with 1/Z, and its length with 1/Z^2.
        spots = (2.0 / 3.0 * (first**-2 + 1 / (first * last) + last**-2) / (1 / first + 1 / last))[:, None]
    else:
        spots = 1.0 / (first[:, None] + (last - first)[:, None] * _QUANTILES)
        # The gaps between quantiles are blurred over, lest the grid of them shows.
        std = np.hypot(std, 0.5 * (1 / first - 1 / last) / len(_QUANTILES))
    density = np.exp(-0.5 * ((data.seen[:, None] - spots) / std[:, None]) ** 2).mean(axis=1) / (std * np.sqrt(2 * np.pi))
    total = float(np.log(np.where(shows, (1 - _STRAY) * density, 0.0) + _STRAY * near).sum())
    missed = int(((high - data.unseen >= near) & (low - data.unseen <= far)).sum())
    seen = int(shows.sum())
    rate = min(max((seen + 1) / (seen + missed + 2), 0.3), 0.95)
    lack = _LACK * (seen * float(np.log(rate)) + missed * float(np.log(1 - rate)))
    return total + lack - 0.5 * (farther / FAR_STD) ** 2 - 0.5 * (sooner / window.near_std) ** 2
