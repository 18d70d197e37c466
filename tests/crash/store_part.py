"""The store under a power cut: surveys measured, drives mapped, words said, settings set; and the whole of it read again."""

from __future__ import annotations

import json
from pathlib import Path
from random import Random
from typing import Any

from device.bus import Bus
from device.clock import Clock
from device.errors import DeviceError
from device.store import Kept, KeptLandmark, NewRecording, Store
from device.store.journal import KEPT
from device.surveys.base import Job, Outcome, Survey
from tests.crash.marks import Promises
from tests.crash.shim import mark

IGNORED = ("-shm", ".lock")
"""SQLite's shared memory is made anew by whoever opens the database first; the lock is one only while its process lives."""


class WatchedBus(Bus):
    """Marks what the page would show, when it would."""

    def __init__(self) -> None:
        super().__init__()
        self.saved: dict[int, Any] = {}
        """What is about to be saved, by survey."""

    def publish(self, name: str, data: dict[str, Any]) -> None:
        if name == "measurement" and data["state"] == "saved":
            mark("shown", f"survey {data['survey_id']}", self.saved[data["survey_id"]])
        super().publish(name, data)


class Measuring(Survey):
    """A survey of the house whose measurement is drawn by lot."""

    kind = "diameter"

    def __init__(self, store: Store, bus: WatchedBus, rng: Random) -> None:
        super().__init__(store, bus)
        self._rng = rng
        self._watched = bus

    def _measure(self, job: Job) -> Outcome:
        rng = self._rng
        result = {
            "verdict": "accept",
            "reasons": [],
            "prompts": [],
            "diameter_mm": round(rng.uniform(150, 800), 3),
            "interval_mm": [1.0, 2.0],
            "dn": None,
            "camera": "lot",
            "position": "entrance",
            "frames": 50,
        }
        cloud = {"points": [round(rng.random(), 4) for _ in range(rng.randrange(300))]}
        recording = NewRecording(
            "lot", "entrance", 50, result, cloud, {}, rng.randbytes(rng.randrange(8000)), rng.randbytes(rng.randrange(6000))
        )
        self._watched.saved[job.survey_id] = result
        mark("begin", f"survey {job.survey_id}", result)
        self._store.surveys.conclude(job.survey_id, "saved", [recording], result)
        return Outcome("saved", "", result)

    def measure(self, survey_id: int | None = None) -> int:
        """One measurement, waited for."""
        number = self.start(None, None, 50, survey_id)
        assert self._thread is not None
        self._thread.join()
        return number


class StoreWork:
    """What a day does to the store, one step at a time, all of it drawn by lot."""

    def __init__(self, folder: Path, rng: Random) -> None:
        self.store = Store(folder, Clock(folder / "no-machine"))
        self.store.surveys.abandon_unfinished()
        self.store.drives.interrupt_unfinished()
        self._rng = rng
        self._measuring = Measuring(self.store, WatchedBus(), rng)
        self._surveys: list[int] = []
        self._drive: int | None = None
        self._landmarks = 0

    def close(self) -> None:
        """The day is over."""
        self.store.close()

    def step(self) -> None:
        """Whatever comes next."""
        self._rng.choice(
            (self.measure, self.answer, self.set, self.set, self.drive, self.drive, self.drive, self.end_drive, self.note)
        )()

    def measure(self) -> None:
        self._surveys.append(self._measuring.measure())

    def answer(self) -> None:
        if not self._surveys:
            return
        number = self._rng.choice(self._surveys)
        note = f"note {self._rng.randrange(10**9)}"
        mark("begin", f"note {number}", note)
        self.store.surveys.answer(number, {"verdict": "accept"}, "somebody", note)
        mark("shown", f"note {number}", note)

    def set(self) -> None:
        name, body = (
            f"setting {self._rng.randrange(3)}",
            {"value": self._rng.randrange(10**9), "long": "x" * self._rng.randrange(2000)},
        )
        mark("begin", f"kept {name}", body)
        self.store.remembered.put(name, body)
        mark("shown", f"kept {name}", body)

    def drive(self) -> None:
        """A second of a drive: some landmarks anew, some of them known."""
        if self._drive is None:
            self._drive, self._landmarks = self.store.drives.begin(None, {}), 0
        rows = {}
        for _ in range(self._rng.randrange(1, 4)):
            new = self._landmarks == 0 or self._rng.random() < 0.5
            self._landmarks += new
            number = self._landmarks if new else self._rng.randrange(1, self._landmarks + 1)
            rows[number] = {"class": "connection", "chainage_m": round(self._rng.uniform(0, 50), 3)}
        for number, row in rows.items():
            mark("begin", f"landmark {self._drive} {number}", row)
        landmarks = [KeptLandmark(n, row, self._rng.randbytes(self._rng.randrange(3000))) for n, row in rows.items()]
        log = [[k, self._rng.random()] for k in range(25)]
        self.store.drives.keep(self._drive, Kept(landmarks, log=log, summary={"landmarks": self._landmarks}))
        for number, row in rows.items():
            mark("shown", f"landmark {self._drive} {number}", row)

    def note(self) -> None:
        """A line of the journal."""
        reason = f"reason {self._rng.randrange(10**9)}"
        mark("begin", f"journal {reason}", True)
        self.store.journal.add("held", None, reason)
        mark("shown", f"journal {reason}", True)

    def end_drive(self) -> None:
        if self._drive is None:
            return
        number, self._drive = self._drive, None
        mark("begin", f"drive {number}", "saved")
        self.store.drives.keep(number, Kept(summary={"landmarks": self._landmarks}), "saved")
        mark("shown", f"drive {number}", "saved")


def check(folder: Path, promises: Promises) -> list[str]:
    """What is wrong with the store in ``folder``, opened as the daemon does at its start."""
    try:
        store = Store(folder, Clock(folder / "no-machine"))
    except DeviceError as error:
        return [f"unreadable: {error}"]
    try:
        if store.notice is not None:
            return [f"unreadable: {store.notice}"]
        store.surveys.abandon_unfinished()
        store.drives.interrupt_unfinished()
        keys = {*promises.shown, *promises.begun}
        return [wrong for key in sorted(keys) if (wrong := promises.broken(key, _found(store, key)))]
    finally:
        store.close()


def _found(store: Store, key: str) -> Any:
    what, _, rest = key.partition(" ")
    try:
        if what == "survey":
            survey = store.surveys.get(int(rest))
            return (
                survey["result"]
                if survey["state"] == "saved" and len(survey["recordings"]) == 1
                else {"state": survey["state"]}
            )
        if what == "note":
            operator = store.surveys.get(int(rest))["operator"]
            return None if operator is None else operator["note"]
        if what == "kept":
            return store.remembered.get(rest) or None
        if what == "landmark":
            drive, number = map(int, rest.split())
            row = next((row for row in store.drives.map(drive)["landmarks"] if row["id"] == number), None)
            return None if row is None else {name: row[name] for name in ("class", "chainage_m")}
        if what == "journal":
            return True if rest in [entry["reason"] for entry in store.journal.entries(limit=KEPT)] else None
        if what == "drive":
            state = store.drives.map(int(rest))["state"]
            return state if state == "saved" else None
    except DeviceError:
        return None
    except json.JSONDecodeError as error:
        return f"broken: {error}"
    raise ValueError(f"nobody knows what {key} is")
