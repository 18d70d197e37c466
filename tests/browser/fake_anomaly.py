"""The anomaly part of the fake device: a stereo camera in a pipe with a deposit, scanned in ``seconds``.

``level`` is what the camera sees ("good", "poor" or "lost"), ``outcome`` what a scan comes to ("found" or "refused").
"""

from __future__ import annotations

import threading
from functools import cache
from typing import Any

import cv2
import numpy as np

from device.anomaly.along import joined, placed_scan
from device.anomaly.scan import concluded, refused
from device.anomaly.views import cloud, map_json, packed, unpacked, wall_png
from device.bus import Bus
from device.errors import Busy, Invalid, NotFound
from device.prompts import PROMPTS
from estimators.anomaly.deviation import DeviationMap

Json = dict[str, Any]
CAMERA = "virtual stereo camera"


@cache
def deposit_map() -> DeviationMap:
    """A pipe of 400 mm, 25 mm of deposit on its invert a metre ahead, a quarter hidden behind it, and noise."""
    rng = np.random.default_rng(6)
    theta = (np.arange(540) + 0.5) * (2 * np.pi / 540) - np.pi
    depth = 0.3 + (np.arange(240) + 0.5) * 0.005
    away = np.exp(-(((theta - np.pi / 2) / 0.35) ** 2)) * np.exp(-(((depth[:, None] - 0.95) / 0.1) ** 2))
    deviation = (rng.normal(0, 0.0008, (240, 540)) - 0.025 * away).astype(np.float32)
    hidden = (away > 0.05) & (depth[:, None] > 1.0)
    deviation[hidden | (rng.random((240, 540)) < 0.06)] = np.nan
    shape = np.ones((240, 540), np.float32)
    wall = np.ones((240, 540), bool)
    wall[-12:] = False
    return DeviationMap(
        theta, depth, deviation, 0.001 * shape, wall, hidden, 1e-5 * shape, 0.2 * shape, 0.1 * shape, 2e-4 * shape
    )


def pair_result(**other: Any) -> Json:
    """What ``device.anomaly.result`` says of one pair of it."""
    region = {"area_mm2": 21500, "peak_mm": -24.6, "volume_cm3": -310.0, "z_m": 0.95, "clock": 6.0, "from_m": 0.8, "to_m": 1.1}
    stain = {"area_mm2": 900, "peak_mm": 5.2, "volume_cm3": 3.0, "z_m": 0.6, "clock": 2.5, "from_m": 0.57, "to_m": 0.63}
    bands = [
        {
            "first_m": round(0.3 + 0.1 * k, 3),
            "last_m": round(0.4 + 0.1 * k, 3),
            "score_mm": round(0.3 + 2.4 * float(np.exp(-(((k - 6) / 1.2) ** 2))), 3),
            "outward_mm": 0.3,
            "measured": 0.94 if k < 9 else 0.4,
            "sees_mm2": 420 if k < 9 else 3300,
        }
        for k in range(12)
    ]
    return {
        "fitted": True,
        "reason": "",
        "message": "",
        "score_mm": 0.712,
        "outward_mm": 0.301,
        "outward_of": 0.62,
        "width_mm": 399.4,
        "width_interval_mm": [396.8, 402.1],
        "height_mm": None,
        "height_interval_mm": None,
        "seen_height_mm": 371.0,
        "coverage": 0.913,
        "near_m": 0.303,
        "far_m": 1.498,
        "regions": [
            {**region, "width_hours": 1.4, "kind": "deposit", "expected": False, "confidence": 0.97},
            {**stain, "width_hours": 0.5, "kind": "loss", "expected": False, "confidence": 0.64},
        ],
        "joints": [{"z_m": 1.31, "gap_mm": 12.0, "step_mm": 8.0, "offset_mm": 3.1, "offset_clock": 4.0}],
        "bands": bands,
        "smooth": [{"from_m": 1.2, "to_m": 1.5, "sees_mm2": 3300}],
        **other,
    }


