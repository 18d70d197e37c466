"""The connection graph: which pipes leave an object, and the map at the end, with a belief for every edge."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.stats import norm

from estimators.structure.coverage import Coverage
from estimators.structure.handles import Handle, find_handle
from estimators.structure.objects_map import ObjectRecord, belief
from estimators.structure.recognition import ports_likelihood
from estimators.structure.slam import Feature, StructureFilter
from estimators.structure.types import CLASSES, PIPE_RADIUS, Array

ON_AXIS = 0.06
"""Distance (m) of an object from the axis of a pipe that it sits on."""
BEYOND = 0.16
"""A pipe leaves an object in a direction where it is seen further than this (m): fittings end before."""
LEAST_LENGTH = 0.30
SEEN = 0.12
"""Of the scans that show the pipe beside an object so many show the object as well; real ones come to 0.4 and more."""
WITH_HANDLE = ("ball valve", "butterfly valve", "3-way valve")


@dataclass(frozen=True)
class MapPipe:
    """A run of pipe: ends (3,), radius, the covariance (4, 4) of its line, number of scans that showed it."""

    number: int
    start: Array
    end: Array
    radius: float
    covariance: Array
    sightings: int


@dataclass(frozen=True)
class MapObject:
    """``beliefs`` (6,) of the classes with semantics, from single and fused scans; ``bayes`` and ``semantic`` from single ones.

    ``orientation`` (3, 3): columns along the straight way, the branch and the stem, as far as pipes and handle tell them.
    """

    number: int
    position: Array
    covariance: Array
    beliefs: Array
    bayes: Array
    semantic: Array
    pipes: Array
    sightings: int
    orientation: Array | None = None
    handle: Handle | None = None

    @property
    def label(self) -> int:
        """Number of the likeliest class."""
        return int(np.argmax(self.beliefs))


@dataclass(frozen=True)
class MapEdge:
    """Object ``object`` sits on pipe ``pipe``, ``along`` metres from its start: ``kind`` "end" or "through"."""

    pipe: int
    object: int
    kind: str
    along: float
    belief: float


@dataclass(frozen=True)
class StructureMap:
    """The semantic map."""

    pipes: tuple[MapPipe, ...]
    objects: tuple[MapObject, ...]
    edges: tuple[MapEdge, ...]


def leaving(slam: StructureFilter, coverage: Mapping[int, Coverage], position: Array) -> Array:
    """Unit vectors (n, 3) of the pipes that leave ``position`` (3,), as far as they have been seen."""
    found = []
    for number, feature in slam.features.items():
        if feature.line is None or number not in coverage or coverage[number].scans < 2:
            continue
        along, off = _place(feature, position)
        low, high = coverage[number].ends()
        if off > ON_AXIS or not low - BEYOND < along < high + BEYOND:
            continue
        if along - low > BEYOND:
            found.append(-feature.line.direction)
        if high - along > BEYOND:
            found.append(feature.line.direction)
    return np.array(found).reshape(-1, 3)


def final_map(
    slam: StructureFilter,
    coverage: Mapping[int, Coverage],
    records: Mapping[int, ObjectRecord],
    scans: int,
    radius: float = PIPE_RADIUS,
) -> StructureMap:
    """What has been seen often enough to be there. ``radius`` is that of all pipes."""
    least = min(5, max(2, scans // 25))
    lines = [f for f in slam.features.values() if f.line is not None and f.number in coverage and f.sightings >= least]
    lines = [f for f in lines if np.ptp(coverage[f.number].ends()) >= LEAST_LENGTH]
    lines = _without_doubles(lines, coverage)
    points = [f for f in slam.features.values() if f.point is not None and f.number in records and f.sightings >= least]
    points = [f for f in points if f.sightings > SEEN * _shown(f, lines, coverage)]
    edges = []
    pipes = []
    for feature in lines:
        assert feature.line is not None
        low, high = coverage[feature.number].ends()
        mine = []
        for thing in points:
            assert thing.point is not None
            along, off = _place(feature, thing.point)
            if off < 2 * ON_AXIS and low - BEYOND < along < high + BEYOND:
                mine.append((along, off, thing))
        at_ends = [(along, thing) for along, off, thing in mine if off < ON_AXIS]
        # a pipe that ends in an object ends where the object is
        start = min([low, *(a for a, _ in at_ends if a < low + BEYOND)])
        end = max([high, *(a for a, _ in at_ends if a > high - BEYOND)])
        near_start = [a for a, _ in at_ends if abs(a - low) < BEYOND]
        near_end = [a for a, _ in at_ends if abs(a - high) < BEYOND]
        start = min(near_start) if near_start else start
        end = max(near_end) if near_end else end
        point, direction = feature.line.point, feature.line.direction
        part = slice(feature.at, feature.at + 4)
        pipes.append(
            MapPipe(
                feature.number,
                point + start * direction,
                point + end * direction,
                radius,
                slam.covariance[part, part].copy(),
                feature.sightings,
            )
        )
        for along, off, thing in mine:
            kind = "end" if min(along - start, end - along) < BEYOND else "through"
            sure = _edge_belief(slam, thing, off, along, low, high)
            if sure > 0.5:
                edges.append(MapEdge(feature.number, thing.number, kind, along - start, sure))
    objects = [_object(slam, coverage, feature, records[feature.number]) for feature in points]
    return StructureMap(tuple(pipes), tuple(objects), tuple(edges))


def _place(feature: Feature, position: Array) -> tuple[float, float]:
    """Where along a line a position is, and how far off it."""
    assert feature.line is not None
    along = float(feature.line.along(position))
    return along, float(np.linalg.norm(position - feature.line.point - along * feature.line.direction))


def _edge_belief(slam: StructureFilter, thing: Feature, off: float, along: float, low: float, high: float) -> float:
    """Probability that the object's centre is on the pipe's axis, where it was seen and not beside it."""
    part = slice(thing.at, thing.at + 3)
    sigma = float(np.sqrt(np.trace(slam.covariance[part, part]) / 3 + 0.012**2))
    beyond = max(low - along, along - high, 0.0)
    return float(norm.cdf((ON_AXIS - off) / sigma) * norm.cdf((BEYOND - beyond) / (sigma + 0.03)))


def _shown(thing: Feature, lines: list[Feature], coverage: Mapping[int, Coverage]) -> float:
    """How many scans showed a pipe where an object sits on it; infinite for one that sits on none."""
    assert thing.point is not None
    shown = []
    for feature in lines:
        along, off = _place(feature, thing.point)
        low, high = coverage[feature.number].ends()
        if off < ON_AXIS and low - BEYOND < along < high + BEYOND:
            shown.append(coverage[feature.number].shown(along))
    return max(shown, default=np.inf)


def _without_doubles(lines: list[Feature], coverage: Mapping[int, Coverage]) -> list[Feature]:
    """Of lines that lie in each other the one seen more often."""
    kept: list[Feature] = []
    for feature in sorted(lines, key=lambda f: -f.sightings):
        assert feature.line is not None
        low, high = coverage[feature.number].ends()
        ends = feature.line.point + np.array([[low], [high]]) * feature.line.direction
        double = False
        for other in kept:
            assert other.line is not None
            along = other.line.along(ends)
            off = np.linalg.norm(ends - other.line.point - along[:, None] * other.line.direction, axis=1)
            first, last = coverage[other.number].ends()
            if off.max() < 0.08 and max(along.min(), first) - min(along.max(), last) < 0.3:
                double = True
        if not double:
            kept.append(feature)
    return sorted(kept, key=lambda f: f.number)


def _object(slam: StructureFilter, coverage: Mapping[int, Coverage], feature: Feature, record: ObjectRecord) -> MapObject:
    assert feature.point is not None
    part = slice(feature.at, feature.at + 3)
    pipes = leaving(slam, coverage, feature.point)
    record.ports = np.log(ports_likelihood(pipes, feature.sightings))
    beliefs = record.together()
    label = CLASSES[int(np.argmax(beliefs))]
    axis, branch = main_directions(pipes)
    handle = None
    if label in WITH_HANDLE and axis is not None and record.views:
        others = pipes[np.abs(pipes @ axis) < 0.5]
        handle = find_handle(np.concatenate([view.cloud for view in record.views]), feature.point, axis, others)
        if handle is not None and handle.is_open is not None and label == "3-way valve":
            handle = Handle(handle.stem, handle.lever, not handle.is_open)
    return MapObject(
        feature.number,
        feature.point,
        slam.covariance[part, part].copy(),
        beliefs,
        belief(record.evidence),
        record.semantic(),
        pipes,
        feature.sightings,
        _axes(axis, branch, None if handle is None else handle.stem),
        handle,
    )


def main_directions(pipes: Array) -> tuple[Array | None, Array | None]:
    """Of the pipes that leave an object (n, 3): the straight way, two in line where there are, and the one across it."""
    if not len(pipes):
        return None, None
    cosines = pipes @ pipes.T
    i, _ = np.unravel_index(int(np.argmin(cosines)), cosines.shape)
    axis = pipes[i]
    across = np.flatnonzero(np.abs(pipes @ axis) < 0.5)
    return axis, pipes[across[0]] if len(across) else None


def _axes(axis: Array | None, branch: Array | None, stem: Array | None) -> Array | None:
    """A frame (3, 3) of what is known; None where a pipe alone leaves the turn about it open."""
    if axis is None or (branch is None and stem is None):
        return None
    if branch is not None:
        y = branch - (branch @ axis) * axis
        y /= np.linalg.norm(y)
        z = np.cross(axis, y)
        if stem is not None and z @ stem < 0:
            axis, z = -axis, -z
        return np.column_stack([axis, y, z])
    assert stem is not None
    z = stem - (stem @ axis) * axis
    z /= np.linalg.norm(z)
    return np.column_stack([axis, np.cross(z, axis), z])
