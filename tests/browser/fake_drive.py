"""The drive's half of the fake device: a crawler that goes through a canned pipe, and the map it leaves behind.

``metres_per_second`` sets its pace; ``prompts``, ``faults`` and the states of ``grabber`` and ``encoder`` are a test's
to set.
"""

from __future__ import annotations

import threading
import time
from functools import cache
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

from device.errors import Busy, Invalid, NotFound
from device.store.drives import with_words

if TYPE_CHECKING:
    from tests.browser.fake_device import FakeDevice

Json = dict[str, Any]
LENGTH_M = 42.0
RADIUS_M = 0.15

SLIP = {
    "code": "slip",
    "reason": "The counter stands still but the picture moves.",
    "remedy": "Pull the cable taut and check that the counter's wheel turns with it.",
}


def landmark(
    number: int,
    label: str,
    chainage_m: float,
    clock: float,
    *,
    status: str = "passed",
    to_m: float | None = None,
    clock_to: float | None = None,
    probability: float = 0.93,
    by_hand: bool = False,
) -> Json:
    """One LANDMARK as the device states it."""
    return {
        "id": number,
        "class": label,
        "status": status,
        "chainage_m": chainage_m,
        "chainage_to_m": chainage_m if to_m is None else to_m,
        "clock": clock,
        "clock_to": clock if clock_to is None else clock_to,
        "sigma_chainage_m": 0.04,
        "sigma_clock": 0.1,
        "hits": 31,
        "misses": 4,
        "belief": {label: probability, "false": round(1 - probability, 2)},
        "marked_by_hand": by_hand,
        "thumbnail": not by_hand,
    }


def pipe_landmarks() -> list[Json]:
    """What lies in the canned pipe, passed by."""
    return [
        landmark(1, "connection", 3.42, 2.0),
        landmark(2, "connection", 9.87, 10.0),
        landmark(3, "deposit", 14.1, 5.2, to_m=17.9, clock_to=6.9),
        landmark(4, "displaced joint", 21.0, 12.0, clock_to=11.9),
        landmark(5, "fracture", 24.6, 11.2, to_m=26.3, clock_to=0.6, probability=0.71),
        landmark(6, "roots", 30.05, 1.0, probability=0.64),
        landmark(7, "connection", 37.7, 3.1, status="confirmed"),
    ]


@cache
def cctv_jpeg(number: int, overlay: bool, heatmap: str | None = None) -> bytes:
    """A bore with rings, some lines where an overlay is asked for, and a red spot for a heatmap."""
    rng = np.random.default_rng(number)
    y, x = np.mgrid[0:432, 0:540].astype(np.float32)
    rho = np.hypot(x - 270, y - 216)
    light = np.clip(rho / 260, 0, 1) ** 0.8 * 150 + 25 * (np.abs(np.sin(2000 / np.maximum(rho, 8) + number)) > 0.96)
    picture = (np.dstack([light, light * 1.05, light * 1.1]) + rng.normal(0, 5, (432, 540, 1))).clip(0, 255).astype(np.uint8)
    if overlay:
        for radius in (40, 70, 130, 240):
            cv2.circle(picture, (270, 216), radius, (80, 220, 80), 1, cv2.LINE_AA)
    if heatmap is not None:
        cv2.circle(picture, (400, 120), 40, (40, 40, 255), -1)
    data: bytes = cv2.imencode(".jpg", picture)[1].tobytes()
    return data


