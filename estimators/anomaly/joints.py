"""Pipe joints as rings in the deviation map: their gap, and by how much the next pipe is displaced."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimators.anomaly.deviation import DeviationMap

_AROUND = 0.55
"""Share of the measured way around that a ring takes."""
_LONGEST_M = 0.10
_LEAST_M, _LEAST_SHARE = 0.0025, 0.008
_COMPARED_M = 0.08


@dataclass(frozen=True)
class Joint:
    """A ring between the depths ``first`` and ``last`` (m). ``gap`` (m) is its length along the pipe, ``step`` (m) how far it
    lies outwards (inwards negative); ``offset`` (m) is how far the pipe behind it is displaced towards ``offset_theta`` (rad),
    None where too little of it was seen to tell. ``gap_std`` and ``offset_std`` (m): how well they are known, nan where nothing
    says so."""

    depth: float
    first: float
    last: float
    gap: float
    step: float
    offset: float | None
    offset_theta: float | None
    gap_std: float = float("nan")
    offset_std: float = float("nan")


def find_joints(found: DeviationMap) -> list[Joint]:
    """Every ring, from near to far."""
    rows = len(found.depth)
    step = float(found.depth[1] - found.depth[0])
    least = np.maximum(_LEAST_M, _LEAST_SHARE * found.radius)
    measured = found.measured
    counts = measured.sum(axis=1)
    enough = counts > 0.3 * np.maximum(found.wall.sum(axis=1), 0.2 * len(found.theta))
    joints = []
    for sign in (1.0, -1.0):
        beyond = measured & (np.nan_to_num(sign * found.deviation) > least)
        ring = enough & (beyond.sum(axis=1) > _AROUND * np.maximum(counts, 1))
        padded = np.r_[False, ring, False].astype(int)
        begins, stops = (np.flatnonzero(np.diff(padded) == turn).tolist() for turn in (1, -1))
        for first, last in zip(begins, stops, strict=True):
            length = (last - first) * step
            # a ring at the very end is the end of the wall, not a joint
            if length > _LONGEST_M or first < 3 or last > rows - 3:
                continue
            height = float(np.nanmedian(np.where(beyond[first:last], found.deviation[first:last], np.nan)))
            offset = _displacement(found, first, last, step)
            spare = 2 * step
            joints.append(
                Joint(
                    float(found.depth[first:last].mean()),
                    float(found.depth[first] - spare),
                    float(found.depth[last - 1] + spare),
                    float(length),
                    height,
                    *(offset if offset is not None else (None, None)),
                )
            )
    return sorted(joints, key=lambda joint: joint.depth)


def ring_cells(found: DeviationMap, joints: list[Joint]) -> NDArray[np.bool_]:
    """Cells (Z, A) of the map that joints take: expected, and no part of a score."""
    rows = np.zeros(len(found.depth), dtype=bool)
    for joint in joints:
        rows |= (found.depth >= joint.first) & (found.depth <= joint.last)
    return np.broadcast_to(rows[:, None], found.deviation.shape)


def _displacement(found: DeviationMap, first: int, last: int, step: float) -> tuple[float, float] | None:
    """(metres, direction) by which the wall behind a ring is displaced against the wall before it."""
    reach = max(3, round(_COMPARED_M / step))
    before = found.deviation[max(first - 2 - reach, 0) : max(first - 2, 0)]
    behind = found.deviation[last + 2 : last + 2 + reach]
    if len(before) < 3 or len(behind) < 3:
        return None
    known = (np.isfinite(before).sum(axis=0) > 1) & (np.isfinite(behind).sum(axis=0) > 1)
    if known.mean() < 0.4:
        return None
    change = np.nanmedian(behind[:, known], axis=0) - np.nanmedian(before[:, known], axis=0)
    theta = found.theta[known]
    rows = np.stack([np.ones_like(theta), np.cos(theta), np.sin(theta)], axis=1)
    weight = np.ones(len(theta))
    solution = np.zeros(3)
    for _ in range(6):
        solution[:] = np.linalg.lstsq(rows * weight[:, None], change * weight, rcond=None)[0]
        residual = change - rows @ solution
        scale = max(1.4826 * float(np.median(np.abs(residual))), 1e-4)
        weight = 1.0 / np.sqrt(1.0 + (residual / (2 * scale)) ** 2)
    return float(np.hypot(solution[1], solution[2])), float(np.arctan2(solution[2], solution[1]))
