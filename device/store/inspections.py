"""Inspections: which surveys belong together, and the lists of observations that people edited."""

from __future__ import annotations

import json
import sqlite3
from datetime import datetime
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from device.clock import Clock, iso
from device.errors import Invalid, NotFound
from device.json_text import dumps
from device.store.database import Database
from device.store.places import checked

_FIELDS = ("operator", "date", "direction", "method", "length_m", "note")


def _date(text: str) -> str:
    datetime.fromisoformat(text)
    return text


class _Inspection(BaseModel):
    """An inspection as the operator describes it."""

    model_config = ConfigDict(extra="forbid")

    operator: Annotated[str, Field(max_length=40)] = ""
    date: Annotated[str, AfterValidator(_date)] | None = None
    direction: Literal["downstream", "upstream"] = "downstream"
    method: Literal["crawler", "rod", "pushrod", "manhole"] = "crawler"
    length_m: Annotated[float, Field(gt=0, lt=1000, allow_inf_nan=False)] | None = None
    note: Annotated[str, Field(max_length=2000)] = ""


class Inspections:
    """Queries on inspections. Everything returned is JSON-ready; whatever is written is on the disk when a method returns."""

    def __init__(self, database: Database, clock: Clock) -> None:
        self._database = database
        self._clock = clock

    def begin(self, pipe_id: int, data: dict[str, Any]) -> int:
        """A new inspection of a pipe; its number. Raises Invalid."""
        given = checked(_Inspection, data)
        clock = self._clock
        try:
            with self._database.write() as connection:
                number = connection.execute(
                    "INSERT INTO inspections (pipe_id, operator, date, direction, method, length_m, note, created_ms,"
                    " clock_source, boot_id, monotonic_ns) VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
                    (
                        pipe_id,
                        *(getattr(given, name) for name in _FIELDS),
                        clock.epoch_ms(),
                        clock.source,
                        clock.boot_id,
                        clock.monotonic_ns(),
                    ),
                ).lastrowid
        except sqlite3.IntegrityError:
            raise Invalid(f"There is no pipe number {pipe_id}.") from None
        assert number is not None  # sqlite gives every inserted row a number
        return number

    def update(self, number: int, data: dict[str, Any]) -> dict[str, Any]:
        """Change the fields in ``data``, keep the others. Raises NotFound, Invalid."""
        before = self.get(number)
        given = checked(_Inspection, {**{name: before[name] for name in _FIELDS}, **data})
        with self._database.write() as connection:
            connection.execute(
                f"UPDATE inspections SET {', '.join(f'{name} = ?' for name in _FIELDS)} WHERE id = ?",
                (*(getattr(given, name) for name in _FIELDS), number),
            )
        return self.get(number)

    def add_survey(self, number: int, survey_id: int, station_m: float | None = None) -> None:
        """A survey belongs to an inspection. Raises NotFound."""
        self.get(number)
        try:
            with self._database.write() as connection:
                connection.execute(
                    "INSERT INTO inspection_surveys (inspection_id, survey_id, station_m) VALUES (?, ?, ?)"
                    " ON CONFLICT (inspection_id, survey_id) DO UPDATE SET station_m = excluded.station_m",
                    (number, survey_id, station_m),
                )
        except sqlite3.IntegrityError:
            raise NotFound(f"There is no survey number {survey_id}.") from None

    def remove_survey(self, number: int, survey_id: int) -> None:
        """It belongs to it no longer; the survey itself stays. Raises NotFound."""
        self.get(number)
        with self._database.write() as connection:
            connection.execute("DELETE FROM inspection_surveys WHERE inspection_id = ? AND survey_id = ?", (number, survey_id))

    def get(self, number: int) -> dict[str, Any]:
        """One inspection with its surveys, ``edited`` telling whether somebody edited its observations. Raises NotFound."""
        with self._database.read() as connection:
            row = connection.execute("SELECT * FROM inspections WHERE id = ? AND NOT deleted", (number,)).fetchone()
            if row is None:
                raise NotFound(f"There is no inspection number {number}.")
            surveys = connection.execute(
                "SELECT survey_id, station_m, kind FROM inspection_surveys JOIN surveys ON surveys.id = survey_id"
                " WHERE inspection_id = ? AND NOT surveys.deleted ORDER BY survey_id",
                (number,),
            ).fetchall()
            edited = connection.execute("SELECT 1 FROM observation_lists WHERE inspection_id = ?", (number,)).fetchone()
        return {
            "id": number,
            "pipe_id": row["pipe_id"],
            **{name: row[name] for name in _FIELDS},
            "created": iso(row["created_ms"]),
            "clock_source": row["clock_source"],
            "surveys": [dict(survey) for survey in surveys],
            "edited": edited is not None,
        }

    def all(self, pipe_id: int | None = None) -> list[dict[str, Any]]:
        """Every inspection, or those of one pipe, newest first."""
        with self._database.read() as connection:
            rows = connection.execute(
                "SELECT id FROM inspections WHERE NOT deleted AND (:pipe IS NULL OR pipe_id = :pipe) ORDER BY id DESC",
                {"pipe": pipe_id},
            ).fetchall()
        return [self.get(row["id"]) for row in rows]

    def delete(self, number: int) -> None:
        """Out of sight, but for ``restore``; its surveys stay. Raises NotFound."""
        self.get(number)
        self._mark(number, 1)

    def restore(self, number: int) -> dict[str, Any]:
        """Undo ``delete``. Raises NotFound."""
        self._mark(number, 0)
        return self.get(number)

    def keep_observations(self, number: int, observations: list[dict[str, Any]], by: str) -> None:
        """From now on these are the observations; what was before is kept for ``undo``. Raises NotFound."""
        self.get(number)
        with self._database.write() as connection:
            connection.execute(
                "INSERT INTO observation_lists (inspection_id, body, by_whom, created_ms, clock_source) VALUES (?, ?, ?, ?, ?)",
                (number, dumps(observations), by, self._clock.epoch_ms(), self._clock.source),
            )

    def observations(self, number: int) -> list[dict[str, Any]] | None:
        """The list that somebody edited last; None where nobody has."""
        with self._database.read() as connection:
            row = connection.execute(
                "SELECT body FROM observation_lists WHERE inspection_id = ? ORDER BY id DESC LIMIT 1", (number,)
            ).fetchone()
        found: list[dict[str, Any]] | None = None if row is None else json.loads(row["body"])
        return found

    def undo(self, number: int) -> bool:
        """Take the last edit of the observations back; False where there was none."""
        self.get(number)
        with self._database.write() as connection:
            return bool(
                connection.execute(
                    "DELETE FROM observation_lists WHERE id = (SELECT max(id) FROM observation_lists WHERE inspection_id = ?)",
                    (number,),
                ).rowcount
            )

    def keep_photo(self, number: int, name: str, jpeg: bytes) -> None:
        """A photo that belongs to no survey, by its name. Raises NotFound."""
        self.get(number)
        with self._database.write() as connection:
            connection.execute(
                "INSERT INTO inspection_photos (inspection_id, name, jpeg) VALUES (?, ?, ?)"
                " ON CONFLICT (inspection_id, name) DO UPDATE SET jpeg = excluded.jpeg",
                (number, name, jpeg),
            )

    def photos(self, number: int) -> dict[str, bytes]:
        """The photos that belong to no survey, by name."""
        with self._database.read() as connection:
            rows = connection.execute(
                "SELECT name, jpeg FROM inspection_photos WHERE inspection_id = ? ORDER BY name", (number,)
            ).fetchall()
        return {row["name"]: row["jpeg"] for row in rows}

    def _mark(self, number: int, deleted: int) -> None:
        with self._database.write() as connection:
            found = connection.execute("UPDATE inspections SET deleted = ? WHERE id = ?", (deleted, number)).rowcount
        if not found:
            raise NotFound(f"There is no inspection number {number}.")
