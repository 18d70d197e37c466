"""The journal: when the box was switched on and off or lost its power, and what it began and ended by itself."""

from __future__ import annotations

import json
import sqlite3
import zlib
from dataclasses import dataclass
from typing import Any, Literal

from device.clock import Clock, iso
from device.json_text import dumps
from device.store.database import Database

What = Literal["on", "off", "cut", "begin", "end", "drop", "measure", "held", "released", "refused"]
"""Switched on, switched off, the power was cut; the rest as in ``device.autonomy.machine.Action``, or refused by the survey."""
KEPT = 5000
_LOOKED = "journal looked at"


@dataclass(frozen=True)
class LastTime:
    """How the box last stopped: without being switched off (``unsafe``), with a survey of its own under way (``cut``)."""

    unsafe: bool = False
    cut: int | None = None
    reason: str = ""
    """Why the last survey of its own ended, where none was under way."""


class Journal:
    """Queries on the journal. Everything returned is JSON-ready; what is written is on the disk when a method returns."""

    def __init__(self, database: Database, clock: Clock) -> None:
        self._database = database
        self._clock = clock

    def switched_on(self) -> LastTime:
        """The box begins; how it ended the last time."""
        with self._database.write() as connection:
            connection.execute("DELETE FROM journal WHERE id <= (SELECT max(id) FROM journal) - ?", (KEPT,))
            before = connection.execute("SELECT what FROM journal WHERE what IN ('on', 'off') ORDER BY id DESC").fetchone()
            own = connection.execute("SELECT * FROM journal WHERE what IN ('begin', 'end', 'drop') ORDER BY id DESC").fetchone()
            unsafe = before is not None and before["what"] == "on"
            cut: int | None = None
            if own is not None and own["what"] == "begin":
                cut = own["survey_id"]
                self._end_of_cut(connection, own)
            if unsafe:
                self._insert(connection, "cut", cut, "", None)
            self._insert(connection, "on", None, "", None)
        return LastTime(unsafe, cut, "" if own is None or own["what"] == "begin" else own["reason"])

    def switched_off(self) -> None:
        """The box ends, as it should."""
        self.add("off")

    def add(self, what: What, survey_id: int | None = None, reason: str = "", at_s: float | None = None) -> None:
        """``what`` happened at ``at_s`` (s on the clock's monotonic time), by default now. Raises StorageFull."""
        with self._database.write() as connection:
            self._insert(connection, what, survey_id, reason, None if at_s is None else round(at_s * 1e9))

    def entries(self, after: int = 0, limit: int = 500) -> list[dict[str, Any]]:
        """Those with numbers above ``after``, the newest last, at most the ``limit`` newest: {"id", "what", "survey_id",
        "reason", "at", "at_s" (monotonic), "boot"}."""
        with self._database.read() as connection:
            rows = connection.execute(
                "SELECT * FROM (SELECT * FROM journal WHERE id > ? ORDER BY id DESC LIMIT ?) ORDER BY id", (after, limit)
            ).fetchall()
        return [_entry(row) for row in rows]

    def unsafe_shutdowns(self) -> int:
        """How often the power went without the box being switched off, as far back as the journal goes."""
        with self._database.read() as connection:
            return int(connection.execute("SELECT count(*) FROM journal WHERE what = 'cut'").fetchone()[0])

    @property
    def looked_at(self) -> int:
        """The number of the last entry that somebody has looked at."""
        with self._database.read() as connection:
            row = connection.execute("SELECT body FROM kept WHERE name = ?", (_LOOKED,)).fetchone()
        return 0 if row is None else int(json.loads(row["body"])["id"])

    def news(self) -> int:
        """How many entries nobody has looked at; that the box was switched on and off is none."""
        with self._database.read() as connection:
            return int(
                connection.execute(
                    "SELECT count(*) FROM journal WHERE what NOT IN ('on', 'off') AND id > ?", (self.looked_at,)
                ).fetchone()[0]
            )

    def look(self, number: int) -> None:
        """Somebody has looked at everything up to this entry."""
        with self._database.write() as connection:
            connection.execute(
                "INSERT INTO kept (name, body) VALUES (?, ?) ON CONFLICT (name) DO UPDATE SET body = excluded.body",
                (_LOOKED, dumps({"id": number})),
            )

    def date_this_boot(self) -> None:
        """Now that the date is known: date what happened since the box was switched on."""
        now_ms = self._clock.epoch_ms()
        if now_ms is None:
            return
        with self._database.write() as connection:
            connection.execute(
                "UPDATE journal SET at_ms = ? + at_ns / 1000000, clock_source = ? WHERE at_ms IS NULL AND boot_id = ?",
                (now_ms - self._clock.monotonic_ns() // 1_000_000, self._clock.source, self._clock.boot_id),
            )

    def _insert(self, connection: sqlite3.Connection, what: str, survey_id: int | None, reason: str, at_ns: int | None) -> None:
        now_ns, now_ms = self._clock.monotonic_ns(), self._clock.epoch_ms()
        at_ns = now_ns if at_ns is None else at_ns
        at_ms = None if now_ms is None else now_ms - (now_ns - at_ns) // 1_000_000
        connection.execute(
            "INSERT INTO journal (what, survey_id, reason, boot_id, at_ns, at_ms, clock_source) VALUES (?, ?, ?, ?, ?, ?, ?)",
            (what, survey_id, reason, self._clock.boot_id, at_ns, at_ms, self._clock.source),
        )

    @staticmethod
    def _end_of_cut(connection: sqlite3.Connection, begun: sqlite3.Row) -> None:
        """A survey of its own was under way: it ended with the last thing that was saved of it, in the time of its boot."""
        last = connection.execute(
            "SELECT chunk FROM drive_log WHERE survey_id = ? ORDER BY id DESC LIMIT 1", (begun["survey_id"],)
        ).fetchone()
        at_ns = int(begun["at_ns"])
        if last is not None:
            at_ns = max(at_ns, round(json.loads(zlib.decompress(last["chunk"]))[-1][1] * 1e9))
        at_ms = None if begun["at_ms"] is None else begun["at_ms"] + (at_ns - begun["at_ns"]) // 1_000_000
        connection.execute(
            "INSERT INTO journal (what, survey_id, reason, boot_id, at_ns, at_ms, clock_source)"
            " VALUES ('end', ?, 'power_cut', ?, ?, ?, ?)",
            (begun["survey_id"], begun["boot_id"], at_ns, at_ms, begun["clock_source"]),
        )


def _entry(row: sqlite3.Row) -> dict[str, Any]:
    return {
        "id": row["id"],
        "what": row["what"],
        "survey_id": row["survey_id"],
        "reason": row["reason"],
        "at": iso(row["at_ms"]),
        "at_s": round(row["at_ns"] / 1e9, 3),
        "boot": row["boot_id"],
    }
