"""Who is who: landmarks that were mapped twice (on the way back, or over a slip), and laterals known by their class."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from estimators.landmarks.smoothing.types import Array, Lateral, Run, Smoothed, SmoothedLandmark

GATE_2 = 9.21
"""Chi square of two degrees of freedom, 99 %."""
GATE_1 = 6.63
"""Chi square of one degree of freedom, 99 %."""
SIZE, TURN = 0.05, 0.1
"""Two sightings of one thing may lie so far apart (m, rad) on it."""
MOST = 0.6
"""Two landmarks further apart (m) than this are two, however uncertain either is."""


def find_doubles(run: Run, smoothed: Smoothed) -> dict[int, int]:
    """Which landmark (id) is which other one: same class, and within the uncertainty of both at the same place; the one with
    more sightings stays. Two that were seen in one frame are two.

    The errors of two landmarks of one run are largely common, so the gate is wide; where several fit, the nearest does.
    """
    frames = {mark.id: set(run.sightings.frame[run.sightings.landmark == mark.id].tolist()) for mark in smoothed.landmarks}
    pairs = []
    for i, one in enumerate(smoothed.landmarks):
        for other in smoothed.landmarks[i + 1 :]:
            if run.labels.get(one.id) != run.labels.get(other.id) or frames[one.id] & frames[other.id]:
                continue
            distance = _distance2(one, other)
            if distance < GATE_2 and abs(one.chainage - other.chainage) < MOST:
                stays, goes = (one, other) if one.sightings >= other.sightings else (other, one)
                pairs.append((distance, goes.id, stays.id))
    same: dict[int, int] = {}
    for _, goes_id, stays_id in sorted(pairs):
        goes_id, stays_id = _last(same, goes_id), _last(same, stays_id)
        if goes_id == stays_id or frames[goes_id] & frames[stays_id]:
            continue
        same[goes_id] = stays_id
        frames[stays_id] |= frames[goes_id]
    return {double: _last(same, double) for double in same}


def merged(run: Run, same: Mapping[int, int]) -> Run:
    """The run with the sightings of each double given to its landmark: where the crawler drove back, this closes the loop."""
    if not same:
        return run
    ids = run.sightings.landmark.copy()
    for double, landmark in same.items():
        ids[run.sightings.landmark == double] = landmark
    labels = {name: label for name, label in run.labels.items() if name not in same}
    return replace(run, sightings=replace(run.sightings, landmark=ids), labels=labels)


def identified(laterals: tuple[Lateral, ...], run: Run, smoothed: Smoothed) -> tuple[Lateral, ...]:
    """The laterals that are in this run, each with its landmark's id. One known by its class goes to the landmark of that class
    it fits best, no two to the same; one that fits none (99 %) is left out."""
    given = [lateral for lateral in laterals if lateral.landmark is not None]
    open_ = [lateral for lateral in laterals if lateral.landmark is None and lateral.label is not None]
    taken = {lateral.landmark for lateral in given}
    marks = [mark for mark in smoothed.landmarks if mark.id not in taken]
    if not open_ or not marks:
        return tuple(given)
    cost = np.full((len(open_), len(marks)), 1e6)
    for i, lateral in enumerate(open_):
        for j, mark in enumerate(marks):
            variance = mark.covariance[0, 0] + lateral.std**2 + SIZE**2
            distance = (mark.chainage - lateral.chainage) ** 2 / variance
            if run.labels.get(mark.id) == lateral.label and distance < GATE_1:
                cost[i, j] = distance + np.log(variance)
    rows, columns = linear_sum_assignment(cost)
    found = [replace(open_[i], landmark=marks[j].id) for i, j in zip(rows, columns, strict=True) if cost[i, j] < 1e6]
    return (*given, *found)


def _distance2(one: SmoothedLandmark, other: SmoothedLandmark) -> float:
    turn = float(np.angle(np.exp(1j * (one.angle - other.angle))))
    apart: Array = np.array([one.chainage - other.chainage, turn])
    spread = one.covariance + other.covariance + np.diag([SIZE**2, TURN**2])
    return float(apart @ np.linalg.solve(spread, apart))


def _last(same: Mapping[int, int], name: int) -> int:
    while name in same:
        name = same[name]
    return name
