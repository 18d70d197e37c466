"""Where the wall begins and ends, from the data: the depth band, and how its two ends run around the pipe.

The face of the pipe's rim, the cloth or manhole at its far end and a bend are off the wall by geometry: their rays meet the
predicted wall beyond the last depth at which the measured points lie on it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_SECTORS = 36
_SHARE = 0.5
_MEASURED = 0.25
_FEWEST_SECTORS = 4


@dataclass(frozen=True)
class Ends:
    """Cells of an unrolled wall that belong to it: ``inside`` (Z, A), and the band's first and last row (last excluded)."""

    inside: NDArray[np.bool_]
    first: int
    last: int


def longest_run(good: NDArray[np.bool_], gap: int = 0) -> tuple[int, int]:
    """(start, end) of the longest run of True, which may hold gaps up to ``gap`` long; (0, 0) where there is none."""
    places = np.flatnonzero(good)
    if not len(places):
        return 0, 0
    broken = np.flatnonzero(np.diff(places) > gap + 1)
    starts, stops = places[np.r_[0, broken + 1]], places[np.r_[broken, len(places) - 1]] + 1
    longest = int(np.argmax(stops - starts))
    return int(starts[longest]), int(stops[longest])


def wall_ends(on: NDArray[Any], off: NDArray[Any], seen: NDArray[np.bool_], margin: int) -> Ends | None:
    """The part of an unrolled wall (Z, A) that is wall; None where no depth has any.

    ``on``: points on the wall; ``off``: points elsewhere, or missing; ``seen``: cells in the picture. A depth belongs to the
    wall where at least half of what was measured is on it, and enough of what is seen was measured. Each end is then looked
    for sector by sector around the pipe and drawn as a smooth curve, since a camera that looks askew sees it slanted;
    ``margin`` rows are left out before it.
    """
    rows, angles = on.shape
    weight_on, weight_off = on.sum(axis=1).astype(float), off.sum(axis=1).astype(float)
    measured = weight_on + weight_off
    share = np.where(
        measured > np.maximum(_MEASURED * seen.sum(axis=1), 0.02 * angles), weight_on / np.maximum(measured, 1), 0.0
    )
    first, last = longest_run(share >= _SHARE, gap=rows // 12)
    if last - first < max(8, 3 * margin):
        return None
    edges = np.linspace(0, angles, _SECTORS + 1).astype(int)[:-1]
    sector_on = _smoothed(np.add.reduceat(on, edges, axis=1).astype(float), margin)
    sector_off = _smoothed(np.add.reduceat(off, edges, axis=1).astype(float), margin)
    known = sector_on + sector_off > 0.1 * angles / _SECTORS
    good = known & (sector_on >= _SHARE * (sector_on + sector_off))
    middle = (first + last) / 2
    near, far = np.full(_SECTORS, np.nan), np.full(_SECTORS, np.nan)
    for sector in range(_SECTORS):
        begins, ends = longest_run(good[:, sector], gap=rows // 6)
        if ends - begins < max(4, margin):
            continue
        if begins < middle and known[max(begins - margin, 0), sector]:  # else only the picture's edge ends it
            near[sector] = begins
        if ends > middle:
            far[sector] = ends
    centres: Array = (np.arange(_SECTORS, dtype=np.float64) + 0.5) * (2 * np.pi / _SECTORS) - np.pi
    theta: Array = (np.arange(angles, dtype=np.float64) + 0.5) * (2 * np.pi / angles) - np.pi
    start = np.maximum(_smooth_curve(centres, near, theta, float(first)), 0.0) + margin
    stop = np.minimum(_smooth_curve(centres, far, theta, float(last)), rows) - margin
    row = np.arange(rows)[:, None]
    inside = (row >= start) & (row < stop)
    if not inside.any():
        return None
    held = np.flatnonzero(inside.any(axis=1))
    return Ends(inside, int(held[0]), int(held[-1]) + 1)


def _smoothed(values: Array, margin: int) -> Array:
    kernel = np.ones(max(margin, 1)) / max(margin, 1)
    return np.stack([np.convolve(column, kernel, mode="same") for column in values.T], axis=1)


def _smooth_curve(centres: Array, found: Array, theta: Array, otherwise: float) -> Array:
    """A curve of two harmonics through what the sectors found, robustly; constant where few of them found anything."""
    known = np.isfinite(found)
    if np.count_nonzero(known) < _FEWEST_SECTORS:
        return np.full(len(theta), otherwise)
    count = 2 if np.count_nonzero(known) >= _SECTORS // 2 else 0

    def rows(angle: Array) -> Array:
        waves = [np.ones_like(angle)]
        for k in range(1, count + 1):
            waves += [np.cos(k * angle), np.sin(k * angle)]
        return np.stack(waves, axis=1)

    matrix, wanted = rows(centres[known]), found[known]
    coefficients = np.zeros(matrix.shape[1])
    coefficients[0] = np.median(wanted)
    for _ in range(8):
        residual = wanted - matrix @ coefficients
        scale = max(1.4826 * float(np.median(np.abs(residual))), 1.0)
        weight = 1.0 / (1.0 + (residual / (2 * scale)) ** 2)
        normal = (matrix * weight[:, None]).T @ matrix + 1e-3 * np.eye(matrix.shape[1])
        coefficients[:] = np.linalg.solve(
            normal, matrix.T @ (weight * wanted) + 1e-3 * np.r_[np.median(wanted), np.zeros(2 * count)]
        )
    return rows(theta) @ coefficients
