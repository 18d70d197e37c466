"""How right a map is, against the truth of a virtual chamber (Tables 3 and 4 of the paper). Nothing here reaches the
estimate."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from device.structure.run import Run, VirtualChamber
from drivers.virtual.chamber.objects import CLASSES
from drivers.virtual.chamber.structure import Pipe, Structure
from estimators.structure.graph import MapPipe, StructureMap

Array = NDArray[np.float64]

OBJECT_M = 0.15
"""An object of the map further than this from every true one is none of them."""
PIPE_M = 0.10
STAGES = ("descriptor", "bayes", "semantic", "fused")


@dataclass(frozen=True)
class Matching:
    """True number of each pipe and object of the map, by their numbers there; what is missing is false."""

    pipes: dict[int, int]
    objects: dict[int, int]


def matching(found: StructureMap, truth: Structure) -> Matching:
    """Which true pipe and object each of the map is."""
    pipes = _paired(
        [[_pipe_distance(mine, true) for true in truth.runs] for mine in found.pipes], PIPE_M, [p.number for p in found.pipes]
    )
    objects = _paired(
        [[float(np.linalg.norm(mine.position - true.position)) for true in truth.objects] for mine in found.objects],
        OBJECT_M,
        [o.number for o in found.objects],
    )
    return Matching(pipes, objects)


def _pipe_distance(mine: MapPipe, true: Pipe) -> float:
    """The larger distance of the found ends from the true pipe between its ends."""
    axis = true.end - true.start
    along = np.clip((np.array([mine.start, mine.end]) - true.start) @ axis / (axis @ axis), 0.0, 1.0)
    return float(np.linalg.norm(np.array([mine.start, mine.end]) - true.start - along[:, None] * axis, axis=1).max())


def _paired(distances: Sequence[Sequence[float]], limit: float, numbers: Sequence[int]) -> dict[int, int]:
    if not distances or not distances[0]:
        return {}
    table = np.array(distances)
    rows, columns = linear_sum_assignment(np.minimum(table, 10 * limit))
    return {numbers[int(i)]: int(j) for i, j in zip(rows, columns, strict=True) if table[i, j] < limit}


def confusion_tables(run: Run, match: Matching, truth: Structure) -> dict[str, NDArray[np.int64]]:
    """For each stage the counts (6, 6) of actual by recognised class over all sightings of true objects."""
    tables = {stage: np.zeros((len(CLASSES), len(CLASSES)), dtype=np.int64) for stage in (*STAGES, "fused descriptor")}
    for result in run.results:
        for one in result.recognised:
            if one.number in match.objects:
                actual = CLASSES.index(truth.objects[match.objects[one.number]].label)
                tables["descriptor"][actual, one.descriptor] += 1
                tables["bayes"][actual, one.bayes] += 1
                tables["semantic"][actual, one.semantic] += 1
                tables["fused"][actual, one.fused] += 1
                tables["fused descriptor"][actual, one.fused_descriptor] += 1
    return tables


def accuracy(table: NDArray[np.int64]) -> float:
    """Share of sightings recognised rightly."""
    return float(np.trace(table) / table.sum()) if table.sum() else 0.0


def f1_scores(table: NDArray[np.int64]) -> Array:
    """F1 of each class (6,), nan where the class was neither there nor recognised."""
    right = np.diag(table)
    with np.errstate(invalid="ignore"):
        return np.asarray(2 * right / (table.sum(axis=0) + table.sum(axis=1)))


def mean_f1(table: NDArray[np.int64]) -> float:
    """Mean over the classes that were there."""
    there = table.sum(axis=1) > 0
    return float(f1_scores(table)[there].mean()) if there.any() else 0.0


def edge_f1(found: StructureMap, match: Matching, truth: Structure) -> float:
    """F1 of the connections; an edge of something false is false, one that is missing counts as missing."""
    true = {(edge.pipe, edge.object) for edge in truth.edges}
    mine = [(match.pipes.get(edge.pipe, -1), match.objects.get(edge.object, -1)) for edge in found.edges]
    right = len(true & set(mine))
    return 2 * right / (len(mine) + len(true)) if mine or true else 1.0


def errors(run: Run, chamber: VirtualChamber) -> dict[str, Any]:
    """Position errors of filter and dead reckoning at each scan (m), and the normalised squared error (NEES) of position."""
    true = chamber.path.pose(np.array(run.track.times)).position
    mine = np.array(run.track.states)[:, :3] - true
    reckoned = np.array(run.track.reckoned)[:, :3] - true
    nees = [float(e @ np.linalg.solve(c[:3, :3], e)) for e, c in zip(mine, run.track.covariances, strict=True)]
    return {"error": np.linalg.norm(mine, axis=1), "reckoned": np.linalg.norm(reckoned, axis=1), "nees": np.array(nees)}


def _away(run: Run, chamber: VirtualChamber, states: Sequence[Array]) -> Array:
    """Distances (K,) of the states at the scans from the true way."""
    true = chamber.path.pose(np.array(run.track.times)).position
    away: Array = np.linalg.norm(np.array(states)[:, :3] - true, axis=1)
    return away


def rms(values: Iterable[float]) -> float:
    """Root of the mean square."""
    return float(np.sqrt(np.mean(np.square(list(values)))))


def scores(run: Run, found: StructureMap, chamber: VirtualChamber, smoothed: Sequence[Array] | None = None) -> dict[str, Any]:
    """All scores of one run as plain numbers. ``smoothed`` (9,) are the states at the scans, worked out afterwards."""
    truth = chamber.structure
    match = matching(found, truth)
    tables = confusion_tables(run, match, truth)
    way = errors(run, chamber)
    objects = dict.fromkeys(("bayes", "semantic", "fused"), 0)
    for thing in found.objects:
        if thing.number in match.objects:
            actual = CLASSES.index(truth.objects[match.objects[thing.number]].label)
            objects["bayes"] += int(np.argmax(thing.bayes)) == actual
            objects["semantic"] += int(np.argmax(thing.semantic)) == actual
            objects["fused"] += thing.label == actual
    told = {stage: {"accuracy": accuracy(tables[stage]), "mean_f1": mean_f1(tables[stage])} for stage in tables}
    return {
        "recognition": {name.replace(" ", "_"): value for name, value in told.items()},
        "sightings": int(tables["descriptor"].sum()),
        "objects_right": objects,
        "pipes_found": len(match.pipes),
        "pipes_false": len(found.pipes) - len(match.pipes),
        "pipes_true": len(truth.runs),
        "objects_found": len(match.objects),
        "objects_false": len(found.objects) - len(match.objects),
        "objects_true": len(truth.objects),
        "edge_f1": edge_f1(found, match, truth),
        "position_rms_m": rms(way["error"]),
        "smoothed_rms_m": None if smoothed is None else rms(_away(run, chamber, smoothed)),
        "dead_reckoning_rms_m": rms(way["reckoned"]),
        "nees_mean": float(way["nees"].mean()),
    }
