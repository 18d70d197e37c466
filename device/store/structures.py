"""Structure surveys: the semantic map of a chamber, as it stood after its newest scan."""

from __future__ import annotations

import json
import sqlite3
import zlib
from typing import Any

from device.clock import Clock, iso
from device.errors import NotFound
from device.json_text import dumps
from device.store.database import Database
from device.store.surveys import begin_survey, forget_survey, interrupt_unfinished, leave_in, survey_row

KIND = "structure"
_NO_SCAN = "EXISTS (SELECT 1 FROM structures WHERE survey_id = surveys.id AND map IS NULL)"
EMPTY: dict[str, Any] = {
    "pipes": [],
    "objects": [],
    "edges": [],
    "uncertain": [],
    "next_view": None,
    "track": [],
    "consistent": True,
}
"""The map before the first scan."""


class Structures:
    """Queries on structure surveys. Everything returned is JSON-ready; what is written is on the disk when a method returns."""

    def __init__(self, database: Database, clock: Clock) -> None:
        self._database = database
        self._clock = clock

    def begin(self, node_id: int | None, settings: dict[str, Any]) -> int:
        """A new survey in the state "measuring"; its number. Raises NotFound for a node that is not there."""
        with self._database.write() as connection:
            if node_id is not None and not connection.execute("SELECT 1 FROM nodes WHERE id = ?", (node_id,)).fetchone():
                raise NotFound(f"There is no node number {node_id}.")
            number = begin_survey(connection, self._clock, KIND, None)
            connection.execute(
                "INSERT INTO structures (survey_id, node_id, settings) VALUES (?, ?, ?)", (number, node_id, dumps(settings))
            )
        return number

    def keep(self, survey_id: int, found: dict[str, Any], summary: dict[str, Any], state: str | None = None) -> None:
        """The map as it stands and, with ``state``, leave the survey in that state. Raises StorageFull."""
        packed = zlib.compress(dumps(found).encode(), 6)
        with self._database.write() as connection:
            _structure(connection, survey_id)
            connection.execute(
                "UPDATE structures SET map = ?, summary = ? WHERE survey_id = ?", (packed, dumps(summary), survey_id)
            )
            if state is not None:
                leave_in(connection, survey_id, state)

    def forget(self, survey_id: int) -> None:
        """A survey that was cancelled disappears."""
        with self._database.write() as connection:
            forget_survey(connection, survey_id)

    def interrupt_unfinished(self) -> int:
        """What a power cut left in the state "measuring" is kept as far as it went; what had no scan yet goes. How many."""
        with self._database.write() as connection:
            return interrupt_unfinished(connection, KIND, _NO_SCAN)

    def map(self, survey_id: int) -> dict[str, Any]:
        """The map of one survey, see ``web_ui.openapi``. Raises NotFound."""
        with self._database.read() as connection:
            survey, structure = survey_row(connection, survey_id), _structure(connection, survey_id)
            node = connection.execute("SELECT id, name FROM nodes WHERE id = ?", (structure["node_id"],)).fetchone()
        found = EMPTY if structure["map"] is None else json.loads(zlib.decompress(structure["map"]))
        return {
            "survey_id": survey_id,
            "kind": KIND,
            "state": survey["state"],
            "created": iso(survey["created_ms"]),
            "clock_source": survey["clock_source"],
            "node": None if node is None else dict(node),
            "settings": json.loads(structure["settings"]),
            "summary": json.loads(structure["summary"]),
            **found,
        }

    def of_nodes(self, nodes: list[int]) -> list[int]:
        """Numbers of the finished surveys of these nodes, oldest first."""
        marks = ", ".join("?" * len(nodes))
        with self._database.read() as connection:
            rows = connection.execute(
                "SELECT survey_id FROM structures JOIN surveys ON surveys.id = survey_id"
                f" WHERE node_id IN ({marks}) AND NOT surveys.deleted AND state <> 'measuring' ORDER BY survey_id",
                nodes,
            ).fetchall()
        return [int(row["survey_id"]) for row in rows]


def _structure(connection: sqlite3.Connection, survey_id: int) -> sqlite3.Row:
    row: sqlite3.Row | None = connection.execute("SELECT * FROM structures WHERE survey_id = ?", (survey_id,)).fetchone()
    if row is None:
        raise NotFound(f"There is no structure survey number {survey_id}.")
    return row
