"""The semantic map as plain values: what ``borescout structure --json`` prints, the page draws and the exports write."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.virtual.chamber.structure import Structure
from estimators.structure.graph import MapObject, MapPipe, StructureMap
from estimators.structure.next_view import Suggestion
from estimators.structure.types import CLASSES

Array = NDArray[np.float64]


def pipe_json(pipe: MapPipe) -> dict[str, Any]:
    """One pipe."""
    sigma = np.sqrt(np.diag(pipe.covariance))
    return {
        "number": pipe.number,
        "from": _rounded(pipe.start),
        "to": _rounded(pipe.end),
        "radius_m": pipe.radius,
        "length_m": round(float(np.linalg.norm(pipe.end - pipe.start)), 4),
        "sigma_offset_m": round(float(sigma[:2].max()), 5),
        "sigma_turn_rad": round(float(sigma[2:].max()), 5),
        "sightings": pipe.sightings,
    }


def object_json(thing: MapObject) -> dict[str, Any]:
    """One object, with the belief of each class."""
    told = {
        "number": thing.number,
        "class": CLASSES[thing.label],
        "position": _rounded(thing.position),
        "sigma_m": round(float(np.sqrt(np.trace(thing.covariance) / 3)), 5),
        "beliefs": {label: round(float(b), 4) for label, b in zip(CLASSES, thing.beliefs, strict=True)},
        "belief": round(float(thing.beliefs.max()), 4),
        "pipes": [_rounded(pipe) for pipe in thing.pipes],
        "orientation": None if thing.orientation is None else [_rounded(axis) for axis in thing.orientation.T],
        "sightings": thing.sightings,
        "handle": None,
        "lever": None,
        "open": None,
    }
    if thing.handle is not None:
        told["handle"] = _rounded(thing.handle.stem)
        told["lever"] = None if thing.handle.lever is None else _rounded(thing.handle.lever)
        told["open"] = thing.handle.is_open
    return told


def map_json(found: StructureMap) -> dict[str, Any]:
    """Pipes, objects and edges."""
    return {
        "pipes": [pipe_json(pipe) for pipe in found.pipes],
        "objects": [object_json(thing) for thing in found.objects],
        "edges": [
            {
                "pipe": edge.pipe,
                "object": edge.object,
                "kind": edge.kind,
                "along_m": round(edge.along, 4),
                "belief": round(edge.belief, 4),
            }
            for edge in found.edges
        ],
    }


def suggestion_json(suggestion: Suggestion) -> dict[str, Any]:
    """Where to look next, with the sentence of the prompt."""
    numbers = [str(number) for number in suggestion.objects]
    things = f"object {numbers[0]} is" if len(numbers) == 1 else f"objects {', '.join(numbers[:-1])} and {numbers[-1]} are"
    north, east, down = (f"{metres:.1f} m" for metres in suggestion.position)
    return {
        "position": _rounded(suggestion.position),
        "target": _rounded(suggestion.target),
        "objects": list(suggestion.objects),
        "prompt": f"Look from {north} north, {east} east, {down} deep: it would tell what {things}.",
    }


def truth_json(truth: Structure) -> dict[str, Any]:
    """The true map of a virtual chamber in the same words; its numbers count from 1."""
    return {
        "pipes": [
            {"number": n, "from": _rounded(run.start), "to": _rounded(run.end), "radius_m": run.radius}
            for n, run in enumerate(truth.runs, 1)
        ],
        "objects": [
            {
                "number": n,
                "class": thing.label,
                "position": _rounded(thing.position),
                "orientation": [_rounded(axis) for axis in thing.rotation.T],
                "handle": None if thing.handle is None else _rounded(thing.handle),
                "open": thing.is_open,
            }
            for n, thing in enumerate(truth.objects, 1)
        ],
        "edges": [{"pipe": e.pipe + 1, "object": e.object + 1, "kind": e.kind} for e in truth.edges],
    }


def _rounded(vector: Array) -> list[float]:
    return [round(float(x), 4) for x in vector]
