"""Objects in a scan: where pipes meet, and where something thicker than the pipe sits on it; cut out with a base and, where a
handle may be, a 'mushroom' (paper, Sec. 3.4)."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from estimators.structure.types import PIPE_RADIUS, Array, Mask, Segment, Sighting


@dataclass(frozen=True)
class ObjectSettings:
    """``meet``: axes nearer than this (m) meet; ``reach``: how far beyond its seen end a pipe may go on to where it meets
    another; ``thicker``: mean excess of radius in a slice that is an object; ``proud``: excess of a single point that stands
    out. ``base`` and ``cap``: half length along the pipe and radius of the base, height range and half widths of the
    mushroom's cap.
    """

    radius: float = PIPE_RADIUS
    meet: float = 0.045
    reach: float = 0.14
    slice: float = 0.015
    thicker: float = 0.0035
    proud: float = 0.015
    body_radius: float = 0.10
    base_length: float = 0.13
    base_radius: float = 0.085
    cap_heights: tuple[float, float] = (0.06, 0.20)
    cap_length: float = 0.26
    cap_width: float = 0.10
    least_points: int = 25
    junction_sigma: float = 0.006
    inline_sigma: float = 0.015
    end_sigma: float = 0.05


@dataclass(frozen=True)
class _Place:
    position: Array
    pipes: Array
    kind: str
    main: Segment


def find_objects(
    raw: Array, points: Array, on_pipes: Mask, segments: list[Segment], settings: ObjectSettings | None = None
) -> list[Sighting]:
    """Objects among the points of the structure: ``raw`` (M, 3) all of them, ``points`` (N, 3) thinned, of which
    ``on_pipes`` (N,) lie on ``segments``."""
    settings = settings or ObjectSettings()
    places = _junctions(segments, settings)
    for segment in segments:
        places += _thickenings(segment, points, segments, places, settings)
    sightings = []
    for place in places:
        cloud = _cut_out(raw, place, segments, settings)
        if len(cloud) >= settings.least_points:
            sightings.append(Sighting(place.position, _covariance(place, settings), place.pipes, cloud, place.kind))
    return sightings


def _covariance(place: _Place, settings: ObjectSettings) -> Array:
    if place.kind == "junction":
        return np.eye(3) * settings.junction_sigma**2
    along = settings.inline_sigma if place.kind == "inline" else settings.end_sigma
    axis = place.main.direction
    return np.eye(3) * settings.junction_sigma**2 + np.outer(axis, axis) * (along**2 - settings.junction_sigma**2)


def _junctions(segments: list[Segment], settings: ObjectSettings) -> list[_Place]:
    """Where axes meet. Two or three that meet in one place are one object."""
    found: list[tuple[Array, set[int]]] = []
    for i, j in combinations(range(len(segments)), 2):
        a, b = segments[i], segments[j]
        cosine = float(a.direction @ b.direction)
        if abs(cosine) > 0.8:
            continue
        apart = b.start - a.start
        along_a = (apart @ a.direction - cosine * (apart @ b.direction)) / (1 - cosine**2)
        along_b = (cosine * (apart @ a.direction) - apart @ b.direction) / (1 - cosine**2)
        if not (
            -settings.reach < along_a < a.length + settings.reach and -settings.reach < along_b < b.length + settings.reach
        ):
            continue
        on_a, on_b = a.start + along_a * a.direction, b.start + along_b * b.direction
        if np.linalg.norm(on_a - on_b) > settings.meet:
            continue
        # two that cross, both going on beyond, are one behind the other or a cross, of which Table 1 has none
        if all(0.15 < along < one.length - 0.15 for along, one in ((along_a, a), (along_b, b))):
            continue
        middle = (on_a + on_b) / 2
        for position, members in found:
            if np.linalg.norm(position - middle) < 0.08:
                members |= {i, j}
                break
        else:
            found.append((middle, {i, j}))
    places = []
    for position, members in found:
        pipes = [direction for k in members for direction in _leaving(segments[k], position)]
        main = max((segments[k] for k in members), key=lambda s: min(_beyond(s, position)))
        places.append(_Place(position, np.array(pipes).reshape(-1, 3), "junction", main))
    return places


def _beyond(segment: Segment, position: Array) -> tuple[float, float]:
    along = float((position - segment.start) @ segment.direction)
    return along, segment.length - along


def _leaving(segment: Segment, position: Array, least: float = 0.16) -> list[Array]:
    """The directions in which ``segment`` goes on from ``position``."""
    before, after = _beyond(segment, position)
    return [d for d, way in ((-segment.direction, before), (segment.direction, after)) if way > least]


def _thickenings(
    segment: Segment, points: Array, segments: list[Segment], places: list[_Place], settings: ObjectSettings
) -> list[_Place]:
    """Stretches of ``segment``, and beyond its ends, where the surface is further from the axis than a pipe's."""
    axis = segment.direction
    relative = points - segment.start
    along = relative @ axis
    distance = np.linalg.norm(relative - along[:, None] * axis, axis=1)
    near = np.flatnonzero((distance < settings.body_radius) & (along > -0.25) & (along < segment.length + 0.25))
    for other in segments:
        if other is not segment:
            near = near[_distance_to(other, points[near]) > settings.radius + 0.02]
            # what sits at the other's end may lie beyond this one's: it is the other's where that axis is nearer
            near = near[_distance_to(other, points[near], settings.reach) > distance[near]]
    along, excess = along[near], distance[near] - settings.radius
    count = int(np.ceil((segment.length + 0.5) / settings.slice))
    slot = np.clip(((along + 0.25) / settings.slice).astype(int), 0, count - 1)
    number = np.bincount(slot, minlength=count)
    core = excess < 0.03
    mean_here = np.bincount(slot[core], excess[core], count) / np.maximum(np.bincount(slot[core], minlength=count), 1)
    proud_here = np.bincount(slot, excess > settings.proud, count)
    # over three slices, since one has few points
    mean, proud, dense = (np.convolve(np.asarray(x, float), np.ones(3) / 3, "same") for x in (mean_here, proud_here, number))
    thick: Mask = (dense >= 1.5) & ((proud >= 1.0) | ((mean > settings.thicker) & (dense >= 3)))
    found: list[_Place] = []
    for first, last in _stretches(thick, 4):
        low, high = first * settings.slice - 0.25, (last + 1) * settings.slice - 0.25
        if high - low < 0.06:
            continue
        middle = (low + high) / 2
        position = segment.start + middle * axis
        taken = [*places, *found]
        if any(np.linalg.norm(place.position - position) < 0.15 for place in taken):
            continue
        if high - low > 0.34:
            continue
        inside = 0.12 < middle < segment.length - 0.12
        seen_before = dense[max(0, first - 4) : first].sum() >= 2
        seen_after = dense[last + 1 : last + 5].sum() >= 2
        if inside and not (seen_before and seen_after):
            continue  # half hidden: its middle is not the middle of what is seen
        if not inside and not (-0.2 < middle < segment.length + 0.2):
            continue
        towards = number[max(0, first - 4) : first] if middle > segment.length / 2 else number[last + 1 : last + 5]
        if not inside and towards.sum() < 6:
            continue  # it begins where the pipe ends: beyond a gap it is something else's
        found.append(
            _Place(position, np.array(_leaving(segment, position, 0.1)).reshape(-1, 3), "inline" if inside else "end", segment)
        )
    return found


