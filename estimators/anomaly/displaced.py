"""Displaced joints: where the wall behind stands beside the wall before it, all around the pipe and from one place on.

A gap is narrower than what one window of the match covers, and at a grazing angle little of it is seen at all; a displacement
goes on behind it. So it is looked for in the way of the wall's middle: at each depth the ring's own shift against the fitted
wall, and then where a line through the shifts before a place and one through those behind it do not meet. Where the wall was
not measured on both sides, nothing is told.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from estimators.anomaly.deviation import DeviationMap
from estimators.anomaly.joints import Joint
from estimators.anomaly.rows import row_medians

Floats = NDArray[np.float64]

_REACH_M = 0.14
"""How much of the wall on either side the lines are laid through."""
_GUARD_M, _GUARD_SHARE = 0.012, 0.12
"""What a window of the match smears about a place is left out: in metres, and as a share of the radius."""
_LEAST_SIDE = 6
_EVEN_M = 2e-4
"""No wall is more even than this."""
_LEAST_M, _LEAST_SHARE = 0.003, 0.015
_TIMES_NOISE = 5.0
_SHARE_STD = 0.03
"""What windows, and a ring's shift that is taken to first order, leave of a displacement, as a share of it."""
_AROUND = 0.55
"""Share of the way around that must have been measured for a ring's shift to be told."""
_ALL_AROUND = 0.5
"""Share of what changes at the place that a shift of the whole ring must explain: a deposit that begins there is none."""
_SAME_M = 0.06
"""A ring and a displacement this near to each other are one joint."""
_THIRD = 3
"""Of the map's angles so many make one for a ring's shift: a window of the match covers more of them."""


def with_displaced(found: DeviationMap, rings: list[Joint]) -> list[Joint]:
    """``rings`` (see ``joints.find_joints``) with their displacement, and the displaced joints of which no ring was seen, from
    near to far; those have neither ``gap`` nor ``step`` (nan)."""
    shift = ring_shifts(found)
    guard = _guard(found)
    jumps = _jumps(found.depth, shift, np.arange(len(found.depth)), guard, guard)[0]
    size = np.hypot(jumps[:, 0], jumps[:, 1])
    known = np.isfinite(size)
    if not known.any():
        return rings
    radius = float(np.median(found.radius))
    joints = list(rings)
    for row in _peaks(np.where(known, size, 0.0), round(_REACH_M / float(found.depth[1] - found.depth[0]))):
        depth = float(found.depth[row])
        # the side that stands back behind the edge is hidden by it for so long
        hidden = float(size[row]) * depth / radius
        (jump,), (sigma,) = _jumps(found.depth, shift, np.array([row]), guard, guard + hidden)
        offset = float(np.hypot(*jump))
        # elsewhere: the lines beside this very place reach so far; the median of two parts of noise is 1.18 sigma
        elsewhere = size[known & (np.abs(found.depth - depth) > guard + _REACH_M)]
        noise = float(np.median(elsewhere)) / 1.18 if len(elsewhere) >= _LEAST_SIDE else 0.0
        least = max(_LEAST_M, _LEAST_SHARE * radius, _TIMES_NOISE * noise, _TIMES_NOISE * sigma)
        if not offset >= least:
            continue
        if _explained(found, row, jump, guard, guard + hidden) < _ALL_AROUND:
            continue
        nan = float("nan")
        depth = float(found.depth[_edge(found.depth, shift, row, jump, guard)])
        std = float(np.linalg.norm([sigma, noise, _SHARE_STD * offset]))
        towards = float(np.arctan2(jump[1], jump[0]))
        same = [k for k, joint in enumerate(joints) if abs(depth - joint.depth) < _SAME_M]
        if same:  # a ring tells its displacement by the wall right beside it, which windows smear
            ring = min(same, key=lambda k: abs(depth - joints[k].depth))
            joints[ring] = replace(joints[ring], offset=offset, offset_theta=towards, offset_std=std)
        else:
            joints.append(Joint(depth, depth - guard, depth + guard, nan, nan, offset, towards, offset_std=std))
    return sorted(joints, key=lambda joint: joint.depth)


