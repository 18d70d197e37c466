"""Pipes in a scan: cylinders of known radius by RANSAC, their ends, doubled and collinear ones made one (Sec. 3.3, 4.5).

A surface point moved along its normal by the known radius lies on the axis. So a cylinder is a line among moved points: one of
them, with the direction in which its neighbours lie, is a whole hypothesis, and all can be scored against all points at once.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from estimators.structure.types import PIPE_RADIUS, Array, Mask, Segment


@dataclass(frozen=True)
class PipeSettings:
    """``least_length`` is the paper's; ``tolerance``: distance of a moved point from the axis; ``noise``: of a point of the
    thinned cloud (m), for the covariance; ``gap``: length without surface beyond which a pipe is two; a ``least_piece`` of
    surface counts, longer than the end of a valve beside it is wide (0.12). ``floor_offset`` (m) and ``floor_turn`` (rad):
    what no number of points takes away; ``doubt_offset`` and ``doubt_turn`` where less than ``clean_share`` of what is seen is
    plain pipe."""

    radius: float = PIPE_RADIUS
    least_length: float = 0.30
    tolerance: float = 0.014
    noise: float = 0.006
    gap: float = 0.27
    least_piece: float = 0.13
    floor_offset: float = 0.0008
    floor_turn: float = 0.0010
    clean_share: float = 0.6
    doubt_offset: float = 0.010
    doubt_turn: float = 0.035
    hypotheses: int = 220
    least_points: int = 30
    most: int = 16
    bin: float = 0.02


def find_pipes(
    points: Array, normals: Array, rng: np.random.Generator, settings: PipeSettings | None = None
) -> tuple[list[Segment], Mask]:
    """The pipes among ``points`` (N, 3) with ``normals`` (N, 3) outwards, and which points lie on one of them (N,)."""
    settings = settings or PipeSettings()
    taken = np.zeros(len(points), dtype=bool)
    found: list[Segment] = []
    if len(points) < settings.least_points:
        return found, taken
    moved = points - settings.radius * normals
    bases, directions = _hypotheses(moved, rng, settings)
    weights = _fits(moved, normals, bases, directions, settings).astype(np.float32)  # a product counts faster than a sum
    for _ in range(settings.most):
        votes = weights @ ~taken
        best = int(np.argmax(votes))
        if votes[best] < settings.least_points:
            break
        weights[best] = 0.0
        segment, on_it = _refined(bases[best], directions[best], points, normals, ~taken, rng, settings)
        if segment is not None:
            taken |= on_it
            found.append(segment)
        else:  # its like would fail as well
            off = bases - bases[best]
            off = off - (off @ directions[best])[:, None] * directions[best]
            like = (np.abs(directions @ directions[best]) > 0.9995) & (np.einsum("ij,ij->i", off, off) < 0.004**2)
            weights[like] = 0.0
    return merged(found, width=2 * settings.radius), taken


def _hypotheses(moved: Array, rng: np.random.Generator, settings: PipeSettings) -> tuple[Array, Array]:
    """Points (H, 3) on the axis and directions (H, 3): the principal direction of the moved points about each."""
    chosen = rng.choice(len(moved), min(settings.hypotheses, len(moved)), replace=False)
    tree = cKDTree(moved)
    bases, directions = [], []
    neighbourhoods: list[list[int]] = [list(near) for near in np.atleast_1d(tree.query_ball_point(moved[chosen], 0.13))]
    for index, near in zip(chosen, neighbourhoods, strict=True):
        if len(near) < 8:
            continue
        patch = moved[near]
        direction = _principal(patch)
        # the patch may hold a second pipe: keep what is near the line, once more
        off = patch - moved[index]
        off -= (off @ direction)[:, None] * direction
        close = np.einsum("ij,ij->i", off, off) < (2 * settings.tolerance) ** 2
        if close.sum() >= 8:
            patch = patch[close]
            direction = _principal(patch)
            bases.append(patch.mean(axis=0))
        else:
            bases.append(np.median(patch, axis=0))
        directions.append(direction)
    if not bases:
        return np.zeros((0, 3)), np.zeros((0, 3))
    return np.array(bases), np.array(directions)


def _principal(patch: Array) -> Array:
    """The direction (3,) in which points (n, 3) spread most."""
    centred = patch - patch.mean(axis=0)
    direction: Array = np.linalg.eigh(centred.T @ centred)[1][:, 2]
    return direction


def _fits(moved: Array, normals: Array, bases: Array, directions: Array, settings: PipeSettings) -> Mask:
    """Which moved points (N,) lie on which hypotheses (H,), their normals across: (H, N)."""
    centre = moved.mean(axis=0)
    m, b, d = ((array - shift).astype(np.float32) for array, shift in ((moved, centre), (bases, centre), (directions, 0.0)))
    along = d @ m.T - np.einsum("hj,hj->h", b, d)[:, None]
    squared = np.einsum("nj,nj->n", m, m)[None] - 2 * (b @ m.T) + np.einsum("hj,hj->h", b, b)[:, None] - along**2
    across: Mask = np.abs(d @ normals.astype(np.float32).T) < 0.45
    fits: Mask = across & (squared < settings.tolerance**2) & (np.abs(along) < 1.0)
    return fits


def _refined(
    base: Array,
    direction: Array,
    points: Array,
    normals: Array,
    free: Mask,
    rng: np.random.Generator,
    settings: PipeSettings,
) -> tuple[Segment | None, Mask]:
    """Least squares of the distances to the surface over the points near it; None where they are no pipe."""
    nothing = np.zeros(len(points), dtype=bool)
    for turn in range(5):
        relative = points - base
        along = relative @ direction
        off = relative - along[:, None] * direction
        distance = np.sqrt(np.einsum("ij,ij->i", off, off))
        near = free & (np.abs(distance - settings.radius) < settings.tolerance) & (np.abs(along) < 2.5)
        near[near] = np.einsum("ij,ij->i", off[near], normals[near]) > 0.6 * distance[near]
        low, high = _stretch(along[near], settings)
        near &= (along >= low) & (along <= high)
        if near.sum() < settings.least_points or high - low < 0.2:
            return None, nothing
        fit = near.copy()
        if turn >= 2:  # fittings are thicker than the pipe and would pull its axis towards the sensor
            fit[near] = _clean(off[near], distance[near], along[near] - low, direction, rng, settings)
            if fit.sum() < settings.least_points // 2:
                return None, nothing
        middle = (low + high) / 2
        residual, jacobian = _linearised(off[fit], distance[fit], along[fit] - middle, direction, settings.radius)
        weights = 1.0 / (1.0 + (residual / settings.noise) ** 2)
        normal_matrix = (jacobian * weights[:, None]).T @ jacobian + np.diag([1e-6, 1e-6, 1e-8, 1e-8])
        step = -np.linalg.solve(normal_matrix, jacobian.T @ (weights * residual))
        if np.abs(step[:2]).max() > 0.05 or np.abs(step[2:]).max() > 0.3:
            return None, nothing
        across = _across(direction)
        base = base + middle * direction + step[:2] @ across
        direction = direction + step[2:] @ across
        direction /= np.linalg.norm(direction)
    along = (points - base) @ direction
    low, high = _stretch(along[near], settings)
    filled = np.unique(np.floor((along[near] - low) / settings.bin))
    if high - low < settings.least_length or len(filled) * settings.bin < 0.5 * settings.least_length:
        return None, nothing
    centre, half = base + (low + high) / 2 * direction, (high - low) / 2
    relative = points[fit] - centre
    stretch = relative @ direction
    off = relative - stretch[:, None] * direction
    _, jacobian = _linearised(off, np.linalg.norm(off, axis=1), stretch, direction, settings.radius)
    information = jacobian.T @ jacobian / settings.noise**2 + np.eye(4)
    # where fittings outweigh the pipe, which slices are the pipe's is itself a guess
    doubtful = len(np.unique(np.floor((along[fit] - low) / settings.bin))) < settings.clean_share * len(filled)
    floors = [settings.doubt_offset, settings.doubt_turn] if doubtful else [settings.floor_offset, settings.floor_turn]
    floor = np.repeat(floors, 2) ** 2
    covariance = np.asarray(np.linalg.inv(information) + np.diag(floor), dtype=np.float64)
    start, end = centre - half * direction, centre + half * direction
    return Segment(start, end, _across(direction), covariance, (filled + 0.5) * settings.bin), near


def _linearised(off: Array, distance: Array, along: Array, direction: Array, radius: float) -> tuple[Array, Array]:
    """Distances (N,) from the surface and their derivatives (N, 4) by offset and turn of the axis."""
    slope = -off @ _across(direction).T / distance[:, None]
    return distance - radius, np.column_stack([slope, slope * along[:, None]])


def _clean(
    off: Array, distance: Array, along: Array, direction: Array, rng: np.random.Generator, settings: PipeSettings
) -> Mask:
    """Which points lie in slices that are a pipe's: those whose centres lie on the line that passes most of them.

    A fitting's slices have their centres nearer to the sensor, by the excess of its radius.
    """
    slot = (along / 0.03).astype(int)
    count = int(slot.max()) + 1
    residual, jacobian = _linearised(off, distance, along, direction, settings.radius)
    slope = jacobian[:, :2]
    sums = np.stack([np.bincount(slot, slope[:, i] * slope[:, j], count) for i, j in ((0, 0), (0, 1), (1, 1))], axis=1)
    right = np.stack([np.bincount(slot, slope[:, i] * residual, count) for i in range(2)], axis=1)
    matrix = np.stack([sums[:, [0, 1]], sums[:, [1, 2]]], axis=1) + 0.3 * np.eye(2)
    number = np.bincount(slot, minlength=count)
    told = np.flatnonzero(number >= 5)
    if len(told) < 4:
        return np.ones(len(along), dtype=bool)
    centres = -np.linalg.solve(matrix[told], right[told][:, :, None])[:, :, 0]
    places = (told + 0.5) * 0.03
    i, j = rng.integers(0, len(told), (2, 400))
    apart = np.abs(places[i] - places[j]) > 0.12
    i, j = i[apart], j[apart]
    if not len(i):
        return np.ones(len(along), dtype=bool)
    share = (places[None, :] - places[i, None]) / (places[j] - places[i])[:, None]
    line = centres[i, None] * (1 - share[:, :, None]) + centres[j, None] * share[:, :, None]
    miss = np.linalg.norm(centres[None] - line, axis=2)
    weight = np.minimum(number[told], 15)
    votes = (np.maximum(0.0, 1 - (miss / 0.0025) ** 2) * weight).sum(axis=1)
    good = np.zeros(count, dtype=bool)
    good[told[miss[int(np.argmax(votes))] < 0.004]] = True
    clean: Mask = good[slot]
    return clean


def _stretch(along: Array, settings: PipeSettings) -> tuple[float, float]:
    """Where the pipe begins and ends: the longest chain of pieces of surface with no gap wider than a valve between them."""
    if len(along) < 2:
        return 0.0, 0.0
    pieces = [(a, b) for a, b in _chains(np.sort(along), 0.06) if b - a >= settings.least_piece]
    if not pieces:
        return 0.0, 0.0
    best, current = pieces[0], pieces[0]
    for low, high in pieces[1:]:
        current = (current[0], high) if low - current[1] <= settings.gap else (low, high)
        if current[1] - current[0] > best[1] - best[0]:
            best = current
    return max(best, pieces[0], key=lambda piece: piece[1] - piece[0])


def _chains(ordered: Array, gap: float) -> list[tuple[float, float]]:
    breaks = np.flatnonzero(np.diff(ordered) > gap)
    starts = np.concatenate([[0], breaks + 1])
    ends = np.concatenate([breaks, [len(ordered) - 1]])
    return [(float(ordered[a]), float(ordered[b])) for a, b in zip(starts, ends, strict=True)]


def _across(direction: Array) -> Array:
    """Two unit vectors (2, 3) at right angles to ``direction`` and to each other."""
    # written out: numpy's cross product takes longer than all the rest of it, and this is called often
    x, y, z = (float(value) for value in direction)
    least = min(abs(x), abs(y), abs(z))
    a, b, c = (0.0, z, -y) if abs(x) == least else (-z, 0.0, x) if abs(y) == least else (y, -x, 0.0)
    length = math.sqrt(a * a + b * b + c * c)
    a, b, c = a / length, b / length, c / length
    return np.array([[a, b, c], [y * c - z * b, z * a - x * c, x * b - y * a]])


def merged(
    segments: list[Segment], angle: float = 0.175, apart: float = 0.03, gap: float = 0.4, width: float = 2 * PIPE_RADIUS
) -> list[Segment]:
    """Collinear and doubled segments as one each (Sec. 4.5, Fig. 8): the longest from the two pairs of ends is kept.

    The angle is the paper's. Its 0.3 m between lines would join pipes that run side by side here: 3 cm is as wide as a pipe.
    A segment that lies in another one, nearer to its axis than pipes of that ``width`` can, is none: two valves on a pipe are
    thicker than it, so that a pipe fits along their near sides.
    """
    kept: list[Segment] = []
    for segment in sorted(segments, key=lambda one: -len(one.bins)):
        if any(_lies_in(segment, other, angle, 0.75 * width) for other in kept):
            continue
        for number, other in enumerate(kept):
            one = _as_one(other, segment, angle, apart, gap)
            if one is not None:
                kept[number] = one
                break
        else:
            kept.append(segment)
    return kept


def _lies_in(segment: Segment, other: Segment, angle: float, apart: float) -> bool:
    """Whether a good part of ``segment`` was seen beside ``other``, all of it no further than ``apart`` (m) from its axis."""
    if abs(segment.direction @ other.direction) < np.cos(angle):
        return False
    seen = segment.start + segment.bins[:, None] * segment.direction - other.start
    along = seen @ other.direction
    off = np.linalg.norm(seen - along[:, None] * other.direction, axis=1)
    return bool(off.max() < apart and np.mean((along > 0) & (along < other.length)) > 0.2)


def _as_one(a: Segment, b: Segment, angle: float, apart: float, gap: float) -> Segment | None:
    if abs(a.direction @ b.direction) < np.cos(angle):
        return None
    for one, other in ((a, b), (b, a)):
        ends = np.array([other.start, other.end]) - one.start
        off = ends - (ends @ one.direction)[:, None] * one.direction
        if np.linalg.norm(off, axis=1).max() > apart:
            return None
    along = np.array([0.0, a.length, *((np.array([b.start, b.end]) - a.start) @ a.direction)])
    low, high = np.sort(along[2:])
    if max(low, 0.0) - min(high, a.length) > gap:
        return None
    # the axis through both, weighed by what each saw of it; the covariance stays that of the longer, at the new middle
    weight = len(b.bins) / (len(a.bins) + len(b.bins))
    start, end = (a.start + s * a.direction for s in (along.min(), along.max()))
    offsets = [(p - b.start) - ((p - b.start) @ b.direction) * b.direction for p in (start, end)]
    start, end = (p - weight * off for p, off in zip((start, end), offsets, strict=True))
    direction = (end - start) / np.linalg.norm(end - start)
    shift = float((start + end - a.start - a.end) @ a.direction / 2)
    carry = np.eye(4)
    carry[0, 2] = carry[1, 3] = shift
    bins = np.unique(
        np.round(np.concatenate([a.bins, (b.start - a.start) @ a.direction + b.bins * np.sign(b.direction @ a.direction)]), 3)
    )
    return Segment(start, end, _carried(a.across, direction), carry @ a.covariance @ carry.T, bins - along.min())


def _carried(across: Array, direction: Array) -> Array:
    first = across[0] - (across[0] @ direction) * direction
    first /= np.linalg.norm(first)
    return np.array([first, np.cross(direction, first)])
