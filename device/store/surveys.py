"""Surveys with their recordings, findings, prompts and what the operator said of them."""

from __future__ import annotations

import json
import sqlite3
import zlib
from dataclasses import dataclass
from typing import Any

from device.clock import Clock, iso
from device.diameter.joint_verdict import joint_verdict
from device.errors import NotFound
from device.json_text import dumps
from device.store.database import Database
from device.store.places import pipe_json

QUESTIONS = ("image_good", "cloud_is_pipe", "fit_aligned")
_DAY_MS = 86_400_000
_GO_MS = _DAY_MS // 2
_IDENTITY = ("camera", "position", "diameter_mm", "frames")
"""What a conclusion leaves as it was in the result it was drawn from."""
_DRIVE_FIELDS = ("landmarks", "from_m", "to_m", "frames", "seconds")
_STRUCTURE_FIELDS = ("pipes", "objects", "unsure", "scans", "consistent", "seconds")
_ANOMALY_FIELDS = ("score_mm", "outward_mm", "coverage", "chainage_m", "regions")
_NO_DIAMETER: dict[str, Any] = {
    "diameter_mm": None,
    "interval_mm": None,
    "dn": None,
    "final_verdict": None,
    "verdict_by": None,
    "reasons": [],
}


@dataclass(frozen=True)
class NewRecording:
    """A recording that has been judged: who recorded what, its RESULT, the cloud to draw (see ``clouds.py``), the JPEGs."""

    camera: str
    position: str | None
    frames: int
    result: dict[str, Any]
    cloud: dict[str, Any] | None
    settings: dict[str, Any]
    picture_color: bytes | None = None
    picture_depth: bytes | None = None
    overlay: bytes | None = None
    """The colour picture with the deviations of an anomaly survey on it."""
    map: bytes | None = None
    """Its unrolled wall, see ``device.anomaly.views``."""