def ring_shifts(found: DeviationMap) -> Floats:
    """(Z, 2): the shift (m) of the ring at each depth against the fitted wall, x and y; nan where too little was measured.

    A curve r(theta) that is shifted by (x, y) changes by x (cos + r'/r sin) + y (sin - r'/r cos) to first order.
    """
    design = _design(found)[:, _THIRD // 2 :: _THIRD]
    part = found.deviation[:, _THIRD // 2 :: _THIRD].astype(np.float64)
    measured, deviation = np.isfinite(part), np.nan_to_num(part)
    turned = design.transpose(0, 2, 1)
    weight = measured.astype(np.float64)
    solution: Floats = np.zeros((len(found.depth), 3, 1))
    for _ in range(6):
        weighted = turned * weight[:, None]
        solution[:] = np.linalg.solve(weighted @ design + 1e-9 * np.eye(3), weighted @ deviation[..., None])
        off = np.abs(deviation - (design @ solution)[..., 0])
        scale = np.maximum(1.4826 * np.nan_to_num(row_medians(np.where(measured, off, np.nan)), nan=1.0), _EVEN_M)
        weight = measured / (1.0 + (off / (2 * scale[:, None])) ** 2)
    known = found.measured.mean(axis=1) > _AROUND
    return np.where(known[:, None], solution[:, 1:, 0], np.nan)


def _design(found: DeviationMap) -> Floats:
    """(Z, A, 3): what a wider ring, and one shifted by 1 along x and y, changes of the radius."""
    radius = found.radius.astype(np.float64)
    slope = np.gradient(np.concatenate([radius[:, -1:], radius, radius[:, :1]], axis=1), axis=1)[:, 1:-1]
    turn = slope / (2 * np.pi / len(found.theta)) / np.maximum(radius, 1e-6)
    cosine, sine = np.cos(found.theta), np.sin(found.theta)
    return np.stack([np.ones_like(radius), cosine + turn * sine, sine - turn * cosine], axis=-1)


def _jumps(depth: Floats, shift: Floats, rows: NDArray[np.intp], before: float, behind: float) -> tuple[Floats, Floats]:
    """((R, 2) m, sigma (R,)): what is missing at the depths of ``rows`` between the line through the shifts before each and the
    one through those behind it, each from so far (m) on; nan where either cannot be told."""
    away = depth - depth[rows, None]
    known = np.isfinite(shift[:, 0])
    there = np.where(known[:, None], shift, 0.0)
    ends, errors = [], []
    for sign, guard in ((-1.0, before), (1.0, behind)):
        side = known & (sign * away >= guard) & (sign * away <= guard + _REACH_M)
        x = np.where(side, away, 0.0)
        count, total, square = side.sum(axis=1), x.sum(axis=1), (x * x).sum(axis=1)
        reach = np.where(side, away, -np.inf).max(axis=1) - np.where(side, away, np.inf).min(axis=1)
        told = (count >= _LEAST_SIDE) & (reach >= 0.6 * _REACH_M)
        determinant = np.where(told, count * square - total**2, np.nan)
        values, along = side @ there, x @ there
        start = (square[:, None] * values - total[:, None] * along) / determinant[:, None]
        slope = (count[:, None] * along - total[:, None] * values) / determinant[:, None]
        rest = (side @ there**2 - start * values - slope * along).sum(axis=1) / (2 * np.maximum(count, 1))
        ends.append(start)
        errors.append(np.sqrt(np.maximum(rest, 0.0) * square / determinant))
    return np.asarray(ends[1] - ends[0]), np.hypot(*errors)


def _explained(found: DeviationMap, row: int, jump: Floats, before: float, behind: float) -> float:
    """How much of the change at a depth, from angle to angle, is a shift of the whole ring."""
    way = found.depth - found.depth[row]
    sides = []
    for sign, guard in ((-1.0, before), (1.0, behind)):
        near = (sign * way >= guard) & (sign * way <= guard + _REACH_M / 2)
        part = found.deviation[near].astype(np.float64)
        count = np.isfinite(part).sum(axis=0)
        sides.append(np.where(count > 0, np.nan_to_num(part).sum(axis=0) / np.maximum(count, 1), np.nan))
    change = sides[1] - sides[0]
    known = np.isfinite(change)
    if known.mean() < _AROUND:
        return 0.0
    expected = _design(found)[row][known][:, 1:] @ jump
    rest = change[known] - expected
    return float(1.0 - np.var(rest) / max(float(np.var(change[known])), 1e-12))


def _edge(depth: Floats, shift: Floats, row: int, jump: Floats, guard: float) -> int:
    """The row about ``row`` at which half of the jump is made: the jump itself is as large anywhere within the guard."""
    before = (depth < depth[row] - guard) & (depth > depth[row] - guard - _REACH_M) & np.isfinite(shift[:, 0])
    along = shift @ jump / float(jump @ jump)
    line = np.polyfit(depth[before], along[before], 1)
    made = (along - np.polyval(line, depth) > 0.5) & (np.abs(depth - depth[row]) <= 2 * guard)
    return int(np.argmax(made)) if made.any() else row


def _peaks(size: Floats, apart: int) -> list[int]:
    """Rows that are the largest within ``apart`` of them."""
    return [row for row in np.flatnonzero(size > 0).tolist() if size[row] >= size[max(row - apart, 0) : row + apart + 1].max()]


def _guard(found: DeviationMap) -> float:
    return _GUARD_M + _GUARD_SHARE * float(np.median(found.radius))
