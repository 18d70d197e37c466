"""Drives of the landmarks survey: landmarks as they are found, what was said of them, faults, and the log to map them again."""

from __future__ import annotations

import json
import sqlite3
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from device.clock import Clock, iso
from device.errors import NotFound
from device.json_text import dumps
from device.store.database import Database
from device.store.places import pipe_json
from device.store.surveys import begin_survey, forget_survey, interrupt_unfinished, leave_in, survey_row

KIND = "landmarks"
CORRECTABLE = ("class", "chainage_m", "clock")
_NOTHING_SEEN = (
    "NOT EXISTS (SELECT 1 FROM landmarks WHERE survey_id = surveys.id)"
    " AND NOT EXISTS (SELECT 1 FROM drive_log WHERE survey_id = surveys.id)"
)
_SAID = ("decision", *CORRECTABLE, "note")


@dataclass(frozen=True)
class KeptLandmark:
    """One landmark as the survey states it: ``measured`` is its JSON without what people said; ``thumbnail`` JPEG, None for
    the one that is kept already."""

    number: int
    measured: dict[str, Any]
    thumbnail: bytes | None = None


@dataclass(frozen=True)
class Kept:
    """What has come since the last time. None leaves what is there; ``gone`` are numbers that were doubles of others."""

    landmarks: Sequence[KeptLandmark] = ()
    gone: Sequence[int] = ()
    rings: Sequence[dict[str, Any]] | None = None
    faults: Sequence[dict[str, Any]] = ()
    log: Sequence[Any] = ()
    summary: dict[str, Any] = field(default_factory=dict)


class Drives:
    """Queries on drives. Everything returned is JSON-ready; whatever is written is on the disk when a method returns."""

    def __init__(self, database: Database, clock: Clock) -> None:
        self._database = database
        self._clock = clock

    def begin(self, pipe_id: int | None, settings: dict[str, Any]) -> int:
        """A new drive in the state "measuring"; its survey's number."""
        with self._database.write() as connection:
            number = begin_survey(connection, self._clock, KIND, pipe_id)
            connection.execute("INSERT INTO drives (survey_id, settings) VALUES (?, ?)", (number, dumps(settings)))
        return number

    def keep(self, survey_id: int, kept: Kept, state: str | None = None) -> None:
        """Add what has come and, with ``state``, leave the survey in that state: all of it or nothing. Raises StorageFull."""
        with self._database.write() as connection:
            _drive(connection, survey_id)
            for landmark in kept.landmarks:
                connection.execute(
                    "INSERT INTO landmarks (survey_id, number, measured, thumbnail) VALUES (?, ?, ?, ?)"
                    " ON CONFLICT (survey_id, number) DO UPDATE SET measured = excluded.measured,"
                    " thumbnail = coalesce(excluded.thumbnail, thumbnail)",
                    (survey_id, landmark.number, dumps(landmark.measured), landmark.thumbnail),
                )
            connection.executemany(
                "DELETE FROM landmarks WHERE survey_id = ? AND number = ?"
                " AND NOT EXISTS (SELECT 1 FROM landmark_words AS w WHERE w.survey_id = landmarks.survey_id"
                " AND w.number = landmarks.number)",  # what somebody has spoken of never disappears
                [(survey_id, number) for number in kept.gone],
            )
            connection.executemany(
                "INSERT INTO drive_faults (survey_id, body) VALUES (?, ?)", [(survey_id, dumps(fault)) for fault in kept.faults]
            )
            if kept.log:
                chunk = zlib.compress(dumps(list(kept.log)).encode(), 6)
                connection.execute("INSERT INTO drive_log (survey_id, chunk) VALUES (?, ?)", (survey_id, chunk))
            if kept.rings is not None:
                connection.execute("UPDATE drives SET rings = ? WHERE survey_id = ?", (dumps(list(kept.rings)), survey_id))
            if kept.summary:
                connection.execute("UPDATE drives SET summary = ? WHERE survey_id = ?", (dumps(kept.summary), survey_id))
            if state is not None:
                leave_in(connection, survey_id, state)

    def forget(self, survey_id: int) -> None:
        """A drive that was cancelled disappears with all it had."""
        with self._database.write() as connection:
            forget_survey(connection, survey_id)

    def interrupt_unfinished(self) -> int:
        """What a power cut left in the state "measuring" is kept as "interrupted", if it saw anything; how many there were."""
        with self._database.write() as connection:
            return interrupt_unfinished(connection, KIND, _NOTHING_SEEN)

    def map(self, survey_id: int) -> dict[str, Any]:
        """The map of one drive, see ``web_ui.openapi``. Raises NotFound."""
        with self._database.read() as connection:
            survey, drive = survey_row(connection, survey_id), _drive(connection, survey_id)
            pipe = connection.execute("SELECT * FROM pipes WHERE id = ?", (survey["pipe_id"],)).fetchone()
            rows = connection.execute(
                "SELECT number, measured, thumbnail IS NOT NULL AS pictured FROM landmarks WHERE survey_id = ?", (survey_id,)
            ).fetchall()
            words = _words(connection, survey_id)
            faults = connection.execute(
                "SELECT body FROM drive_faults WHERE survey_id = ? ORDER BY id", (survey_id,)
            ).fetchall()
        landmarks = [_landmark(row, words.get(row["number"], [])) for row in rows]
        settings, summary = json.loads(drive["settings"]), json.loads(drive["summary"])
        return {
            "survey_id": survey_id,
            "kind": KIND,
            "state": survey["state"],
            "created": iso(survey["created_ms"]),
            "clock_source": survey["clock_source"],
            "pipe": pipe_json(pipe) if pipe else None,
            "direction": settings.get("direction"),
            "radius_m": settings.get("radius_m"),
            "from_m": None,
            "to_m": None,
            "focal_radius": None,
            "scale": None,
            "smoothed": False,
            "frames": 0,
            "dropped": 0,
            "seconds": 0.0,
            **summary,
            "settings": settings,
            "landmarks": sorted(landmarks, key=lambda landmark: (landmark["chainage_m"] or 0.0, landmark["id"])),
            "rings": json.loads(drive["rings"]),
            "faults": [json.loads(row["body"]) for row in faults],
        }

    def landmark(self, survey_id: int, number: int) -> dict[str, Any]:
        """One landmark with what was said of it. Raises NotFound."""
        with self._database.read() as connection:
            survey_row(connection, survey_id)
            row = _landmark_row(connection, survey_id, number)
            return _landmark(row, _words(connection, survey_id, number).get(number, []))

    def landmarks(self, survey_id: int) -> dict[int, list[dict[str, Any]]]:
        """What was said of each landmark of a drive, by its number, oldest first."""
        with self._database.read() as connection:
            return _words(connection, survey_id)

    def thumbnail(self, survey_id: int, number: int) -> bytes | None:
        """JPEG of a landmark, or None. Raises NotFound."""
        with self._database.read() as connection:
            survey_row(connection, survey_id)
            picture: bytes | None = _landmark_row(connection, survey_id, number)["thumbnail"]
        return picture

    def say(self, survey_id: int, number: int, said: dict[str, Any], by: str) -> dict[str, Any]:
        """Keep what ``by`` said of a landmark: any of "decision", "class", "chainage_m", "clock", "note"; None takes a word
        back. The landmark. Raises NotFound."""
        with self._database.write() as connection:
            survey_row(connection, survey_id)
            _landmark_row(connection, survey_id, number)
            connection.execute(
                "INSERT INTO landmark_words (survey_id, number, said, by_whom, created_ms, clock_source)"
                " VALUES (?, ?, ?, ?, ?, ?)",
                (survey_id, number, dumps(said), by, self._clock.epoch_ms(), self._clock.source),
            )
        return self.landmark(survey_id, number)

    def log(self, survey_id: int) -> list[Any]:
        """The entries that ``keep`` was given, in order. Raises NotFound."""
        with self._database.read() as connection:
            _drive(connection, survey_id)
            rows = connection.execute("SELECT chunk FROM drive_log WHERE survey_id = ? ORDER BY id", (survey_id,)).fetchall()
        return [entry for row in rows for entry in json.loads(zlib.decompress(row["chunk"]))]