class FakeCalibration:
    """The facade of ``device.calibrating.session.CalibrationSession``: each look shows one view more, ``enough`` of them end
    it."""

    def __init__(self) -> None:
        self.enough = 3
        self.board: Json = {}
        self.saved: Json | None = None
        self._stage, self._views = "idle", 0

    def start(self, board: Json) -> None:
        self.board, self._stage, self._views = board, "gathering", 0

    def finish(self) -> None:
        if self._stage != "gathering":
            raise Invalid("No calibration is under way.")
        self._stage = "failed"

    def cancel(self) -> None:
        self._stage = "idle"

    def save(self) -> None:
        self._stage, self.saved = "saved", LENSES

    def picture(self, side: str) -> bytes | None:
        return picture(False)

    def state(self) -> Json:
        if self._stage == "gathering":
            self._views += 1
            if self._views > self.enough:
                self._stage = "done"
        cells = [[6 * row + column < 8 * self._views for column in range(6)] for row in range(4)]
        return {
            "state": self._stage,
            "message": "There are 2 usable views of the board, at least 12 are needed." if self._stage == "failed" else "",
            "board": "charuco 9 x 6, 30 mm",
            "calibrated": self.saved,
            "views": self._views,
            "views_wanted": 18,
            "covered": {"left": cells, "right": cells} if self._views else None,
            "covered_wanted": 0.75,
            "tilts": dict.fromkeys(TILTS, self._views),
            "tilts_wanted": 2,
            "seen": "kept" if self._views else "",
            "next": "show it in the upper left of the left picture",
            "found": {**LENSES, "left_out": ["view 7"]} if self._stage == "done" else None,
        }


TILTS = ("left edge nearer", "right edge nearer", "upper edge nearer", "lower edge nearer")
LENSES: Json = {
    "board": "charuco 9 x 6, 30 mm",
    "views": 18,
    "reprojection_px": 0.21,
    "epipolar_px": 0.12,
    "offset_std_px": 0.08,
    "scale_percent": 0.24,
    "baseline_mm": 60.31,
}


