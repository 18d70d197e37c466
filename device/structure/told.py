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
CONTRADICTED = 0.1
"""Share of scans that do not fit the map beyond which nobody should rely on it."""
FEW_SCANS = 2
"""So many scans may always be strange."""
DISPLACED_M = 0.2
"""A scan that fits only so far from where navigation has the vehicle: one of both is wrong, or the structure was moved."""
BESIDE = 0.08
"""Share of observations that fit none of the known features near them; pipes and objects as they are seen come to 0.02 to 0.05.
"""
REFUSED = 0.05
"""Share of refused readings of the navigation."""
SILENT_S = {"velocity": ("DVL", 30.0), "attitude": ("AHRS", 2.0), "depth": ("pressure sensor", 20.0)}
"""How long a sensor may be silent without a word."""
BLIND_S = 20.0
"""How long the AHRS may be silent: scans then tell how the vehicle turns, and where few are seen it turns astray unnoticed."""


def consistent(mapper: StructureMapper) -> bool:
    """Whether the scans have fitted the map that was made of them, and the navigation."""
    return not contradictions(mapper)


def contradictions(mapper: StructureMapper) -> list[str]:
    """Why nobody should rely on the map; nothing where it can be relied on."""
    doubts, found = mapper.doubts, []
    if mapper.lost:
        found.append("The last scans fit nowhere in the map: the position is lost.")
    if doubts.unexpected > max(FEW_SCANS, CONTRADICTED * mapper.scans):
        found.append(f"{doubts.unexpected} of {mapper.scans} scans did not fit where navigation had the scanner.")
    if doubts.furthest > DISPLACED_M:
        found.append(
            f"Scans and navigation are {doubts.furthest:.2f} m apart: the structure was moved, or the scanner was and nobody "
            "noticed."
        )
    unturned = doubts.silence("attitude", mapper.time_s)
    if unturned > BLIND_S:
        found.append(f"Nothing but the scans told for {unturned:.0f} s how the scanner was turned.")
    return found


def warnings(mapper: StructureMapper) -> list[str]:
    """What speaks against the map, what makes it useless first."""
    doubts, found = mapper.doubts, contradictions(mapper)
    if doubts.beside > BESIDE * doubts.near:
        share = 100 * doubts.beside / doubts.near
        found.append(f"{share:.0f} % of what was seen lies beside the pipes and objects of the map: things may be missing.")
    if doubts.refused > REFUSED * doubts.readings:
        found.append(f"{doubts.refused} of {doubts.readings} readings of the navigation contradict the others.")
    for what, (name, limit) in SILENT_S.items():
        silent = doubts.silence(what, mapper.time_s)
        if silent > limit:
            found.append(f"The {name} said nothing for {silent:.0f} s.")
    return found


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
        "inconsistent_scans": mapper.doubts.unexpected,
        "refused_readings": mapper.doubts.refused,
        "warnings": warnings(mapper),
        "track": [
            {"time_s": round(t, 3), "position": [round(float(x), 4) for x in state[:3]]}
            for t, state in zip(times, states, strict=True)
        ],
    }