class Remembered:
    """What is set from the page and outlives a restart, one JSON object a name."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def get(self, name: str) -> dict[str, Any]:
        """What was kept under ``name``; empty where nothing was."""
        with self._database.read() as connection:
            row = connection.execute("SELECT body FROM kept WHERE name = ?", (name,)).fetchone()
        body: dict[str, Any] = {} if row is None else json.loads(row["body"])
        return body

    def put(self, name: str, body: dict[str, Any]) -> None:
        """Keep ``body`` under ``name``."""
        with self._database.write() as connection:
            connection.execute(
                "INSERT INTO kept (name, body) VALUES (?, ?) ON CONFLICT (name) DO UPDATE SET body = excluded.body",
                (name, dumps(body)),
            )


def with_words(measured: dict[str, Any], words: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """A landmark as the page reads it: the measured values as they are, beside them what was said, the last word counting."""
    latest: dict[str, Any] = {}
    for word in words:
        latest.update({key: value for key, value in word.items() if key in _SAID})
    corrected = {key: latest[key] for key in CORRECTABLE if latest.get(key) is not None}
    return {
        **measured,
        "decision": latest.get("decision"),
        "corrected": corrected or None,
        "note": latest.get("note") or "",
        "history": list(words),
    }


def _drive(connection: sqlite3.Connection, survey_id: int) -> sqlite3.Row:
    row: sqlite3.Row | None = connection.execute("SELECT * FROM drives WHERE survey_id = ?", (survey_id,)).fetchone()
    if row is None:
        raise NotFound(f"There is no drive number {survey_id}.")
    return row


def _landmark_row(connection: sqlite3.Connection, survey_id: int, number: int) -> sqlite3.Row:
    row: sqlite3.Row | None = connection.execute(
        "SELECT *, thumbnail IS NOT NULL AS pictured FROM landmarks WHERE survey_id = ? AND number = ?", (survey_id, number)
    ).fetchone()
    if row is None:
        raise NotFound(f"Survey {survey_id} has no landmark number {number}.")
    return row


def _words(connection: sqlite3.Connection, survey_id: int, number: int | None = None) -> dict[int, list[dict[str, Any]]]:
    rows = connection.execute(
        "SELECT * FROM landmark_words WHERE survey_id = :survey AND (:number IS NULL OR number = :number) ORDER BY id",
        {"survey": survey_id, "number": number},
    ).fetchall()
    found: dict[int, list[dict[str, Any]]] = {}
    for row in rows:
        word = {**json.loads(row["said"]), "by": row["by_whom"], "created": iso(row["created_ms"])}
        found.setdefault(row["number"], []).append(word)
    return found


def _landmark(row: sqlite3.Row, words: list[dict[str, Any]]) -> dict[str, Any]:
    measured = {"id": row["number"], **json.loads(row["measured"]), "thumbnail": bool(row["pictured"])}
    return with_words(measured, words)