class FakeAnomaly:
    """The facade of ``device.anomaly.desk.AnomalyDesk``."""

    def __init__(self, bus: Bus, number: Any) -> None:
        self._bus = bus
        self._number = number
        self.level = "good"
        self.outcome = "found"
        self.seconds = 0.6
        self.available = True
        self.calibration = FakeCalibration()
        self.tether: float | None = 12.34
        self.surveys: dict[int, Json] = {}
        self.calls: list[Json] = []
        self.pipe_of: Any = lambda pipe_id: None
        self._scan: Json = {"state": "idle", "survey_id": None, "frames_done": 0, "frames_wanted": 0}
        self._cancel = threading.Event()

    def look(self) -> Json:
        return self.state()

    def state(self) -> Json:
        poor = self.level == "poor"
        lost = self.level == "lost"
        camera = {
            "name": CAMERA,
            "kind": "virtual",
            "state": "lost" if lost else "up",
            "age_s": 0.2,
            "message": "Check its cables." if lost else "",
            "fps": 2.0,
            "frames": 40,
            "drops": 0,
            "reconnects": 0,
        }
        live = {
            "age_s": 0.4,
            "level": self.level,
            "matched": 0.21 if poor else 0.88,
            "around": 0.4 if poor else 1.0,
            "right": None if poor else -0.04,
            "down": None if poor else 0.12,
            "radius_mm": None if poor else 199,
            "prompt": PROMPTS["pair_too_smooth"].to_json() if poor else None,
            "frame": 40,
        }
        return {
            "available": self.available,
            "plain_cameras": self.available,
            **self._scan,
            "pairs": 3,
            "camera": camera if self.available else None,
            "live": None if lost or not self.available else live,
            "chainage_m": self.tether,
            "on_crawler": True,
        }

    def picture(self) -> bytes | None:
        return None if self.level == "lost" or not self.available else picture(False)

    def scan(self, pipe_id: int | None = None, chainage: float | None = None, pairs: int | None = None) -> Json:
        if self._scan["state"] != "idle":
            raise Busy("A measurement is under way: wait for it or cancel it.")
        self.calls.append({"pipe_id": pipe_id, "chainage_m": chainage, "pairs": pairs})
        number = next(self._number)
        self._cancel.clear()
        self._scan = {"state": "measuring", "survey_id": number, "frames_done": 0, "frames_wanted": 3}
        threading.Thread(target=self._run, args=(number, pipe_id, chainage), daemon=True).start()
        return {"survey_id": number}

    def calibrate(self, kind: str, columns: int, rows: int, square_m: float) -> None:
        self.calibration.start({"kind": kind, "columns": columns, "rows": rows, "square_m": square_m})

    def cancel(self) -> None:
        self._cancel.set()

    def _run(self, number: int, pipe_id: int | None, chainage: float | None) -> None:
        for state in ("measuring", "computing"):
            for done in range(3):
                self._scan = {**self._scan, "state": state, "frames_done": done}
                self._tell(number, state)
                if self._cancel.wait(self.seconds / 6):
                    return self._over(number, "cancelled")
        self.add(number, pipe_id, chainage)
        return self._over(number, "saved")

    def _tell(self, number: int, state: str) -> None:
        told = {key: self._scan[key] for key in ("frames_done", "frames_wanted")}
        self._bus.publish("measurement", {"kind": "anomaly", "survey_id": number, "state": state, "message": "", **told})

    def _over(self, number: int, state: str) -> None:
        self._tell(number, state)
        self._scan = {"state": "idle", "survey_id": None, "frames_done": 0, "frames_wanted": 0}

    def add(self, number: int | None = None, pipe_id: int | None = None, chainage: float | None = None) -> int:
        """A finished scan; its number."""
        number = next(self._number) if number is None else number
        seen = pair_result()
        alone = pair_result(regions=seen["regions"][:1])  # the stain shows in one of three pairs
        result = refused("pair_too_smooth", CAMERA, 3, chainage)
        if self.outcome == "found":
            result = concluded([alone, seen, alone], CAMERA, chainage)[0]
        self.surveys[number] = {
            "id": number,
            "kind": "anomaly",
            "created": "2026-11-22T09:00:00Z",
            "clock_source": "browser",
            "pipe": self.pipe_of(pipe_id),
            "state": "saved",
            "recordings": [{"id": 1, "camera": CAMERA, "position": None, "frames": 3, "result": result}],
            "result": result,
            "operator": None,
            "final_verdict": result["verdict"],
            "verdict_by": "device",
        }
        return number

    def found(self, survey_id: int) -> Json:
        survey = self._survey(survey_id)
        told = {key: survey[key] for key in ("kind", "state", "created", "pipe")}
        whole = map_json(unpacked(packed(deposit_map()))) if survey["result"]["fitted"] else None
        return {"survey_id": survey_id, **told, **survey["result"], "map": whole}

    def along(self, survey_id: int) -> Json:
        self._survey(survey_id)
        placed = [placed_scan(number, one["result"], one["result"]["chainage_m"]) for number, one in self.surveys.items()]
        return joined(placed)

    def view(self, survey_id: int, what: str) -> bytes | None:
        self._survey(survey_id)
        return picture(what == "overlay")

    def wall(self, survey_id: int) -> bytes | None:
        fitted = self._survey(survey_id)["result"]["fitted"]
        return wall_png(unpacked(packed(deposit_map()))) if fitted else None

    def cloud(self, survey_id: int) -> Json:
        return cloud(deposit_map())

    def _survey(self, survey_id: int) -> Json:
        if survey_id not in self.surveys:
            raise NotFound(f"There is no survey number {survey_id}.")
        return self.surveys[survey_id]


@cache
def picture(overlay: bool) -> bytes:
    """The bore, with a red deposit where it is one."""
    rng = np.random.default_rng(1)
    y, x = np.mgrid[0:400, 0:640].astype(np.float32)
    light = np.clip(np.hypot(x - 320, y - 200) / 260, 0, 1) ** 0.7 * 150
    bore = np.repeat(light[..., None] + rng.normal(0, 9, (400, 640, 1)), 3, axis=2)
    if overlay:
        spot = np.exp(-(((x - 320) / 70) ** 2) - ((y - 310) / 40) ** 2)[..., None] * 0.85
        bore = bore * (1 - spot) + spot * np.array([40, 40, 255])
    return cv2.imencode(".jpg", bore.clip(0, 255).astype(np.uint8))[1].tobytes()
