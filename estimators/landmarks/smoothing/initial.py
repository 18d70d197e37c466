"""Where the iterations start: landmarks by back-projection (CCTV paper, eqs. 19 to 21), f*R from how radii grow."""

from __future__ import annotations

import numpy as np

from estimators.landmarks.smoothing.types import Array, Indices, Known, Run

AHEAD = 0.1
"""A landmark was ahead (m) whenever it was seen."""
FOCAL_RADIUS = 100.0
"""f * R (px m) of no camera in particular, where nothing tells it."""


def first_guess(run: Run, x: Array, landmark: Indices, joint: Indices, known: Known | None) -> tuple[float, Array, Array]:
    """f*R, states (N, 2) of the landmarks, chainages (J,) of the joints, for cameras at ``x`` (n,)."""
    seen, rings = run.sightings, run.rings
    across = (seen.pixels - run.frames.centre[seen.frame]) / np.array([1.0, run.aspect])
    radius = np.hypot(across[:, 0], across[:, 1])
    if known is not None:
        focal = known.value
    else:
        tracks = [(x[seen.frame[landmark == k]], radius[landmark == k], seen.std[landmark == k]) for k in _count(landmark)]
        tracks += [(x[rings.frame[joint == k]], rings.radius_px[joint == k], rings.std[joint == k]) for k in _count(joint)]
        focal = _focal_radius(tracks)
    states = np.zeros((len(_count(landmark)), 2))
    for k in _count(landmark):
        mine = np.flatnonzero(landmark == k)
        # the nearest quarter of its sightings: there a pixel is the fewest centimetres
        near = mine[np.argsort(radius[mine])[-max(1, len(mine) // 4) :]]
        chainage = float(np.median(x[seen.frame[near]] + focal / np.maximum(radius[near], 1.0)))
        angle = np.angle(np.sum(across[near] @ np.array([1, 1j])))
        states[k] = max(chainage, float(np.median(x[seen.frame[near]])) + AHEAD), angle
    chainages = np.zeros(len(_count(joint)))
    for k in _count(joint):
        mine = np.flatnonzero(joint == k)
        near = mine[np.argsort(rings.radius_px[mine])[-max(1, len(mine) // 4) :]]
        chainages[k] = np.median(x[rings.frame[near]] + focal / np.maximum(rings.radius_px[near], 1.0))
    return focal, states, chainages


def _count(index: Indices) -> range:
    return range(int(index.max()) + 1 if len(index) else 0)


def _focal_radius(tracks: list[tuple[Array, Array, Array]]) -> float:
    """1 / rho = (l - x) / (f*R) is linear in the camera's way: the median slope over pairs of sightings of one thing."""
    slopes, weights = [], []
    for x, radius, std in tracks:
        clear = radius > 4 * std
        x, inverse, std = x[clear], 1 / radius[clear], std[clear] / radius[clear] ** 2
        if len(x) < 2:
            continue
        thin = np.linspace(0, len(x) - 1, min(len(x), 60)).astype(np.int64)
        x, inverse, std = x[thin], inverse[thin], std[thin]
        i, j = np.triu_indices(len(x), 1)
        way = x[j] - x[i]
        apart = np.abs(way) > 0.05
        i, j, way = i[apart], j[apart], way[apart]
        slopes.append(-(inverse[j] - inverse[i]) / way)
        weights.append(way**2 / (std[i] ** 2 + std[j] ** 2))
    if not slopes:
        return FOCAL_RADIUS
    slope, weight = np.concatenate(slopes), np.concatenate(weights)
    order = np.argsort(slope)
    if len(order) == 0:
        return FOCAL_RADIUS
    total = np.cumsum(weight[order])
    middle = slope[order][np.searchsorted(total, total[-1] / 2)]
    return float(1 / middle) if middle > 1e-6 else FOCAL_RADIUS
