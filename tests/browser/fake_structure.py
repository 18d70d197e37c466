"""The chamber's part of the fake device: a scanner that goes around the paper's structure, and the map it leaves behind.

Each tick maps another pipe with what sits on it. ``prompts`` is a test's to set.
"""

from __future__ import annotations

import threading
from functools import cache
from typing import Any

from device.bus import Bus
from device.errors import Invalid, NotFound
from device.structure.as_json import truth_json
from device.structure.export import MIME, map_bytes
from drivers.virtual.chamber.structure import load_structure
from estimators.structure.types import CLASSES

Json = dict[str, Any]
TICK_S = 0.15


@cache
def whole_map() -> Json:
    """The paper's structure as the box would state it: object 3 may be another class, one connection is doubtful."""
    told = truth_json(load_structure())
    pipes = [
        {**pipe, "length_m": 1.0, "sigma_offset_m": 0.002, "sigma_turn_rad": 0.003, "sightings": 40} for pipe in told["pipes"]
    ]
    objects = []
    for thing in told["objects"]:
        belief = 0.62 if thing["number"] == 3 else 0.995
        beliefs = {label: belief if label == thing["class"] else round((1 - belief) / 5, 4) for label in CLASSES}
        on = [edge["pipe"] for edge in told["edges"] if edge["object"] == thing["number"]]
        objects.append(
            {
                **thing,
                "belief": belief,
                "beliefs": beliefs,
                "sigma_m": 0.004,
                "pipes": [],
                "lever": None,
                "sightings": 9 * len(on),
            }
        )
    edges = [
        {**edge, "along_m": 0.1 * edge["object"], "belief": 0.7 if edge["object"] == 20 else 0.99} for edge in told["edges"]
    ]
    return {"pipes": pipes, "objects": objects, "edges": edges}


def part_of(count: int) -> Json:
    """The map after ``count`` pipes have been seen."""
    whole = whole_map()
    pipes = whole["pipes"][:count]
    edges = [edge for edge in whole["edges"] if edge["pipe"] <= count]
    seen = {edge["object"] for edge in edges}
    objects = [thing for thing in whole["objects"] if thing["number"] in seen]
    unsure = [thing for thing in objects if thing["belief"] < 0.97]
    return {
        "pipes": pipes,
        "objects": objects,
        "edges": edges,
        "uncertain": [
            {
                "kind": "object",
                "object": one["number"],
                "pipe": None,
                "belief": one["belief"],
                "classes": [one["class"], "elbow"],
            }
            for one in unsure
        ]
        + [
            {"kind": "connection", "object": edge["object"], "pipe": edge["pipe"], "belief": edge["belief"], "classes": []}
            for edge in edges
            if edge["belief"] < 0.9
        ],
        "next_view": {
            "position": [2.4, 2.0, 3.6],
            "target": [0, 0, 4.4],
            "objects": [3],
            "prompt": "Look from 2.4 m north, 2.0 m east, 3.6 m deep: it would tell what object 3 is.",
        }
        if unsure
        else None,
        "track": [{"time_s": 2.0 * k, "position": [3.0 - 0.1 * k, 0.3 * k, 3.8]} for k in range(count + 1)],
        "consistent": True,
        "inconsistent_scans": 0,
        "warnings": ["The AHRS said nothing for 24 s."],
    }


class FakeStructure:
    """The facade of ``device.structure.desk.StructureDesk``."""

    def __init__(self, bus: Bus, first: int = 901) -> None:
        self._bus = bus
        self._next = first
        self._scans = 0
        self._state = "idle"
        self._survey: int | None = None
        self._node: int | None = None
        self._lock = threading.RLock()
        self._stop = threading.Event()
        self.prompts: list[Json] = []
        self.available = True
        self.maps: dict[int, Json] = {}
        threading.Thread(target=self._run, daemon=True).start()

    def close(self) -> None:
        self._stop.set()

    def state(self) -> Json:
        found = part_of(min(self._scans, 12))
        sensor = {
            "kind": "virtual",
            "state": "up",
            "age_s": 0.1,
            "message": "",
            "fps": 5.0,
            "frames": 9,
            "drops": 0,
            "reconnects": 0,
        }
        running = self._state != "idle"
        return {
            "available": self.available,
            "state": self._state,
            "survey_id": self._survey,
            "node_id": self._node,
            "seconds": 2.0 * self._scans,
            "scans": self._scans if running else 0,
            "dropped": 0,
            "late": 0,
            "position": found["track"][-1]["position"] if running else None,
            "sigma_m": 0.021 if running else None,
            "pipes": len(found["pipes"]) if running else 0,
            "objects": len(found["objects"]) if running else 0,
            "unsure": len(found["uncertain"]) if running else 0,
            "consistent": True,
            "sensors": [{"role": role, "name": role, **sensor} for role in ("scanner", "dvl", "pressure", "ahrs")],
            "prompts": self.prompts if running else [],
        }

    def begin(self, node_id: int | None = None) -> Json:
        with self._lock:
            self._survey, self._node, self._scans, self._state = self._next, node_id, 0, "waiting"
            self._next += 1
            return {"survey_id": self._survey}

    def end(self) -> Json:
        with self._lock:
            if self._survey is None:
                raise Invalid("No structure survey is under way.")
            ended = self._survey
            self.maps[ended] = self.map(ended) | {"state": "saved", "verdict": "accept", "prompts": []}
            self._over("saved", "")
            return {"survey_id": ended}

    def cancel(self) -> None:
        with self._lock:
            if self._survey is not None:
                self._over("", "The survey was cancelled.")

    def map(self, survey_id: int) -> Json:
        if survey_id in self.maps:
            return self.maps[survey_id]
        if survey_id != self._survey:
            raise NotFound(f"There is no structure survey number {survey_id}.")
        return {
            "survey_id": survey_id,
            "kind": "structure",
            "state": "measuring",
            "created": None,
            "clock_source": "none",
            "node": None if self._node is None else {"id": self._node, "name": "Pump station 4"},
            "settings": {"radius_m": 0.0315},
            "summary": {"scans": self._scans, "seconds": 2.0 * self._scans},
            **part_of(min(self._scans, 12)),
        }

    def file(self, survey_id: int, kind: str) -> tuple[bytes, str, str]:
        return map_bytes(self.map(survey_id), kind), f"structure_{survey_id}.{kind}", MIME[kind]

    def _over(self, stored: str, message: str) -> None:
        ended, self._survey, self._state = self._survey, None, "idle"
        self._bus.publish("structure", {**self.state(), "ended": ended, "stored": stored or None, "message": message})

    def _run(self) -> None:
        while not self._stop.wait(TICK_S):
            with self._lock:
                if self._survey is None:
                    continue
                self._scans, self._state = self._scans + 1, "scanning"
                self._bus.publish("structure", {**self.state(), "ended": None, "stored": None, "message": ""})
