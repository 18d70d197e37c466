"""One drive under way: what has been mapped so far, what of it is durable, what the page has been told.

Everything here is called with the survey's lock held, but for what a docstring says otherwise. Nothing here waits for a disk.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from device.landmarks.as_json import marked_json
from device.landmarks.crawler import Crawler
from device.landmarks.drive_faults import FaultWatch
from device.landmarks.drive_findings import (
    DriveFindings,
    Marks,
    Row,
    filtered_rows,
    findings,
    next_number,
    numbered_rows,
)
from device.landmarks.drive_log import DriveLog
from device.landmarks.pipeline import LandmarkPipeline, Step
from device.landmarks.placing import Placing, Whereabouts
from device.landmarks.smoothing import Mapped
from device.prompts import PROMPTS
from device.store import Kept, KeptLandmark
from device.store.drives import with_words
from drivers.grabber.base import VideoFrame


@dataclass(frozen=True)
class Unkept:
    """What has come since the last time that something was made durable. ``pictures`` by number: the frame that each is from,
    and what makes the JPEG, which takes its time."""

    rows: dict[int, Row]
    changed: list[int]
    gone: list[int]
    pictures: dict[int, tuple[int, Callable[[], bytes]]]
    rings: list[dict[str, Any]]
    faults: list[dict[str, Any]]
    entries: list[Any]
    summary: dict[str, Any]

    def for_store(self) -> Kept:
        """As the store takes it. Needs no lock."""
        landmarks = [
            KeptLandmark(number, self.rows[number], self.pictures[number][1]() if number in self.pictures else None)
            for number in self.changed
        ]
        return Kept(landmarks, self.gone, self.rings, self.faults, self.entries, self.summary)


@dataclass
class Drive:
    """``numbers`` are those that the operator knows the mapper's landmarks by."""

    survey_id: int
    pipe_id: int | None
    direction: str
    crawler: Crawler
    pipeline: LandmarkPipeline
    placing: Placing
    log: DriveLog
    begun: float
    state: str = "driving"
    progress: float | None = None
    length_m: float | None = None
    ending: threading.Event = field(default_factory=threading.Event)
    cancelled: bool = False
    dropped: int = 0
    """Pictures that the grabber had and nobody mapped."""
    faults: FaultWatch = field(default_factory=FaultWatch)
    numbers: dict[int, int] = field(default_factory=dict)
    marks: Marks = field(default_factory=dict)
    words: dict[int, list[dict[str, Any]]] = field(default_factory=dict)
    kept: dict[int, Row] = field(default_factory=dict)
    pictured: dict[int, int] = field(default_factory=dict)
    """The frame of the thumbnail that is stored, by number."""
    told: dict[int, Row] = field(default_factory=dict)
    full: bool = False
    """The disk is."""
    shown: tuple[VideoFrame, Step] | None = None

    @property
    def now_s(self) -> float:
        """Seconds since the drive began."""
        return time.monotonic() - self.begun

    # What comes in

    def take(self, frame: VideoFrame) -> None:
        """The next picture: placed by the readings that have come, and mapped unless the drive pauses."""
        self.placing.see(frame)
        if self.state == "paused":
            self.pipeline.paused()
            self.log.step(frame, 0, None)
            return
        position, readings = self.placing.find(frame.time_s)
        step = self.pipeline.step(frame, position)
        self.log.step(frame, readings, step)
        self.shown = (frame, step)

    def watch(self) -> None:
        """Compare this moment with the one before: what goes wrong is an event."""
        grabber, tether = self.crawler.grabber, self.crawler.tether
        where = self.placing.now()
        self.faults.now(self.now_s, None if where is None else where.chainage)
        if grabber is not None:
            self.faults.feed("grabber", grabber.status())
        if tether is not None:
            self.faults.feed("encoder", tether.feed.status())
        self.faults.jumps(self.placing.jumps)
        self.faults.codes(self.codes())

    def new_mark(self, label: str, clock: float | None, where: Whereabouts) -> tuple[int, Row]:
        """A landmark marked by hand where the crawler is: its number and its row. It counts once it is ``marked``."""
        number = next_number(self.numbers, self.marks)
        return number, marked_json(number, label, where.chainage, where.std, clock)

    def marked(self, number: int, time_s: float, row: Row) -> None:
        """A landmark marked by hand is durable."""
        self.marks[number] = (time_s, row)
        self.log.marked(number, time_s, row)
        self.kept[number] = row

    # What is told

    def codes(self) -> list[str]:
        """What the operator is told just now, the weightiest first."""
        grabber = self.crawler.grabber
        codes: list[str] = []
        if self.full:
            codes.append("storage_full")
        if self.log.recorder.lost:
            codes.append("not_recorded")
        if grabber is not None and grabber.status().state != "up":
            codes.append("signal_lost")
        if self.placing.silent(time.monotonic()):
            codes.append("no_distance" if self.crawler.tether is None else "encoder_lost")
        if self.state == "driving" and self.shown is not None and "signal_lost" not in codes:
            codes += [code for code in self.shown[1].prompts if code in PROMPTS]
        return codes

    def prompts(self) -> list[dict[str, str]]:
        """The same as prompts, JSON-ready."""
        return [PROMPTS[code].to_json() for code in self.codes()]

    def rows(self) -> list[Row]:
        """Every landmark of this moment, candidates too, each under its number."""
        rows = numbered_rows(self.pipeline, self.numbers, self.marks)
        self.log.numbered(self.numbers)
        return rows

    def to_json(self) -> dict[str, Any]:
        """The drive at this moment, see ``web_ui.openapi``."""
        where = self.placing.now()
        statuses = [row["status"] for row in self.rows()]
        return {
            "state": self.state,
            "survey_id": self.survey_id,
            "pipe_id": self.pipe_id,
            "direction": self.direction,
            "chainage_m": None if where is None else round(where.chainage, 3),
            "sigma_m": None if where is None else round(where.std, 3),
            "speed_mps": None if where is None else round(where.speed, 3),
            "seconds": round(self.now_s, 1),
            "frames": self.pipeline.frames,
            "dropped": self.dropped,
            "prompts": self.prompts(),
            "counts": {status: statuses.count(status) for status in ("candidate", "confirmed", "passed")},
            "progress": self.progress,
        }

    def news(self) -> dict[str, list[Any]]:
        """What has changed since it was asked the last time: {"landmarks", "gone", "faults"}."""
        rows = {
            row["id"]: with_words({**row, "thumbnail": row["id"] in self.pictured}, self.words.get(row["id"], []))
            for row in self.rows()
        }
        changed = [row for number, row in rows.items() if self.told.get(number) != row]
        gone = [number for number in self.told if number not in rows]
        self.told = rows
        self.log.prompts(self.prompts())
        return {"landmarks": changed, "gone": gone, "faults": self.faults.untold()}

    # What is made durable

    def unkept(self) -> Unkept:
        """What is to be made durable; ``were_kept`` once it is."""
        rows = filtered_rows(self.pipeline, self.numbers, self.marks)
        self.log.numbered(self.numbers)
        pictures = {
            number: thumbnail
            for key_id, number in self.numbers.items()
            if number in rows
            and (thumbnail := self.pipeline.thumbnail(key_id)) is not None
            and self.pictured.get(number) != thumbnail[0]
        }
        changed = [number for number, row in rows.items() if self.kept.get(number) != row or number in pictures]
        return Unkept(
            rows,
            changed,
            self.missing_in(rows),
            pictures,
            self.pipeline.joints(),
            self.faults.unkept(),
            self.pipeline.log_entries(),
            self.summary(len(rows)),
        )

    def were_kept(self, what: Unkept) -> None:
        """It is on the disk."""
        self.kept = {number: row for number, row in self.kept.items() if number not in what.gone} | what.rows
        self.pictured |= {number: frame for number, (frame, _) in what.pictures.items()}
        self.faults.were_kept(len(what.faults))
        self.pipeline.log_was_kept(len(what.entries))

    def missing_in(self, rows: dict[int, Row]) -> list[int]:
        """Those that are kept and no longer in the map; what somebody spoke of stays."""
        return [number for number in self.kept if number not in rows and number not in self.words]

    def summary(self, landmarks: int) -> dict[str, Any]:
        """The drive in a few numbers."""
        from_m, to_m = self.pipeline.span()
        return {
            "from_m": from_m,
            "to_m": to_m,
            "frames": self.pipeline.frames,
            "dropped": self.dropped,
            "seconds": round(self.now_s, 1),
            "landmarks": landmarks,
            "focal_radius": self.pipeline.focal_radius(),
            "smoothed": False,
            "length_m": self.length_m,
        }

    def findings(self, state: str, smoothed: Mapped | None) -> DriveFindings:
        """What it comes to in its last ``state``; ``smoothed`` is None where nothing was."""
        filtered = filtered_rows(self.pipeline, self.numbers, self.marks)
        return findings(self.pipeline, state, filtered, self.numbers, self.marks, smoothed)