class FakeDrive:
    """The facade of ``device.landmarks.desk.DriveDesk``, for the fake device that it is a part of."""

    def __init__(self, device: FakeDevice) -> None:
        self._device = device
        self._bus, self._lock, self._ids, self._stop = device._bus, device._lock, device._ids, device._stop
        self._start = device._start
        self.metres_per_second = 8.0
        self.available = True
        self.prompts: list[Json] = []
        self.faults: list[Json] = []
        self._untold: list[Json] = []
        self.grabber = {"name": "CCTV", "state": "up", "age_s": 0.03, "message": "", "fps": 25.0, "drops": 0, "reconnects": 0}
        self.encoder = {
            "name": "tether", "state": "up", "age_s": 0.05, "message": "", "fps": 20.0, "drops": 0, "reconnects": 0,
            "counts": 1200.0, "counts_per_metre": 1000.0, "direction": 1, "zero": 0.0,
        }  # fmt: skip
        self.maps: dict[int, Json] = {}
        self._drive: Json | None = None
        self._paused = threading.Event()
        self._over = threading.Event()

    def state(self) -> Json:
        with self._lock:
            going = self._drive
            chainage = going["chainage_m"] if going else None
            shown = self._seen(chainage) if chainage is not None else []
            statuses = [row["status"] for row in shown]
            return {
                "available": self.available,
                "state": going["state"] if going else "idle",
                "survey_id": going["survey_id"] if going else None,
                "pipe_id": going["pipe_id"] if going else None,
                "direction": going["direction"] if going else "downstream",
                "chainage_m": chainage,
                "sigma_m": 0.01 if going else None,
                "speed_mps": self.metres_per_second if going and going["state"] == "driving" else 0.0,
                "seconds": round(time.monotonic() - going["begun"], 1) if going else 0.0,
                "frames": int(25 * (time.monotonic() - going["begun"])) if going else 0,
                "dropped": 0,
                "fps": self.grabber["fps"],
                "grabber": dict(self.grabber),
                "encoder": dict(self.encoder),
                "prompts": list(self.prompts),
                "counts": {status: statuses.count(status) for status in ("candidate", "confirmed", "passed")},
                "progress": going["progress"] if going else None,
            }

    def befall(self, what: str, text: str) -> None:
        """Something goes wrong with the drive: told by the next event and kept."""
        with self._lock:
            chainage = self._drive["chainage_m"] if self._drive else None
            fault = {"time_s": 12.3, "chainage_m": chainage, "what": what, "text": text}
            self.faults.append(fault)
            self._untold.append(fault)

    def begin(
        self, pipe_id: int | None = None, direction: str = "downstream", radius_m: float | None = None,
        start_chainage_m: float | None = None,
    ) -> Json:  # fmt: skip
        with self._lock:
            self._device.calls.append(("start_drive", (pipe_id, direction, radius_m, start_chainage_m)))
            if not self.available:
                raise Invalid("This box has no CCTV grabber: name one in its settings.")
            if self._drive is not None:
                raise Busy("A drive is under way: end it or cancel it.")
            if pipe_id is not None and self._device.pipe(pipe_id) is None:
                raise NotFound(f"There is no pipe number {pipe_id}.")
            number = next(self._ids)
            self._drive = {
                "survey_id": number, "pipe_id": pipe_id, "direction": direction, "radius_m": radius_m or RADIUS_M,
                "state": "driving", "chainage_m": start_chainage_m or 0.0, "begun": time.monotonic(), "progress": None,
                "words": {}, "marks": [],
            }  # fmt: skip
            self._paused.clear()
            self._over.clear()
            self._start(self._go)
            return {"survey_id": number}

    def _seen(self, chainage: float) -> list[Json]:
        """The landmarks of the pipe as they stand with the crawler at ``chainage``."""
        assert self._drive is not None
        rows = []
        for row in pipe_landmarks():
            ahead = row["chainage_m"] - chainage
            if ahead > 2.0:
                continue
            row["status"] = "candidate" if ahead > 1.2 else "confirmed" if ahead > 0 else "passed"
            rows.append(row)
        rows += self._drive["marks"]
        return [with_words(row, self._drive["words"].get(row["id"], [])) for row in rows]

    def _go(self) -> None:
        told: dict[int, Json] = {}
        while not self._stop.is_set() and not self._over.wait(0.05):
            with self._lock:
                if self._drive is None:
                    return
                if self._drive["state"] == "driving" and not self._paused.is_set():
                    moved = self._drive["chainage_m"] + 0.05 * self.metres_per_second
                    self._drive["chainage_m"] = round(min(LENGTH_M, moved), 3)
                rows = self._seen(self._drive["chainage_m"])
                changed = [row for row in rows if told.get(row["id"]) != row]
                gone = [number for number in told if number not in {row["id"] for row in rows}]
                told = {row["id"]: row for row in rows}
                faults, self._untold = self._untold, []
                self._bus.publish("drive", {**self.state(), "landmarks": changed, "gone": gone, "faults": faults})

    def _going(self) -> Json:
        if self._drive is None:
            raise Invalid("No drive is under way.")
        return self._drive

    def pause(self) -> None:
        with self._lock:
            self._going()["state"] = "paused"

    def resume(self) -> None:
        with self._lock:
            self._going()["state"] = "driving"

    def cancel(self) -> None:
        with self._lock:
            self._over.set()
            self._drive = None
            self._bus.publish("drive", {**self.state(), "landmarks": []})

    def mark(self, label: str, clock: float | None = None, note: str = "") -> Json:
        with self._lock:
            going = self._going()
            number = 100 + len(going["marks"])
            row = landmark(number, label, going["chainage_m"], clock or 12.0, by_hand=True)
            if clock is None:
                row |= {"clock": None, "clock_to": None, "sigma_clock": None}
            going["marks"].append(row)
            if note:
                going["words"][number] = [{"note": note, "by": "", "created": None}]
            return with_words(row, going["words"].get(number, []))

    def end(self, length_m: float | None = None) -> Json:
        with self._lock:
            going = self._going()
            going["state"] = "finishing"
            going["progress"] = 0.0
            self._device.calls.append(("end_drive", length_m))
            self._start(self._finish)
            return {"survey_id": going["survey_id"]}

    def _finish(self) -> None:
        for step in range(5):
            if self._stop.wait(0.06):
                return
            with self._lock:
                if self._drive is None:
                    return
                self._drive["progress"] = step / 5
        with self._lock:
            going = self._going()
            self._over.set()
            self.maps[going["survey_id"]] = self._map(going, "saved")
            self._drive = None
            self._bus.publish("drive", {**self.state(), "landmarks": []})

    def _map(self, going: Json, state: str) -> Json:
        return {
            "survey_id": going["survey_id"],
            "kind": "landmarks",
            "state": state,
            "created": "2026-11-22T02:14:09Z",
            "clock_source": "browser",
            "pipe": self._device.pipe(going["pipe_id"]),
            "direction": going["direction"],
            "from_m": 0.0,
            "to_m": going["chainage_m"],
            "radius_m": going["radius_m"],
            "landmarks": self._seen(going["chainage_m"]),
            "rings": [{"chainage_m": float(metre), "sightings": 20} for metre in range(1, int(going["chainage_m"]) + 1)],
            "faults": list(self.faults),
            "focal_radius": {"value": 61.2, "sigma": 0.8},
            "scale": {"value": 1.004, "sigma": 0.002} if state == "saved" else None,
            "smoothed": state == "saved",
            "frames": 500,
            "dropped": 3,
            "seconds": round(time.monotonic() - going["begun"], 1),
        }

    def picture(self, overlay: bool = False, heatmap: str | None = None) -> bytes | None:
        return cctv_jpeg(int(time.monotonic() * 5) % 6, overlay, heatmap) if self.grabber["state"] == "up" else None

    def set_encoder(self, change: Json) -> Json:
        self.encoder |= change
        return dict(self.encoder)

    def zero_encoder(self, chainage_m: float = 0.0) -> Json:
        self.encoder["zero"] = self.encoder["counts"]
        return dict(self.encoder)

    def calibrate_encoder(self, point: str, length_m: float | None = None) -> Json:
        if point == "end" and length_m is None:
            raise Invalid("Say how long the way between the two points is.")
        if length_m is not None:
            self.encoder["counts_per_metre"] = 1000.0 * 10 / length_m
        return dict(self.encoder)

    def add(self, pipe_id: int | None = None, state: str = "saved") -> int:
        """Store a finished drive (or one that was "interrupted"); its number."""
        with self._lock:
            kept, number = self._drive, next(self._ids)
            self._drive = {
                "survey_id": number, "pipe_id": pipe_id, "direction": "downstream", "radius_m": RADIUS_M,
                "chainage_m": LENGTH_M, "begun": time.monotonic() - 120, "words": {}, "marks": [],
            }  # fmt: skip
            self.maps[number] = self._map(self._drive, state)
            self._drive = kept
            return number

    def map(self, survey_id: int) -> Json:
        with self._lock:
            if self._drive is not None and self._drive["survey_id"] == survey_id:
                return self._map(self._drive, "measuring")
            if survey_id not in self.maps:
                raise NotFound(f"There is no drive number {survey_id}.")
            return self.maps[survey_id]

    def _of(self, survey_id: int, number: int) -> Json:
        found = next((row for row in self.map(survey_id)["landmarks"] if row["id"] == number), None)
        if found is None:
            raise NotFound(f"Survey {survey_id} has no landmark number {number}.")
        return found

    def thumbnail(self, survey_id: int, number: int, heatmap: str | None = None) -> bytes | None:
        return cctv_jpeg(number % 6, False, heatmap) if self._of(survey_id, number)["thumbnail"] else None

    def change_landmark(self, survey_id: int, number: int, change: Json) -> Json:
        with self._lock:
            row = self._of(survey_id, number)
            self._device.calls.append(("change_landmark", (survey_id, number, change)))
            words = [*row["history"], {**{"by": "", "created": None}, **change}]
            if self._drive is not None and self._drive["survey_id"] == survey_id:
                self._drive["words"][number] = words
            row |= with_words(row, words)
            return row

    def rows(self) -> list[Json]:
        """The stored drives as rows of the list of surveys."""
        fields = ("from_m", "to_m", "frames", "seconds", "created", "clock_source", "state", "kind")
        empty = dict.fromkeys(("diameter_mm", "interval_mm", "dn", "final_verdict", "verdict_by"))
        return [
            {
                "id": number,
                **{field: found[field] for field in fields},
                "pipe_id": found["pipe"]["id"] if found["pipe"] else None,
                "pipe": found["pipe"]["name"] if found["pipe"] else None,
                "landmarks": sum(row["status"] != "candidate" for row in found["landmarks"]),
                "reasons": [],
                **empty,
            }
            for number, found in self.maps.items()
        ]

    def survey(self, survey_id: int) -> Json | None:
        """A stored drive as ``survey`` states it, None where there is no such drive."""
        found = self.maps.get(survey_id)
        if found is None:
            return None
        empty = dict.fromkeys(("result", "operator", "final_verdict", "verdict_by"))
        fields = ("kind", "created", "clock_source", "pipe", "state")
        return {"id": survey_id, **{field: found[field] for field in fields}, "recordings": [], **empty}