def _stretches(flags: Mask, bridge: int) -> list[tuple[int, int]]:
    """First and last number of each stretch of true flags; gaps up to ``bridge`` are bridged."""
    where = np.flatnonzero(flags)
    if not len(where):
        return []
    breaks = np.flatnonzero(np.diff(where) > bridge)
    starts = np.concatenate([[0], breaks + 1])
    ends = np.concatenate([breaks, [len(where) - 1]])
    return [(int(where[a]), int(where[b])) for a, b in zip(starts, ends, strict=True)]


def _distance_to(segment: Segment, points: Array, beyond: float = 0.0) -> Array:
    """Distance (N,) from the axis between its ends and so far (m) ``beyond`` them, inf beside it."""
    along = (points - segment.start) @ segment.direction
    off = points - segment.start - along[:, None] * segment.direction
    distance: Array = np.where((along > -beyond) & (along < segment.length + beyond), np.linalg.norm(off, axis=1), np.inf)
    return distance


def _cut_out(raw: Array, place: _Place, segments: list[Segment], settings: ObjectSettings) -> Array:
    """The points of the object: its base, and the cap of the mushroom on the side where there is most.

    Only objects with one pipe or two in line may carry a handle (Sec. 3.4); a three-way valve is one with three, so that a
    cap is looked for there as well. Of the pipes themselves what lies further out than the base is left away.
    """
    axis = place.main.direction
    reach = np.hypot(max(settings.cap_length, settings.base_length), max(settings.cap_heights[1], settings.base_radius))
    relative = raw - place.position
    raw = raw[np.einsum("ij,ij->i", relative, relative) < (reach + 0.01) ** 2]  # most of a scan is far from it
    relative = raw - place.position
    along = relative @ axis
    off = relative - along[:, None] * axis
    distance = np.linalg.norm(off, axis=1)
    base = (np.abs(along) < settings.base_length) & (distance < settings.base_radius)
    for pipe in place.pipes:
        if abs(pipe @ axis) < 0.5:  # a branch: the base reaches along it too
            out = relative @ pipe
            side = np.linalg.norm(relative - out[:, None] * pipe, axis=1)
            base |= (out > 0) & (out < settings.base_length) & (side < settings.base_radius)
    high = (distance > settings.cap_heights[0]) & (distance < settings.cap_heights[1]) & (np.abs(along) < settings.cap_length)
    for segment in segments:
        high &= _distance_to(segment, raw) > settings.radius + 0.02
    cap = np.zeros(len(raw), dtype=bool)
    if high.sum() >= 8:
        # the side of the handle: the direction about the axis that most of what stands out lies in
        across = place.main.across
        angle = np.arctan2(off[high] @ across[1], off[high] @ across[0])
        turns = np.linspace(-np.pi, np.pi, 24, endpoint=False)
        votes = (np.cos(angle[:, None] - turns[None]) > np.cos(0.35)).sum(axis=0)
        best = turns[int(np.argmax(votes))]
        stem = np.cos(best) * across[0] + np.sin(best) * across[1]
        width = np.abs(relative @ np.cross(axis, stem))
        inside = high & (off @ stem > settings.cap_heights[0]) & (width < settings.cap_width)
        # a handle stands on its stem: something of it lies above the middle
        if inside.sum() >= 8 and (np.abs(along[inside]) < 0.05).sum() >= 4:
            cap = inside
    cut: Array = raw[base | cap]
    return cut