class Surveys:
    """Queries on surveys. Everything returned is JSON-ready; whatever is written is on the disk when a method returns."""

    def __init__(self, database: Database, clock: Clock) -> None:
        self._database = database
        self._clock = clock

    def begin(self, kind: str, pipe_id: int | None) -> int:
        """A new survey in the state "measuring"; its number."""
        with self._database.write() as connection:
            return begin_survey(connection, self._clock, kind, pipe_id)

    def abandon(self, survey_id: int) -> None:
        """A survey that came to nothing disappears; one that has findings keeps them."""
        with self._database.write() as connection:
            _abandon(connection, survey_id)

    def abandon_unfinished(self) -> int:
        """What a power cut left in the state "measuring" is abandoned, but for drives and chambers; how many there were."""
        with self._database.write() as connection:
            unfinished = [
                row["id"]
                for row in connection.execute(
                    "SELECT id FROM surveys WHERE state = 'measuring'"
                    " AND NOT EXISTS (SELECT 1 FROM drives WHERE survey_id = surveys.id)"
                    " AND NOT EXISTS (SELECT 1 FROM structures WHERE survey_id = surveys.id)"
                )
            ]
            for survey_id in unfinished:
                _abandon(connection, survey_id)
        return len(unfinished)

    def conclude(self, survey_id: int, state: str, recordings: list[NewRecording], conclusion: dict[str, Any]) -> None:
        """Add ``recordings`` and their findings, replace the conclusion, keep the prompts: all of it or nothing."""
        with self._database.write() as connection:
            kind = connection.execute("SELECT kind FROM surveys WHERE id = ?", (survey_id,)).fetchone()["kind"]
            for recording in recordings:
                recording_id = connection.execute(
                    "INSERT INTO recordings (survey_id, camera, position, frames, settings) VALUES (?, ?, ?, ?, ?)",
                    (survey_id, recording.camera, recording.position, recording.frames, dumps(recording.settings)),
                ).lastrowid
                cloud = None if recording.cloud is None else zlib.compress(dumps(recording.cloud).encode(), 6)
                connection.execute(
                    "INSERT INTO findings"
                    " (survey_id, recording_id, kind, body, cloud, picture_color, picture_depth, overlay, map)"
                    " VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?)",
                    (
                        survey_id,
                        recording_id,
                        kind,
                        dumps(recording.result),
                        cloud,
                        recording.picture_color,
                        recording.picture_depth,
                        recording.overlay,
                        recording.map,
                    ),
                )
            connection.execute("DELETE FROM findings WHERE survey_id = ? AND recording_id IS NULL", (survey_id,))
            connection.execute(
                "INSERT INTO findings (survey_id, recording_id, kind, body) VALUES (?, NULL, ?, ?)",
                (survey_id, kind, dumps(conclusion)),
            )
            connection.executemany(
                "INSERT INTO prompts (survey_id, code, reason, remedy) VALUES (?, ?, ?, ?)",
                [(survey_id, prompt["code"], prompt["reason"], prompt["remedy"]) for prompt in conclusion.get("prompts", [])],
            )
            leave_in(connection, survey_id, state)

    def recorded(self, survey_id: int, outcome: dict[str, Any]) -> None:
        """What became of the survey's raw data. Nothing happens where the survey is gone."""
        with self._database.write() as connection:
            connection.execute("UPDATE surveys SET recording = ? WHERE id = ?", (dumps(outcome), survey_id))

    def recording(self, survey_id: int) -> dict[str, Any] | None:
        """What ``recorded`` was told last, None where it was not. Raises NotFound."""
        with self._database.read() as connection:
            told = survey_row(connection, survey_id)["recording"]
        outcome: dict[str, Any] | None = None if told is None else json.loads(told)
        return outcome

    def reopen(self, survey_id: int) -> None:
        """Back to the state "measuring", for a second position. Raises NotFound."""
        with self._database.write() as connection:
            survey_row(connection, survey_id)
            leave_in(connection, survey_id, "measuring")

    def summaries(self, pipe_id: int | None, limit: int, before: int | None) -> list[dict[str, Any]]:
        """Newest first: {"id", "created", "pipe" (its name), "diameter_mm", "interval_mm", "dn", "final_verdict", ...}.

        Of a drive there is no diameter and no verdict, but "landmarks", "from_m" and "to_m"; of a chamber "node", "pipes",
        "objects" and "scans".
        """
        with self._database.read() as connection:
            rows = connection.execute(
                "SELECT surveys.*, pipes.name AS pipe_name, findings.body,"
                " coalesce(drives.summary, structures.summary) AS summary, nodes.name AS node_name FROM surveys"
                " LEFT JOIN pipes ON pipes.id = pipe_id"
                " LEFT JOIN findings ON findings.survey_id = surveys.id AND recording_id IS NULL"
                " LEFT JOIN drives ON drives.survey_id = surveys.id"
                " LEFT JOIN structures ON structures.survey_id = surveys.id LEFT JOIN nodes ON nodes.id = node_id"
                " WHERE NOT surveys.deleted AND (findings.id IS NOT NULL"
                " OR surveys.state <> 'measuring' AND coalesce(drives.survey_id, structures.survey_id) IS NOT NULL)"
                " AND (:pipe IS NULL OR pipe_id = :pipe) AND (:before IS NULL OR surveys.id < :before)"
                " ORDER BY surveys.id DESC LIMIT :limit",
                {"pipe": pipe_id, "before": before, "limit": limit},
            ).fetchall()
            return [_summary(row, _operator(connection, row["id"])) for row in rows]

    def in_one_go(self, survey_id: int) -> list[int]:
        """The surveys of the same kind in the same pipe that were made in one go with this one, in their order. One without a
        pipe stands alone. Raises NotFound."""
        with self._database.read() as connection:
            wanted = survey_row(connection, survey_id)
            rows = connection.execute(
                "SELECT * FROM surveys WHERE kind = ? AND pipe_id = ? AND NOT deleted ORDER BY id",
                (wanted["kind"], wanted["pipe_id"]),
            ).fetchall()
        goes: list[list[int]] = []
        for before, one in zip([None, *rows], rows, strict=False):
            if before is None or not _in_one_go(before, one):
                goes.append([])
            goes[-1].append(one["id"])
        return next((go for go in goes if survey_id in go), [survey_id])

    def get(self, survey_id: int) -> dict[str, Any]:
        """One survey with everything but its clouds and pictures. Raises NotFound."""
        with self._database.read() as connection:
            row = survey_row(connection, survey_id)
            pipe = connection.execute("SELECT * FROM pipes WHERE id = ?", (row["pipe_id"],)).fetchone()
            recordings = connection.execute(
                "SELECT recordings.*, findings.body FROM recordings JOIN findings ON findings.recording_id = recordings.id"
                " WHERE recordings.survey_id = ? ORDER BY recordings.id",
                (survey_id,),
            ).fetchall()
            conclusion = connection.execute(
                "SELECT body FROM findings WHERE survey_id = ? AND recording_id IS NULL", (survey_id,)
            ).fetchone()
            operator = _operator(connection, survey_id)
            judged = row["kind"] not in ("landmarks", "structure")
        result = json.loads(conclusion["body"]) if conclusion else None
        verdict: str | None
        by: str | None
        verdict, by = joint_verdict(result["verdict"] if result else "retry", operator)
        if not judged:
            verdict, by = None, None
        return {
            "id": survey_id,
            "kind": row["kind"],
            "created": iso(row["created_ms"]),
            "clock_source": row["clock_source"],
            "pipe": pipe_json(pipe) if pipe else None,
            "state": row["state"],
            "recordings": [
                {
                    "id": recording["id"],
                    "camera": recording["camera"],
                    "position": recording["position"],
                    "frames": recording["frames"],
                    "result": json.loads(recording["body"]),
                }
                for recording in recordings
            ],
            "result": result,
            "operator": operator,
            "final_verdict": verdict,
            "verdict_by": by,
        }

    def cloud(self, survey_id: int) -> dict[str, Any] | None:
        """The cloud of the recording that was chosen, or the newest one; None where no recording has one. Raises NotFound."""
        with self._database.read() as connection:
            chosen = _chosen(connection, survey_id)
            row = connection.execute(
                "SELECT cloud FROM findings WHERE survey_id = ? AND cloud IS NOT NULL"
                " ORDER BY recording_id IS ? DESC, recording_id DESC",
                (survey_id, chosen),
            ).fetchone()
        if row is None:
            return None
        cloud: dict[str, Any] = json.loads(zlib.decompress(row["cloud"]))
        return cloud

    def picture(self, survey_id: int, kind: str) -> bytes | None:
        """JPEG, "depth" or "color", of the recording that was chosen; None where none was kept. Raises NotFound.

        Never another recording's: the operator judges the result by it.
        """
        with self._database.read() as connection:
            row = connection.execute(
                "SELECT picture_color AS color, picture_depth AS depth FROM findings WHERE recording_id = ?",
                (_chosen(connection, survey_id),),
            ).fetchone()
        picture: bytes | None = None if row is None else row[kind]
        return picture

    def anomaly_view(self, survey_id: int, what: str) -> bytes | None:
        """Of an anomaly survey: "reference" or "overlay" (JPEG) or "map"; None where there is none. Raises NotFound."""
        column = {"reference": "picture_color", "overlay": "overlay", "map": "map"}[what]
        with self._database.read() as connection:
            survey_row(connection, survey_id)
            row = connection.execute(
                f"SELECT {column} AS kept FROM findings WHERE survey_id = ? AND kind = 'anomaly' AND recording_id IS NOT NULL",
                (survey_id,),
            ).fetchone()
        kept: bytes | None = None if row is None else row["kept"]
        return kept

    def answer(self, survey_id: int, said: dict[str, Any], by: str, note: str) -> None:
        """Keep what ``by`` said: {question: bool or None, "verdict": "accept", "retry" or None}. Raises NotFound."""
        with self._database.write() as connection:
            survey_row(connection, survey_id)
            connection.execute(
                "INSERT INTO answers (survey_id, last_recording, said, by_whom, note, created_ms, clock_source)"
                " VALUES (:survey, (SELECT max(id) FROM recordings WHERE survey_id = :survey),"
                " :said, :by, :note, :ms, :source)",
                {
                    "survey": survey_id,
                    "said": dumps(said),
                    "by": by,
                    "note": note,
                    "ms": self._clock.epoch_ms(),
                    "source": self._clock.source,
                },
            )

    def delete(self, survey_id: int) -> None:
        """Out of sight, but for ``restore``. Raises NotFound."""
        with self._database.write() as connection:
            survey_row(connection, survey_id)
            connection.execute(
                "UPDATE surveys SET deleted = 1, deleted_ms = ? WHERE id = ?", (self._clock.epoch_ms(), survey_id)
            )

    def restore(self, survey_id: int) -> None:
        """Undo ``delete``. Raises NotFound where there is no such survey any more."""
        with self._database.write() as connection:
            survey_row(connection, survey_id, deleted=True)
            connection.execute("UPDATE surveys SET deleted = 0, deleted_ms = NULL WHERE id = ?", (survey_id,))

    def purge(self, older_than_days: int) -> list[int]:
        """Remove for good what was deleted that long ago; their numbers. While the date is unknown nothing is removed."""
        now_ms = self._clock.epoch_ms()
        if now_ms is None:
            return []
        with self._database.write() as connection:
            gone = connection.execute(
                "DELETE FROM surveys WHERE deleted AND deleted_ms < ? RETURNING id", (now_ms - older_than_days * _DAY_MS,)
            )
            return [int(row["id"]) for row in gone.fetchall()]

    def date_this_boot(self) -> None:
        """Now that the date is known: date what was measured since the box was switched on."""
        now_ms = self._clock.epoch_ms()
        if now_ms is None:
            return
        with self._database.write() as connection:
            connection.execute(
                "UPDATE surveys SET created_ms = ? + monotonic_ns / 1000000, clock_source = ?"
                " WHERE created_ms IS NULL AND boot_id = ?",
                (now_ms - self._clock.monotonic_ns() // 1_000_000, self._clock.source, self._clock.boot_id),
            )


def _in_one_go(before: sqlite3.Row, one: sqlite3.Row) -> bool:
    """Within half a day of each other; where the box did not know the date, since the same start of it."""
    if before["created_ms"] is None or one["created_ms"] is None:
        return bool(before["boot_id"] == one["boot_id"])
    return bool(abs(one["created_ms"] - before["created_ms"]) <= _GO_MS)


def begin_survey(connection: sqlite3.Connection, clock: Clock, kind: str, pipe_id: int | None) -> int:
    """A new row in the state "measuring"; its number."""
    number = connection.execute(
        "INSERT INTO surveys (kind, pipe_id, state, created_ms, clock_source, boot_id, monotonic_ns)"
        " VALUES (?, ?, 'measuring', ?, ?, ?, ?)",
        (kind, pipe_id, clock.epoch_ms(), clock.source, clock.boot_id, clock.monotonic_ns()),
    ).lastrowid
    assert number is not None  # sqlite gives every inserted row a number
    return number


def interrupt_unfinished(connection: sqlite3.Connection, kind: str, nothing_seen: str) -> int:
    """What a power cut left in the state "measuring" becomes "interrupted"; where ``nothing_seen`` (SQL) holds, it goes.
    How many are kept."""
    connection.execute(f"DELETE FROM surveys WHERE kind = ? AND state = 'measuring' AND {nothing_seen}", (kind,))
    return connection.execute(
        "UPDATE surveys SET state = 'interrupted' WHERE kind = ? AND state = 'measuring'", (kind,)
    ).rowcount


def forget_survey(connection: sqlite3.Connection, survey_id: int) -> None:
    """A survey that was cancelled disappears with all it had."""
    connection.execute("DELETE FROM surveys WHERE id = ?", (survey_id,))


def leave_in(connection: sqlite3.Connection, survey_id: int, state: str) -> None:
    """The survey's state from now on."""
    connection.execute("UPDATE surveys SET state = ? WHERE id = ?", (state, survey_id))


def survey_row(connection: sqlite3.Connection, survey_id: int, deleted: bool = False) -> sqlite3.Row:
    """The row of a survey that is (not) deleted. Raises NotFound."""
    row: sqlite3.Row | None = connection.execute(
        "SELECT * FROM surveys WHERE id = ? AND (? OR NOT deleted)", (survey_id, deleted)
    ).fetchone()
    if row is None:
        raise NotFound(f"There is no survey number {survey_id}.")
    return row


def _chosen(connection: sqlite3.Connection, survey_id: int) -> int | None:
    """The recording whose result is the survey's: what tells two of one camera and position apart is compared too."""
    survey_row(connection, survey_id)
    rows = connection.execute(
        "SELECT recording_id, body FROM findings WHERE survey_id = ? ORDER BY recording_id DESC", (survey_id,)
    ).fetchall()
    results = {row["recording_id"]: json.loads(row["body"]) for row in rows}
    conclusion = results.pop(None, {})
    return next(
        (number for number, result in results.items() if all(result.get(k) == conclusion.get(k) for k in _IDENTITY)), None
    )


def _abandon(connection: sqlite3.Connection, survey_id: int) -> None:
    recordings, findings = connection.execute(
        "SELECT count(recording_id), count(*) FROM findings WHERE survey_id = ?", (survey_id,)
    ).fetchone()
    if findings:
        leave_in(connection, survey_id, "saved" if recordings else "failed")
    else:
        forget_survey(connection, survey_id)


def _operator(connection: sqlite3.Connection, survey_id: int) -> dict[str, Any] | None:
    """The newest word on each question, and who had the last one.

    What was said before the newest recording was said of another result: it stays in "history" and no longer counts.
    """
    rows = connection.execute(
        "SELECT said, by_whom, note, last_recording IS"
        " (SELECT max(id) FROM recordings WHERE recordings.survey_id = answers.survey_id) AS counts"
        " FROM answers WHERE survey_id = ? ORDER BY id",
        (survey_id,),
    ).fetchall()
    if not rows:
        return None
    latest: dict[str, Any] = {}
    for row in rows:
        if row["counts"]:
            latest.update(json.loads(row["said"]))
    return {
        "answers": {question: latest.get(question) for question in QUESTIONS},
        "verdict": latest.get("verdict"),
        "by": rows[-1]["by_whom"],
        "note": rows[-1]["note"],
        "history": [{**json.loads(row["said"]), "by": row["by_whom"], "note": row["note"]} for row in rows],
    }


def _summary(row: sqlite3.Row, operator: dict[str, Any] | None) -> dict[str, Any]:
    common = {
        "id": row["id"],
        "kind": row["kind"],
        "created": iso(row["created_ms"]),
        "clock_source": row["clock_source"],
        "pipe_id": row["pipe_id"],
        "pipe": row["pipe_name"],
        "state": row["state"],
    }
    if row["summary"] is not None:
        told, chamber = json.loads(row["summary"]), row["kind"] == "structure"
        fields = _STRUCTURE_FIELDS if chamber else _DRIVE_FIELDS
        node = {"node": row["node_name"]} if chamber else {}
        return {**common, **node, **{key: told.get(key) for key in fields}, **_NO_DIAMETER}
    result = json.loads(row["body"])
    verdict, by = joint_verdict(result["verdict"], operator)
    return {
        **common,
        **({key: result.get(key) for key in _ANOMALY_FIELDS} if row["kind"] == "anomaly" else {}),
        "diameter_mm": result["diameter_mm"],
        "interval_mm": result["interval_mm"],
        "dn": result["dn"],
        "final_verdict": verdict,
        "verdict_by": by,
        "reasons": result["reasons"],
    }
