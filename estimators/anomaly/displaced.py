"""Displaced joints: where the wall behind stands beside the wall before it, all around the pipe and from one place on.

A gap is narrower than what one window of the match covers, and at a grazing angle little of it is seen at all; a displacement goes
on behind it. So it is looked for in the way of the wall's middle: at each depth the ring's own shift against the fitted wall,
and then where a straight line through the shifts before a place and one through those behind it do not meet.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimators.anomaly.deviation import DeviationMap
from estimators.anomaly.joints import Joint

Floats = NDArray[np.float64]

_REACH_M = 0.14
"""How much of the wall on either side the lines are laid through."""
_GUARD_M, _GUARD_SHARE = 0.012, 0.12
"""What a window of the match smears about a place is left out: in metres, and as a share of the radius."""
_LEAST_SIDE = 6
_LEAST_M, _LEAST_SHARE = 0.003, 0.015
_TIMES_NOISE = 5.0
_AROUND = 0.55
"""Share of the way around that must have been measured for a ring's shift to be told."""
_ALL_AROUND = 0.5
"""Share of what changes at the place that a shift of the whole ring must explain: a deposit that begins there is none."""
_SAME_M = 0.06
"""A ring and a displacement this near to each other are one joint."""


@dataclass(frozen=True)
class _Jumps:
    """At each depth: by how much (m, x and y) the ring behind is shifted, (Z, 2), nan where it cannot be told."""

    shift: Floats
    sigma: Floats


def with_displaced(found: DeviationMap, rings: list[Joint]) -> list[Joint]:
    """``rings`` (see ``joints.find_joints``) and the displaced joints of which no ring was seen, from near to far; those have
    neither ``gap`` nor ``step`` (nan). A ring whose displacement was not told gets it."""
    jumps = _jumps(found)
    size = np.hypot(jumps.shift[:, 0], jumps.shift[:, 1])
    known = np.isfinite(size)
    if not known.any():
        return rings
    radius = float(np.median(found.radius))
    noise = float(np.median(size[known]))
    least = np.maximum(max(_LEAST_M, _LEAST_SHARE * radius, _TIMES_NOISE * noise / 1.18), _TIMES_NOISE * np.nan_to_num(jumps.sigma))
    joints = list(rings)
    for row in _peaks(np.where(known, size, 0.0), round(_REACH_M / _step(found))):
        depth = float(found.depth[row])
        if size[row] < least[row] or any(abs(depth - joint.depth) < _SAME_M for joint in rings):
            continue
        if _explained(found, row, jumps.shift[row]) < _ALL_AROUND:
            continue
        reach = _guard(found)
        theta = float(np.arctan2(jumps.shift[row, 1], jumps.shift[row, 0]))
        nan = float("nan")
        joints.append(Joint(depth, depth - reach, depth + reach, nan, nan, float(size[row]), theta))
    return sorted(joints, key=lambda joint: joint.depth)


def ring_shifts(found: DeviationMap) -> tuple[Floats, Floats]:
    """((Z, 2) shift of the ring at each depth in m, x and y; (Z,) its sigma), nan where too little of it was measured.

    A curve r(theta) that is shifted by (x, y) changes by x (cos + r'/r sin) + y (sin - r'/r cos) to first order.
    """
    design = _design(found)
    measured = found.measured
    deviation = np.nan_to_num(found.deviation).astype(np.float64)
    weight = measured.astype(np.float64)
    solution = np.zeros((len(found.depth), 3))
    for _ in range(6):
        normal = np.einsum("za,zai,zaj->zij", weight, design, design) + 1e-9 * np.eye(3)
        solution = np.linalg.solve(normal, np.einsum("za,zai,za->zi", weight, design, deviation)[..., None])[..., 0]
        off = np.where(measured, np.abs(deviation - np.einsum("zai,zi->za", design, solution)), np.nan)
        with np.errstate(all="ignore"):
            scale = np.maximum(1.4826 * np.nan_to_num(np.nanmedian(off, axis=1)), 2e-4)[:, None]
        weight = measured / (1.0 + (np.nan_to_num(off) / (2 * scale)) ** 2)
    spread = np.sqrt(np.linalg.inv(normal)[:, 1:, 1:].diagonal(axis1=1, axis2=2).max(axis=1)) * scale[:, 0]
    known = measured.mean(axis=1) > _AROUND
    return np.where(known[:, None], solution[:, 1:], np.nan), np.where(known, spread, np.nan)


def _design(found: DeviationMap) -> Floats:
    """(Z, A, 3): what a wider ring, and one shifted by 1 along x and y, changes of the radius."""
    radius = found.radius.astype(np.float64)
    slope = np.gradient(np.concatenate([radius[:, -1:], radius, radius[:, :1]], axis=1), axis=1)[:, 1:-1]
    turn = slope / (2 * np.pi / len(found.theta)) / np.maximum(radius, 1e-6)
    cosine, sine = np.cos(found.theta), np.sin(found.theta)
    return np.stack([np.ones_like(radius), cosine + turn * sine, sine - turn * cosine], axis=-1)


def _jumps(found: DeviationMap) -> _Jumps:
    """What is missing between the line through the shifts before each depth and the one through those behind it."""
    shift, _ = ring_shifts(found)
    depth, guard = found.depth, _guard(found)
    jump, sigma = np.full(shift.shape, np.nan), np.full(len(depth), np.nan)
    for row, at in enumerate(depth):
        ends = []
        for sign in (-1.0, 1.0):
            way = sign * (depth - at)
            side = (way >= guard) & (way <= guard + _REACH_M) & np.isfinite(shift[:, 0])
            if side.sum() < _LEAST_SIDE or np.ptp(depth[side]) < 0.6 * _REACH_M:
                break
            line = np.stack([np.ones(side.sum()), depth[side] - at], axis=1)
            fitted = np.linalg.lstsq(line, shift[side], rcond=None)[0]
            rest = float(np.sqrt(np.mean((shift[side] - line @ fitted) ** 2)))
            ends.append((fitted[0], rest * float(np.sqrt(np.linalg.inv(line.T @ line)[0, 0]))))
        if len(ends) == 2:
            jump[row] = ends[1][0] - ends[0][0]
            sigma[row] = float(np.hypot(ends[0][1], ends[1][1]))
    return _Jumps(jump, sigma)


def _explained(found: DeviationMap, row: int, shift: Floats) -> float:
    """How much of the change at a depth, from angle to angle, is a shift of the whole ring."""
    depth, guard = found.depth, _guard(found)
    with np.errstate(all="ignore"):
        before, behind = (
            np.nanmean(np.where((way >= guard) & (way <= guard + _REACH_M / 2), found.deviation.T, np.nan), axis=1)
            for way in (depth[row] - depth, depth - depth[row])
        )
    change = behind - before
    known = np.isfinite(change)
    if known.mean() < _AROUND:
        return 0.0
    change = change[known] - change[known].mean()
    expected = _design(found)[row][known][:, 1:] @ shift
    rest = change - expected + expected.mean()
    return float(1.0 - np.mean(rest**2) / max(float(np.mean(change**2)), 1e-12))


def _peaks(size: Floats, apart: int) -> list[int]:
    """Rows that are the largest within ``apart`` of them."""
    return [row for row in np.flatnonzero(size > 0).tolist() if size[row] >= size[max(row - apart, 0) : row + apart + 1].max()]


def _guard(found: DeviationMap) -> float:
    return _GUARD_M + _GUARD_SHARE * float(np.median(found.radius))


def _step(found: DeviationMap) -> float:
    return float(found.depth[1] - found.depth[0])
