"""What a structure survey tells while it goes on and when it ends: map, track, what is uncertain, where to look next."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from device.structure.as_json import map_json, suggestion_json
from estimators.structure.graph import StructureMap
from estimators.structure.mapper import StructureMapper
from estimators.structure.next_view import SURE, next_view
from estimators.structure.types import CLASSES

SURE_EDGE = 0.9
CONTRADICTED = 0.2
"""Share of scans that do not fit the map beyond which nobody should rely on it."""


def consistent(mapper: StructureMapper) -> bool:
    """Whether the scans have fitted the map that was made of them."""
    return not mapper.lost and mapper.inconsistent < CONTRADICTED * max(mapper.scans, 1)


def uncertain(found: StructureMap) -> list[dict[str, Any]]:
    """What should be looked at again: objects with their two likeliest classes, and connections; the most doubtful first."""
    objects = [
        {
            "kind": "object",
            "object": thing.number,
            "pipe": None,
            "belief": round(float(thing.beliefs.max()), 4),
            "classes": [CLASSES[k] for k in np.argsort(thing.beliefs)[::-1][:2]],
        }
        for thing in found.objects
        if thing.beliefs.max() < SURE
    ]
    edges = [
        {
            "kind": "connection",
            "object": edge.object,
            "pipe": edge.pipe,
            "belief": round(edge.belief, 4),
            "classes": [],
        }
        for edge in found.edges
        if edge.belief < SURE_EDGE
    ]
    return sorted([*objects, *edges], key=lambda one: float(one["belief"]))


def told(mapper: StructureMapper, found: StructureMap, times: list[float], states: list[NDArray[np.float64]]) -> dict[str, Any]:
    """Everything of one survey, JSON-ready. ``states`` (9,) of the vehicle at each of ``times`` (s)."""
    depths = [float(state[2]) for state in states]
    seen = {number: record.seen_from for number, record in mapper.objects.items()}
    views = mapper.knowledge.views
    suggestion = next_view(found.objects, seen, views, min(depths), max(depths)) if depths else None
    return {
        **map_json(found),
        "uncertain": uncertain(found),
        "next_view": None if suggestion is None else suggestion_json(suggestion),
        "scans": mapper.scans,
        "consistent": consistent(mapper),
        "inconsistent_scans": mapper.inconsistent,
        "refused_readings": mapper.refused,
        "track": [
            {"time_s": round(t, 3), "position": [round(float(x), 4) for x in state[:3]]}
            for t, state in zip(times, states, strict=True)
        ],
    }
