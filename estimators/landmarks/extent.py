"""How far a landmark reaches along and around the pipe."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from estimators.landmarks.ekf import wrap
from estimators.landmarks.projection import PipeCamera, View, back_project
from estimators.landmarks.tracks import Tracks

Array = NDArray[np.float64]
Index = NDArray[np.intp]

GAIN = 0.3
"""Share of the way by which one exact sighting beyond the end moves the end."""
EXACT = 0.15
"""A sighting whose chainage is known to this (m) counts as exact for the ends of an extent."""

DEEPEST = 20.0
"""In radii: farther ahead than this a point of an outline has no depth to speak of."""
TURN_GAIN = 0.15
"""Share of the way by which one outline moves the extent around the pipe."""


def depth_std(camera: PipeCamera, depth: Array, pixel_std: float) -> Array:
    """Standard deviation (m) of back-projected depths (n,): Z^2 sigma / (f R), for a camera on the axis."""
    return np.asarray(depth**2 * pixel_std / (np.sqrt(camera.fx * camera.fy) * camera.radius), dtype=np.float64)


@dataclass(frozen=True)
class Patches:
    """What outlines cover on the wall: ``low`` (n,) to ``high`` chainage (m), and how far they reach anticlockwise (``before``
    <= 0) and clockwise (``after`` >= 0) of the angle of their centroid (rad). nan for an outline that is nowhere."""

    low: Array
    high: Array
    before: Array
    after: Array


def wall_patches(
    camera: PipeCamera, view: View, outlines: Sequence[Sequence[tuple[float, float]]], centroids: Array
) -> Patches:
    """The patches of wall inside n outlines of points (u, v), each of at least one, round ``centroids`` (n, 2).

    Points about the focus of expansion, deeper than DEEPEST radii, lie nowhere in particular and are left out.
    """
    count = np.array([len(outline) for outline in outlines])
    start = np.cumsum(count) - count
    wall = back_project(camera, view, np.array([point for outline in outlines for point in outline], dtype=np.float64))
    about = np.repeat(back_project(camera, view, centroids)[:, 1], count)
    nowhere = ~(wall[:, 0] - view.position < DEEPEST * camera.radius)
    chainage = np.where(nowhere, np.nan, wall[:, 0])
    turn = np.where(nowhere, np.nan, wrap(wall[:, 1] - about))
    return Patches(
        np.fmin.reduceat(chainage, start),
        np.fmax.reduceat(chainage, start),
        np.minimum(np.fmin.reduceat(turn, start), 0.0),
        np.maximum(np.fmax.reduceat(turn, start), 0.0),
    )


def turn_towards(tracks: Tracks, rows: Index, patches: Patches) -> None:
    """Move the extents round the pipe of ``rows`` (n,) some way towards those of their outlines: all the way for the first."""
    for have, seen in ((tracks.before, patches.before), (tracks.after, patches.after)):
        known = np.isfinite(seen)
        at = rows[known]
        have[at] += np.where(have[at] == 0.0, 1.0, TURN_GAIN) * (seen[known] - have[at])


def grow(
    camera: PipeCamera, view: View, tracks: Tracks, rows: Index, chainage: Array, pixel_std: float, gain: float = GAIN
) -> None:
    """Stretch the extents of ``rows`` towards sightings at ``chainage`` (n,) (m) beyond their ends, slowly: one stray sighting
    moves little, and one from afar, whose chainage is a guess, nothing to speak of. nan moves nothing."""
    spread = depth_std(camera, chainage - view.position, pixel_std)
    share = gain / (1.0 + (spread / EXACT) ** 2)
    beyond = chainage - tracks.state[rows, 0]
    known = np.isfinite(beyond)
    rows, beyond, share = rows[known], beyond[known], share[known]
    tracks.above[rows] += share * np.maximum(beyond - tracks.above[rows], 0.0)
    tracks.below[rows] += share * np.minimum(beyond - tracks.below[rows], 0.0)


# ---- the extent of a long thing, from all its sightings

LAWS = ("point", "anywhere", "middle", "centroid", "outline")
"""Where on the part that shows a detector may put its one point: it always hits the same spot; it hits anywhere; it hits the
middle along the pipe; the centroid of the patch in the picture, which is near its near edge; the middle between the edges in
the picture. Which one holds is for the sightings to say."""
_QUANTILES = (np.arange(12) + 0.5) / 12
_STRAY = 0.05
_LACK = 0.3
"""Weight of a frame with or without a sighting as such: misses come in bursts, several frames are worth one."""
_GRID = 24
FAR_STD = 0.15
"""Standard deviation of the logarithm of how far the detector sees a long thing, beside how far it sees points."""


@dataclass(frozen=True)
class Extent:
    """``low`` to ``high`` (m) along the pipe, ``std`` (m) of their middle, and the law of LAWS that told it."""

    low: float
    high: float
    std: float
    law: str


@dataclass(frozen=True)
class _Sightings:
    """See ``fit_extent``; ``std`` is that of ``seen``, the inverse depth."""

    positions: Array
    seen: Array
    std: Array
    unseen: Array
    near: float
    far: float


def fit_extent(
    positions: Array, inverse_depth: Array, inverse_std: Array, unseen: Array, window: tuple[float, float]
) -> Extent:
    """The extent of one thing from its sightings on the way past it, by maximum likelihood.

    ``positions`` (n,) of the camera (m), ``inverse_depth`` (n,) of each sighting (1/m) with its standard deviation
    ``inverse_std`` (n,): pixel noise is even in 1/Z where it is anything but in Z. ``unseen`` (k,) are the positions of frames
    without a sighting: where it should have shown they speak against it. ``window`` (m) are the depths between which a point
    of that clock position shows; the farther one is known to FAR_STD only. A part of the sightings may be stray.
    """
    near, far = window
    sightings = _Sightings(positions, inverse_depth, inverse_std, unseen, near, far)
    with np.errstate(divide="ignore", invalid="ignore"):
        chainage = positions + 1.0 / np.maximum(inverse_depth, 1e-3)
        sure = inverse_std / np.maximum(inverse_depth, 1e-3) ** 2
    weight = 1.0 / (sure**2 + 0.05**2)
    order = np.argsort(chainage)
    share = np.cumsum(weight[order]) / weight.sum()
    low, high = (float(chainage[order][np.searchsorted(share, q)]) for q in (0.02, 0.98))
    best: Extent | None = None
    best_cost = np.inf
    step = max(1, len(positions) // 150)
    thin = _Sightings(positions[::step], inverse_depth[::step], inverse_std[::step], unseen[::step], near, far)
    for law in LAWS:

        def cost(ends: Array, law: str = law, data: _Sightings = sightings) -> float:
            return -_likelihood(law, float(ends[0]), float(ends[1]), float(ends[2]), data)

        if law == "point":
            spots = np.linspace(low - 0.1, high + 0.1, 2 * _GRID)
            first = min(spots, key=lambda spot: cost(np.array([spot, spot, 0.0]), data=thin))
            found, value = _minimum(lambda x: cost(x[[0, 0, 1]]), np.array([first, 0.0]))
            ends = found[[0, 0, 1]]
            # Two ends are one number more: the simpler explanation wins unless they earn it.
            value -= 0.5 * float(np.log(len(positions)))
        else:
            span = max(high - low, 0.2)
            lows = np.linspace(low - 0.5, low + 0.6 * span, _GRID)
            highs = np.linspace(high - 0.6 * span, high + 0.5, _GRID)
            pairs = [(a, b) for a in lows for b in highs if b - a > 0.05]
            start = min(pairs, key=lambda ends: cost(np.array([*ends, 0.0]), data=thin))
            ends, value = _minimum(cost, np.array([*start, 0.0]))
        if value < best_cost:
            shift = np.array([1.0, 1.0, 0.0]) * 0.01 * (1 + ends[1] - ends[0])
            curve = (cost(ends + shift) - 2 * cost(ends) + cost(ends - shift)) / shift[0] ** 2
            std = float(1 / np.sqrt(curve)) if curve > 1e-9 else float(shift[0])
            best, best_cost = Extent(float(ends[0]), float(ends[1]), std, law), value
    assert best is not None
    return best


def _minimum(cost: Callable[[Array], float], start: Array) -> tuple[Array, float]:
    """Where ``cost`` is least, from ``start`` on, and how much it is there."""
    options: Any = {"xatol": 1e-3, "fatol": 1e-2, "maxiter": 200}
    fit = minimize(cost, start, method="Nelder-Mead", options=options)
    return np.asarray(fit.x, dtype=np.float64), float(fit.fun)


def _likelihood(law: str, low: float, high: float, farther: float, data: _Sightings) -> float:
    """ln p of the sightings, and of the lack of them, of a thing from ``low`` to ``high`` (m) under ``law``; ``farther`` is the
    logarithm of how much farther than thought the detector sees."""
    if high < low:
        return -1e12
    near, far = data.near, data.far * float(np.exp(farther))
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
    return total + _LACK * (seen * float(np.log(rate)) + missed * float(np.log(1 - rate))) - 0.5 * (farther / FAR_STD) ** 2
