"""What the page does with inspections: begin, join surveys to them, edit observations, compare, export. JSON-ready."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from datetime import datetime
from importlib.metadata import version
from typing import Any

from device.clock import Clock, iso
from device.errors import Invalid
from device.export.base import Options
from device.export.formats import NAMES, export
from device.inspections.assemble import assemble, observation_json, read_observations
from device.inspections.codes import codes
from device.inspections.compare import Thing, compare
from device.inspections.pipe_list import read_pipe_list
from device.inspections.rules import faults
from device.store import Store

_JSON = dict[str, Any]


class Desk:
    """Every method raises NotFound for a number that is not there, and Invalid with a sentence for what cannot be."""

    def __init__(self, store: Store, clock: Clock) -> None:
        self._store = store
        self._clock = clock

    def all(self, pipe_id: int | None = None) -> list[_JSON]:
        """Every inspection, or one pipe's, newest first, with the name of its pipe."""
        places = self._store.places
        names = {pipe["id"]: pipe["name"] for pipe in (*places.pipes(), *places.pipes(deleted=True))}
        return [{**one, "pipe": names.get(one["pipe_id"])} for one in self._store.inspections.all(pipe_id)]

    def begin(self, pipe_id: int, data: _JSON) -> _JSON:
        """A new inspection with every survey of its pipe, and of the chambers at its ends, that belongs to none yet."""
        pipe = self._store.places.pipe(pipe_id)
        number = self._store.inspections.begin(pipe_id, data)
        joined = {survey["survey_id"] for one in self._store.inspections.all(pipe_id) for survey in one["surveys"]}
        for survey in self._store.surveys.summaries(pipe_id, 1000, None):
            if survey["id"] not in joined:
                self._store.inspections.add_survey(number, survey["id"])
        chambers = self._store.structures.of_nodes(
            [node for node in (pipe["start_node"], pipe["end_node"]) if node is not None]
        )
        for chamber in chambers:
            if chamber not in joined:
                self._store.inspections.add_survey(number, chamber)
        return self.get(number)

    def get(self, number: int) -> _JSON:
        """One inspection as it would go out: facts, observations, and what the rules find wrong with them."""
        kept = self._store.inspections.get(number)
        inspection = assemble(self._store, number)
        stated = asdict(inspection)
        left_out = ("photos", "clouds", "landmarks", "observations", "structures")
        return {
            **kept,
            **{name: value for name, value in stated.items() if name not in left_out},
            "observations": [observation_json(one) for one in inspection.observations],
            "photos": [photo.name for photo in inspection.photos],
            "chambers": [_chamber(one) for one in inspection.structures],
            "faults": faults(inspection),
        }

    def update(self, number: int, data: _JSON) -> _JSON:
        """Change operator, date, direction, method, length or note."""
        self._store.inspections.update(number, data)
        return self.get(number)

    def delete(self, number: int) -> None:
        """Out of sight; ``restore`` brings it back. Its surveys stay."""
        self._store.inspections.delete(number)

    def restore(self, number: int) -> _JSON:
        """Undo ``delete``."""
        self._store.inspections.restore(number)
        return self.get(number)

    def join(self, number: int, survey_id: int, station_m: float | None) -> _JSON:
        """A survey belongs to it, made at a station where it looked at one place."""
        self._store.inspections.add_survey(number, survey_id, station_m)
        return self.get(number)

    def part(self, number: int, survey_id: int) -> _JSON:
        """A survey belongs to it no longer."""
        self._store.inspections.remove_survey(number, survey_id)
        return self.get(number)

    def edit(self, number: int, observations: list[_JSON], by: str) -> _JSON:
        """From now on these are the observations, put in order and numbered."""
        read = read_observations(observations)
        self._store.inspections.keep_observations(number, [observation_json(one) for one in read], by)
        return self.get(number)

    def undo(self, number: int) -> _JSON:
        """Take the last edit back."""
        if not self._store.inspections.undo(number):
            raise Invalid("Nobody has edited these observations: there is nothing to take back.")
        return self.get(number)

    def photo(self, number: int, name: str) -> bytes | None:
        """JPEG of one of its photos, None where there is none of that name."""
        found = assemble(self._store, number).photo(name)
        return None if found is None else found.jpeg

    def export(self, number: int, name: str, language: str, imperial: bool) -> tuple[bytes, str, str]:
        """(data, file name, MIME type) in one of ``device.export.formats.NAMES``."""
        if name not in NAMES:
            raise Invalid(f"There is no format {name}: there are {', '.join(NAMES)}.")
        return export(name, assemble(self._store, number), self.options(language, imperial))

    def options(self, language: str = "en", imperial: bool = False) -> Options:
        """Of an export made now by this program."""
        now = iso(self._clock.epoch_ms())
        made = None if now is None else datetime.fromisoformat(now).date()
        return Options(language, imperial, made, f"borescout {version('borescout')}")

    def compare(self, older: int, newer: int) -> _JSON:
        """What is new, gone, grown and the same between two inspections of one pipe."""
        first, second = (self._store.inspections.get(number) for number in (older, newer))
        if first["pipe_id"] != second["pipe_id"]:
            raise Invalid("These inspections are of different pipes: choose two of the same.")
        found = compare(assemble(self._store, older), assemble(self._store, newer))
        return {
            "older": older,
            "newer": newer,
            "new": [_thing(one) for one in found.new],
            "gone": [_thing(one) for one in found.gone],
            "grown": [[_thing(one) for one in pair] for pair in found.grown],
            "same": [[_thing(one) for one in pair] for pair in found.same],
        }

    def import_pipes(self, data: bytes, file_name: str, crs: int | None) -> _JSON:
        """Add the pipes of a list that are not there yet, with their nodes; what is there stays. How many of each."""
        listed = read_pipe_list(data, file_name)
        return self._store.places.add_all(listed, crs)

    @staticmethod
    def codes(language: str = "en") -> list[_JSON]:
        """The observation codes with their texts, for the page to choose from."""
        return [
            {
                "code": code.code,
                "text": code.text(language),
                "clock": code.clock,
                "unit": code.q1,
                "ch1": code.ch1,
                "ch2": code.ch2,
            }
            for code in codes().values()
        ]


def _chamber(one: Mapping[str, Any]) -> _JSON:
    """What the page says of a chamber; its own page shows the map."""
    node = one["node"]
    counts = {name: len(one[name]) for name in ("pipes", "objects", "edges")}
    return {
        "survey": one["survey_id"],
        "node": None if node is None else node["name"],
        "consistent": one["consistent"],
        **counts,
    }


def _thing(thing: Thing) -> _JSON:
    return {**observation_json(thing.observation), "extent_m": round(thing.extent, 2)}
