"""The whole way once more, afterwards: the vehicle at every scan and every feature, by least squares over all that was seen.

A filter knows the past; here each pose is also told by what was seen later. Navigation between two scans enters as one factor
over both states, so that the system stays small: nine numbers a scan, four a pipe, three an object.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.linalg import splu

from estimators.structure.features import Line, Seen, observe_line, observe_point
from estimators.structure.jcbb import gate
from estimators.structure.slam import SlamSettings, StructureFilter
from estimators.structure.types import Array, Segment
from estimators.structure.vehicle import SIZE, SensorMount, sensor_pose, wrapped

Rows = NDArray[np.intp]
_ROUNDS = 4
_LOOSE = np.repeat([1.0, 0.3, 0.5], 3) ** 2
"""Variances of the state that a leg begins with: they are taken out again, and only keep the filter regular."""
_FLOOR = np.repeat([1e-10, 1e-12, 1e-10], 3)


@dataclass(frozen=True)
class Spot:
    """A point feature as one scan shows it: ``position`` (3,) in the sensor's frame with ``covariance`` (3, 3)."""

    position: Array
    covariance: Array


@dataclass(frozen=True)
class Leg:
    """What navigation says of two states (after, before): ``information`` (18, 18) and ``pull`` (18,) about ``reference``."""

    information: Array
    pull: Array
    reference: Array


class Between(StructureFilter):
    """Navigation between two scans by a filter that carries along the state that it began with."""

    def __init__(self, state: Array, mount: SensorMount, settings: SlamSettings) -> None:
        super().__init__(state[:3], state[3:6], mount, settings)
        self.restart(state)

    def restart(self, state: Array) -> None:
        """A leg begins in ``state`` (9,)."""
        self.vehicle, self._origin, self._moved = state.copy(), state.copy(), np.zeros(SIZE)
        prior = np.diag(_LOOSE)
        self.covariance = np.block([[prior, prior], [prior, prior]])

    def leg(self) -> Leg:
        """What has come since, without what was assumed."""
        information = np.linalg.inv(self.covariance + np.diag(np.concatenate([_FLOOR, np.zeros(SIZE)])))
        information = (information + information.T) / 2
        pull = information[:, SIZE:] @ self._moved
        information[SIZE:, SIZE:] -= np.diag(1.0 / _LOOSE)
        return Leg(information, pull, np.concatenate([self.vehicle, self._origin]))

    def _add(self, error: Array) -> None:
        super()._add(error)
        self._moved = self._moved + error[SIZE:]


@dataclass
class Way:
    """All that is smoothed: ``states`` (K, 9), the first where it began, then one for each scan; ``legs`` (K - 1) between them;
    for each of ``seen`` (K - 1) the features' numbers with what showed them. ``lines`` and ``points`` by number."""

    states: list[Array]
    legs: list[Leg]
    seen: list[list[tuple[int, Segment | Spot]]]
    lines: dict[int, Line]
    points: dict[int, Array]


def smoothed(way: Way, begin: Array, mount: SensorMount) -> Way:
    """The likeliest way and map. ``begin`` (9, 9) is the covariance of the first state. What fits badly counts little."""
    states = [state.copy() for state in way.states]
    lines, points = dict(way.lines), dict(way.points)
    at = dict.fromkeys((*lines, *points), 0)
    size = SIZE * len(states)
    for number in at:
        at[number], size = size, size + (4 if number in lines else 3)
    for _ in range(_ROUNDS):
        system = _System(size)
        first = np.arange(SIZE, dtype=np.intp)
        weight: Array = np.asarray(np.linalg.inv(begin), dtype=np.float64)
        system.add(first, weight, -weight @ _difference(states[0], way.states[0]))
        for k, leg in enumerate(way.legs, 1):
            rows = np.concatenate([SIZE * k + first, SIZE * (k - 1) + first])
            away = np.concatenate(
                [_difference(states[k], leg.reference[:SIZE]), _difference(states[k - 1], leg.reference[SIZE:])]
            )
            system.add(rows, leg.information, leg.pull - leg.information @ away)
        for k, observations in enumerate(way.seen, 1):
            pose = sensor_pose(states[k], mount)
            for number, observation in observations:
                if number not in at:
                    continue
                if isinstance(observation, Segment):
                    found = observe_line(lines[number], pose, observation)
                else:
                    found = observe_point(points[number], pose, observation.position, observation.covariance)
                rows = np.concatenate([SIZE * k + first, at[number] + np.arange(found.by_feature.shape[1])])
                system.add(rows, *_normal(found))
        step = system.solved()
        states = [_wrapped(state + step[SIZE * k : SIZE * (k + 1)]) for k, state in enumerate(states)]
        lines = {number: line.moved(step[at[number] : at[number] + 4]) for number, line in lines.items()}
        points = {number: point + step[at[number] : at[number] + 3] for number, point in points.items()}
        if np.abs(step).max() < 1e-6:
            break
    return Way(states, way.legs, way.seen, lines, points)


def _normal(found: Seen) -> tuple[Array, Array]:
    """Information and pull of one observation on vehicle and feature; one that fits badly weighs less (Cauchy)."""
    weight = np.linalg.inv(found.noise)
    squared = float(found.innovation @ weight @ found.innovation)
    weight = weight / (1.0 + squared / gate(len(found.innovation)))
    jacobian = np.hstack([found.by_vehicle, found.by_feature])
    return jacobian.T @ weight @ jacobian, jacobian.T @ weight @ found.innovation


class _System:
    """Normal equations, put together part by part."""

    def __init__(self, size: int) -> None:
        self._pull = np.zeros(size)
        self._parts: list[tuple[Rows, Rows, Array]] = []

    def add(self, where: Rows, information: Array, pull: Array) -> None:
        i, j = np.meshgrid(where, where, indexing="ij")
        self._parts.append((i.ravel(), j.ravel(), np.asarray(information, dtype=np.float64).ravel()))
        self._pull[where] += pull

    def solved(self) -> Array:
        size = len(self._pull)
        i, j, values = (np.concatenate(column) for column in zip(*self._parts, strict=True))
        matrix = coo_array((values, (i, j)), shape=(size, size)).tocsc()
        matrix.setdiag(matrix.diagonal() + 1e-9)
        return np.asarray(splu(matrix).solve(self._pull))


def _difference(state: Array, reference: Array) -> Array:
    return _wrapped(state - reference)


def _wrapped(state: Array) -> Array:
    state = state.copy()
    state[3:6] = wrapped(state[3:6])
    return state
