"""Two inspections of one pipe: what is new, what is gone, what grew."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from device.inspections.model import Inspection, Observation

SAME_M = 0.5
"""Stations of one thing from two inspections: two tethers, two zeros."""
SAME_HOURS = 2
_GREW_M = 0.5
_GREW = 1.2
_FAR = 1e6
_MARKS = ("BCD", "BCE", "BDB", "BDC", "BDD")


@dataclass(frozen=True)
class Thing:
    """An observation with its extent along the pipe (m), the two ends of a continuous one taken together."""

    observation: Observation
    extent: float


@dataclass(frozen=True)
class Comparison:
    """``same`` and ``grown`` pair the older with the newer."""

    new: tuple[Thing, ...]
    gone: tuple[Thing, ...]
    same: tuple[tuple[Thing, Thing], ...]
    grown: tuple[tuple[Thing, Thing], ...]


def compare(older: Inspection, newer: Inspection) -> Comparison:
    """Things of the same code are paired so that their stations and clock positions agree best, none further apart than SAME_M
    and SAME_HOURS. An inspection from the other end is turned round first, where the pipe's length is known."""
    first, second = things(older), things(newer, turned=newer.direction != older.direction)
    cost = np.array([[_distance(a, b) for b in second] for a in first]).reshape(len(first), len(second))
    pairs = [(i, j) for i, j in zip(*linear_sum_assignment(cost), strict=True) if cost[i, j] < _FAR]
    matched = [(first[i], second[j]) for i, j in pairs]
    left, right = {i for i, _ in pairs}, {j for _, j in pairs}
    return Comparison(
        tuple(thing for j, thing in enumerate(second) if j not in right),
        tuple(thing for i, thing in enumerate(first) if i not in left),
        tuple(pair for pair in matched if not _grew(*pair)),
        tuple(pair for pair in matched if _grew(*pair)),
    )


def things(inspection: Inspection, turned: bool = False) -> list[Thing]:
    """What lies in the pipe, without its ends and without remarks."""
    length = inspection.pipe.length or inspection.length
    ends = {one.continuous[1:]: one.station for one in inspection.observations if one.continuous.startswith("B")}
    found = []
    for one in inspection.observations:
        if one.code in _MARKS or one.continuous.startswith("B"):
            continue
        extent = max(ends.get(one.continuous[1:], one.station) - one.station, 0.0) if one.continuous else 0.0
        if turned and length is not None:
            one = _turned(one, length, extent)
        found.append(Thing(one, extent))
    return found


def _turned(one: Observation, length: float, extent: float) -> Observation:
    return replace(
        one, station=length - one.station - extent, clock_from=_mirrored(one.clock_from), clock_to=_mirrored(one.clock_to)
    )


def _mirrored(hour: int | None) -> int | None:
    """Left is right when one looks from the other end."""
    return None if hour is None else (12 - hour) % 12 or 12


def _distance(a: Thing, b: Thing) -> float:
    if a.observation.code != b.observation.code:
        return _FAR
    apart = _apart((a.observation.station, a.extent), (b.observation.station, b.extent))
    hours = 0
    if a.observation.clock_from is not None and b.observation.clock_from is not None:
        difference = abs(a.observation.clock_from - b.observation.clock_from)
        hours = min(difference, 12 - difference)
    return _FAR if apart > SAME_M or hours > SAME_HOURS else apart / SAME_M + hours / SAME_HOURS


def _apart(a: tuple[float, float], b: tuple[float, float]) -> float:
    """Metres between two stretches, 0 where they overlap; between two points, their distance."""
    return max(b[0] - (a[0] + a[1]), a[0] - (b[0] + b[1]), 0.0)


def _grew(a: Thing, b: Thing) -> bool:
    before, now = a.observation.q1, b.observation.q1
    wider = before is not None and now is not None and now > _GREW * before
    return wider or b.extent > a.extent + _GREW_M
