"""Connected parts of the wall that lie inwards or outwards of it, with area, peak, place and, where it is plain, kind."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimators.anomaly.deviation import DeviationMap, Floats, smoothed
from estimators.anomaly.evidence import speaks
from estimators.anomaly.joints import Joint
from estimators.anomaly.parts import parts_around
from estimators.anomaly.rows import row_medians

_LEAST_M, _LEAST_SHARE = 0.004, 0.012
"""Smallest deviation that begins a region: 4 mm, or this share of the radius."""
_NOISE_FACTOR = 4.5
_SIGMA_FACTOR = 4.0
_GROWN = 0.5
"""A region grows down to this share of what begins one."""
_LEAST_AREA_M2 = 4e-4
"""Less than one small window of the match covers in a common pipe: what is smaller is one window's error."""
_LEAST_CELLS = 6
_INVERT = np.radians(50.0)
"""Half of the pipe's floor: deposits lie within it."""
_SHADOW = 0.35
"""A region that hides this share of its own area or more behind it stands free of the wall."""
_TALL_M = 0.015

KINDS = ("deposit", "intrusion", "object", "loss", "joint")


@dataclass(frozen=True)
class Region:
    """One anomaly, in metres and radians. ``peak`` is signed: inwards negative; ``volume`` (m3) too, the deviation over its
    area.

    ``depth`` and ``theta`` are its centre, ``depths`` and ``width`` (rad) its extent. ``kind`` is one of KINDS: a deposit lies
    on the invert, an intrusion comes in elsewhere, an object hides wall behind it without a gap in the disparities (a root, a
    stone), loss falls outwards, a joint runs around the pipe and is ``expected``. ``confidence`` is the share of its cells
    that lie off the wall by more than three of their own sigmas.
    """

    area: float
    peak: float
    volume: float
    depth: float
    theta: float
    depths: tuple[float, float]
    width: float
    kind: str
    expected: bool
    confidence: float
    cells: NDArray[np.intp]
    """Flat indices into the map."""


def find_regions(found: DeviationMap, joints: list[Joint]) -> list[Region]:
    """Regions from the largest volume to the smallest."""
    smooth, sigma = smoothed(found)
    threshold = _threshold(found, smooth, sigma)
    regions = []
    for sign in (-1.0, 1.0):
        height = np.nan_to_num(sign * smooth)
        labels, count = parts_around(height > _GROWN * threshold)
        if count == 0:
            continue
        seeded = np.zeros(count + 1, dtype=bool)
        seeded[np.unique(labels[height > threshold])] = True
        seeded[0] = False
        order = np.argsort(labels.ravel(), kind="stable")
        starts = np.searchsorted(labels.ravel()[order], np.arange(count + 2))
        for label in np.flatnonzero(seeded):
            cells = order[starts[label] : starts[label + 1]]
            area = float(found.area.ravel()[cells].sum())
            if area < _LEAST_AREA_M2 or len(cells) < _LEAST_CELLS or not speaks(found, cells):
                continue
            regions.append(_region(found, smooth, sigma, cells, area, sign, joints))
    return sorted(regions, key=lambda region: -abs(region.volume))


def anomalous_share(found: DeviationMap, regions: list[Region]) -> float:
    """Share of the measured wall that lies in regions which are not expected (radius paper, section 4.5)."""
    area = found.area.ravel()
    total = float(area[found.measured.ravel()].sum())
    return float(sum(area[region.cells].sum() for region in regions if not region.expected)) / max(total, 1e-12)


def _threshold(found: DeviationMap, smooth: Floats, sigma: Floats) -> Floats:
    """What begins a region, for each cell: well above the roughness of the wall at that depth, and above its own noise."""
    known = np.isfinite(smooth).sum(axis=1)
    rows = np.where(known >= 20, 1.4826 * row_medians(np.abs(smooth)), np.nan)
    if np.isnan(rows).all():
        return np.full(smooth.shape, np.inf, dtype=np.float32)
    rows = np.where(np.isnan(rows), np.nanmedian(rows), rows)
    kernel = np.ones(15) / 15
    rough = np.convolve(np.pad(rows, 7, mode="edge"), kernel, mode="valid")
    least = np.maximum(np.maximum(_LEAST_M, _LEAST_SHARE * found.radius), _NOISE_FACTOR * rough[:, None])
    return np.asarray(np.fmax(least, _SIGMA_FACTOR * sigma), dtype=np.float32)


def _region(
    found: DeviationMap, smooth: Floats, sigma: Floats, cells: NDArray[np.intp], area: float, sign: float, joints: list[Joint]
) -> Region:
    rows, columns = np.divmod(cells, len(found.theta))
    height = np.abs(smooth.ravel()[cells]).astype(np.float64)
    weight = height * found.area.ravel()[cells]
    volume = float(weight.sum())
    depth = float(weight @ found.depth[rows] / volume)
    theta = float(np.angle((weight * np.exp(1j * found.theta[columns])).sum()))
    width = np.unique(columns).size * 2 * np.pi / len(found.theta)
    depths = float(found.depth[rows.min()]), float(found.depth[rows.max()])
    peak = float(np.percentile(height, 98))
    confidence = float(np.mean(height > 3 * sigma.ravel()[cells]))
    ringed = [any(joint.first <= z <= joint.last for joint in joints) for z in found.depth[rows]]
    at_joint = bool(np.mean(ringed) > 0.6)
    if at_joint:
        kind = "joint"
    elif sign > 0:
        kind = "loss"
    elif peak > _TALL_M and _hidden_behind(found, rows, columns) > _SHADOW * area:
        kind = "object"
    else:
        kind = "deposit" if abs(theta - np.pi / 2) < _INVERT else "intrusion"
    return Region(area, sign * peak, sign * volume, depth, theta, depths, width, kind, at_joint, confidence, cells)


def _hidden_behind(found: DeviationMap, rows: NDArray[np.intp], columns: NDArray[np.intp]) -> float:
    """Wall (m2) that is hidden right behind a region: a gap in the cloud where the disparities have none.

    A deposit slopes back to the wall and hides little; what stands free of the wall hides as much as its height makes it.
    """
    hidden = 0.0
    gap = max(2, len(found.depth) // 60)
    for column in np.unique(columns):
        row = int(rows[columns == column].max()) + 1
        waited = 0
        while row < len(found.depth) and waited <= gap:
            if found.hidden[row, column]:
                hidden += float(found.area[row, column])
                waited = 0
            elif found.measured[row, column]:
                waited += 1
            else:
                break
            row += 1
    return hidden
