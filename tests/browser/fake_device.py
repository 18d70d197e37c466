"""A device without cameras: the facade of `device.daemon.Device` over canned answers, steered by a test.

`scene` chooses what the cameras seem to see ("good", "poor", "none" or "lost") and `outcome` what the next measurement finds
("accept", "retry", "second", or "failed" for none).
"""

import itertools
import math
import queue
import tempfile
import threading
import time
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from device.access import Access
from device.bus import Bus, Subscription
from device.errors import Busy, Invalid, NotFound
from device.recorder.desk import GONE
from device.store.database import Database
from device.store.places import Places
from tests.browser.fake_alone import FakeAlone
from tests.browser.fake_anomaly import FakeAnomaly
from tests.browser.fake_box import FakeBox
from tests.browser.fake_drive import FakeDrive
from tests.browser.fake_structure import FakeStructure
from tests.pairing import PIN

Json = dict[str, Any]

AIM = {
    "code": "aim",
    "reason": "The box points past the pipe's axis.",
    "remedy": "Turn the rod until the circle lies on the wall all round.",
}
NO_PIPE = {"code": "no_pipe", "reason": "No pipe is in view.", "remedy": "Lower the box until the opening fills the picture."}
UNSTABLE = {
    "code": "unstable",
    "reason": "The radius changed from frame to frame.",
    "remedy": "Rest the box on the invert and measure again.",
}
CAMERA_LOST = {
    "code": "camera_lost",
    "reason": "The camera stopped sending pictures.",
    "remedy": "Check its cable, then measure again.",
}
SECOND = {
    "code": "second_position",
    "reason": "Pipes above 250 mm need a second position.",
    "remedy": "Move the box to the middle of the pipe and measure again.",
}


def circles(shift: float = 0.0) -> list[list[list[float]]]:
    """The fitted circle at two depths, in fractions of the picture."""
    rings = []
    for centre_x, centre_y, radius in ((0.5 + shift, 0.5, 0.42), (0.52 + shift, 0.5, 0.22)):
        angles = np.linspace(0, 2 * np.pi, 49)
        rings.append(
            [
                [round(float(centre_x + radius * 480 / 848 * np.cos(a)), 4), round(float(centre_y + radius * np.sin(a)), 4)]
                for a in angles
            ]
        )
    return rings


def result(outcome: str, position: str = "top") -> Json:
    """A finding as `device.diameter.result` makes it."""
    rng = np.random.default_rng({"accept": 1, "retry": 2, "second": 3}[outcome])
    good = outcome == "accept"
    spread = 0.6 if good else 22.0
    diameters = [round(float(v), 1) for v in rng.normal(398.2, spread, 50)]
    frames: list[Json] = [
        {"diameter_mm": d, "inlier_share": 0.83, "mse_mm2": 6.1, "orientation": 0.99} for d in diameters[: 50 if good else 44]
    ] + [{"diameter_mm": None, "inlier_share": None, "mse_mm2": None, "orientation": None}] * (0 if good else 6)
    angles = list(range(0, 360, 5))
    radii: list[float | None] = []
    for angle in angles:
        seen = not 60 <= angle <= 120 if good else not 20 <= angle <= 200
        radii.append(round(199.1 + 1.8 * math.cos(math.radians(2 * angle)) + float(rng.normal(0, 0.3)), 1) if seen else None)
    prompts = {"accept": [], "retry": [UNSTABLE, AIM], "second": [SECOND]}[outcome]
    return {
        "verdict": "accept" if good else "retry",
        "reasons": [prompt["code"] for prompt in prompts],
        "prompts": prompts,
        "warnings": [] if good else [{"code": "reference", "text": "The map says DN 300; the measurement says DN 400."}],
        "diameter_mm": 398.2,
        "interval_mm": [395.0, 401.4] if good else [351.0, 446.0],
        "radius_std_mm": spread / 2,
        "mean_mm": 398.3,
        "inlier_weighted_mean_mm": 398.2,
        "dn": {
            "name": "DN 400",
            "probability": 0.98 if good else 0.61,
            "alternatives": [{"name": "DN 375", "probability": 0.02 if good else 0.3}],
        },
        "reference": {"dn": 400 if good else 300, "agrees": good},
        "profile": {
            "minimum_mm": 394.9,
            "maximum_mm": 401.8,
            "mean_mm": 398.4,
            "ovality_percent": 0.9,
            "coverage_deg": 300 if good else 180,
            "angles_deg": angles,
            "radii_mm": radii,
            "water": {"depth_mm": 48.0, "width_mm": 262.0, "from_clock": 5.0, "to_clock": 7.0} if good else None,
        },
        "proxies": {
            "inlier_share": {"mean": 0.83, "std": 0.02},
            "mse_mm2": {"mean": 6.1, "std": 0.8},
            "radius_mm": {"mean": 199.1, "std": spread / 2},
            "orientation": {"mean": 0.99, "std": 0.01},
        },
        "frames": frames,
        "picture": {"good": good, "reasons": [] if good else ["blur"]},
        "questions": [
            {"code": "image_good", "text": "Is the picture sharp, clean and well lit?", "measured": good},
            {"code": "cloud_is_pipe", "text": "Does the point cloud look like a pipe?", "measured": True},
            {"code": "fit_aligned", "text": "Does the fitted cylinder lie on the points?", "measured": True if good else None},
        ],
        "position": position,
        "camera": "front",
        "frames_used": len(diameters),
    }


@cache
def depth_jpeg(number: int) -> bytes:
    """A depth picture as the box would colour it: rings of a pipe, an end, some holes."""
    rng = np.random.default_rng(number)
    y, x = np.mgrid[0:360, 0:640].astype(np.float32)
    distance = 0.2 * 270 / np.maximum(np.hypot(x - 320, (y - 180)), 12)
    shade = np.clip(255 - distance * 95, 0, 255).astype(np.uint8)
    picture = cv2.applyColorMap(shade, cv2.COLORMAP_TURBO)
    picture[rng.random((45, 80)).repeat(8, 0).repeat(8, 1) < 0.03] = 0
    return cv2.imencode(".jpg", picture)[1].tobytes()


@cache
def color_jpeg(number: int) -> bytes:
    """A colour picture: a lit concrete bore."""
    rng = np.random.default_rng(number)
    y, x = np.mgrid[0:360, 0:640].astype(np.float32)
    light = np.clip(np.hypot(x - 320, y - 180) / 230, 0, 1) ** 0.7
    picture = (
        (np.dstack([light * 120, light * 140, light * 150]) + rng.normal(0, 6, (360, 640, 1))).clip(0, 255).astype(np.uint8)
    )
    return cv2.imencode(".jpg", picture)[1].tobytes()


class FakeRecordings:
    """The facade of ``device.recorder.desk.RecordingDesk``: each survey of ``device`` has the one file, if any."""

    def __init__(self, device: "FakeDevice") -> None:
        self._device = device

    def of(self, survey_id: int) -> Json:
        self._device.survey(survey_id)
        if self._device.raw is None:
            return {"state": "gone", "message": GONE, "dropped": 0, "files": []}
        name, size = f"survey-{survey_id:06d}-01-001.mcap", self._device.raw.stat().st_size
        return {"state": "kept", "message": "", "dropped": 0, "files": [{"take": 1, "part": 1, "file": name, "bytes": size}]}

    def file(self, survey_id: int, take: int, part: int) -> Path:
        self._device.survey(survey_id)
        if self._device.raw is None or (take, part) != (1, 1):
            raise NotFound(f"Survey {survey_id} has no such recording.")
        return self._device.raw


@dataclass
class FakeDevice(FakeAlone, FakeBox):
    """The facade over canned answers; thread-safe enough for a web server."""

    scene: str = "good"
    outcome: str = "accept"
    seconds: float = 1.5
    calls: list[tuple[str, Any]] = field(default_factory=list)
    clock_source: str = "none"
    kept: tuple[str, ...] = ("color", "depth")
    """The kinds of picture that the recordings keep."""
    raw: Path | None = Path(__file__)
    """What is handed out as a survey's raw data; None where it is gone."""

    def __post_init__(self) -> None:
        self._lock = threading.RLock()
        self._bus = Bus()
        self.access = Access(PIN, publish=lambda state: self._bus.publish("control", state))
        self._ids = itertools.count(1)
        self._folder = tempfile.TemporaryDirectory()
        self._database = Database(Path(self._folder.name))
        self.places = Places(self._database)
        self._surveys: dict[int, Json] = {}
        self._deleted: dict[int, Json] = {}
        self._survey: Json = {"state": "idle", "survey_id": None, "frames_done": 0, "frames_wanted": 0, "position": None}
        self._cancel = threading.Event()
        self._stop = threading.Event()
        self._started = time.monotonic()
        self._lost_since: float | None = None
        self._depth = [depth_jpeg(n) for n in range(6)]
        self._color = [color_jpeg(n) for n in range(6)]
        self._threads: queue.SimpleQueue[threading.Thread] = queue.SimpleQueue()
        self.recordings = FakeRecordings(self)
        self.set_up_box()
        self.drive = FakeDrive(self)
        self.structure = FakeStructure(self._bus)
        self.anomaly = FakeAnomaly(self._bus, self._ids)
        self.anomaly.pipe_of = self.pipe
        self._start(self._publish)

    def _start(self, target: Any, *args: Any) -> None:
        thread = threading.Thread(target=target, args=args, daemon=True)
        self._threads.put(thread)
        thread.start()

    def _publish(self) -> None:
        for tick in itertools.count():
            if self._stop.wait(0.25):
                return
            self._bus.publish("live", self.live())
            if tick % 4 == 0:
                self._bus.publish("status", self.status())

    def _frame(self) -> int:
        return int((time.monotonic() - self._started) * 15)

    def status(self) -> Json:
        lost = self.scene == "lost"
        if lost and self._lost_since is None:
            self._lost_since = time.monotonic()
        if not lost:
            self._lost_since = None
        age = time.monotonic() - self._lost_since if self._lost_since is not None else 0.04
        return {
            "version": "0.1.0",
            "autonomy": self.autonomy(),
            "uptime_s": round(time.monotonic() - self._started, 1),
            "cameras": [
                {
                    "name": "front",
                    "kind": "virtual",
                    "state": "lost" if lost else "up",
                    "age_s": round(age, 2),
                    "fps": 0.0 if lost else 29.8,
                    "frames": self._frame(),
                    "drops": 3,
                    "reconnects": 1,
                    "bad_frames": 0,
                    "message": "No frame arrives; reopening the camera." if lost else "",
                }
            ],
            "survey": dict(self._survey),
            "storage": {"free_mb": 11840},
            "clock": {"source": self.clock_source},
            "prompts": self.box_prompts(),
            "lamp": self.lamp_state,
        }

    def live(self) -> Json | None:
        if self.scene == "lost":
            return None
        number = self._frame()
        wobble = math.sin(number / 5)
        summary: Json = {
            "good": {
                "diameter_mm": round(398.2 + wobble, 1),
                "interval_mm": [395.0, 401.4],
                "radius_std_mm": 0.3,
                "trust": 0.92,
                "level": "good",
                "reasons": [],
                "prompt": None,
                "circle": circles(0.01 * wobble),
            },
            "poor": {
                "diameter_mm": round(431.0 + 20 * wobble, 1),
                "interval_mm": [380.0, 482.0],
                "radius_std_mm": 12.0,
                "trust": 0.24,
                "level": "poor",
                "reasons": ["aim", "unstable"],
                "prompt": AIM,
                "circle": circles(0.08),
            },
            "none": {
                "diameter_mm": None,
                "interval_mm": None,
                "radius_std_mm": None,
                "trust": 0.0,
                "level": "none",
                "reasons": ["no_pipe"],
                "prompt": NO_PIPE,
                "circle": [],
            },
        }[self.scene]
        return {"camera": "front", "frame": number, "age_s": 0.05, **summary}

    def picture(self, kind: str, camera: str | None = None) -> bytes | None:
        if camera not in (None, "front"):
            raise NotFound(f"There is no camera named {camera}.")
        if self.scene == "lost":
            return None
        return (self._depth if kind == "depth" else self._color)[self._frame() % 6]

    def survey_picture(self, survey_id: int, kind: str) -> bytes | None:
        self.survey(survey_id)
        if kind not in self.kept:
            return None
        return depth_jpeg(0) if kind == "depth" else color_jpeg(0)

    def cloud(self, survey_id: int | None) -> Json:
        if survey_id in self.anomaly.surveys:
            return self.anomaly.cloud(survey_id)
        if survey_id is not None:
            self.survey(survey_id)
        rng = np.random.default_rng(5)
        angle, z = rng.uniform(-np.pi, np.pi, 1500), rng.uniform(0.3, 2.0, 1500)
        radius = 0.199 + rng.normal(0, 0.002, 1500)
        inlier = rng.random(1500) > 0.1
        radius[~inlier] *= rng.uniform(0.2, 1.1, 1500)[~inlier]
        points = np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=1).round(3)
        cylinder = {"axis": [0.0, 0.0, 1.0], "point": [0.0, 0.0, 0.0], "radius": 0.199, "from": 0.3, "to": 2.0}
        return {"points": points.tolist(), "inlier": inlier.astype(int).tolist(), "cylinder": cylinder}

    def subscribe(self) -> Subscription:
        return self._bus.subscribe()

    def pipe(self, pipe_id: int | None) -> Json | None:
        """A copy of the pipe, or None where there is none."""
        return next((pipe for pipe in self.places.pipes() if pipe["id"] == pipe_id), None)

    def measure(self, pipe_id: int | None, position: str | None, frames: int | None, survey_id: int | None) -> Json:
        with self._lock:
            self.calls.append(("measure", (pipe_id, position, frames, survey_id)))
            if self._survey["state"] != "idle":
                raise Busy("A measurement is already running.")
            if pipe_id is not None and self.pipe(pipe_id) is None:
                raise NotFound(f"There is no pipe {pipe_id}.")
            if survey_id is not None and survey_id not in self._surveys:
                raise NotFound(f"There is no survey {survey_id}.")
            if self.scene == "lost":
                raise Invalid("No camera delivers frames; wait until one is back.")
            number = survey_id if survey_id is not None else next(self._ids)
            wanted = frames or 50
            self._survey = {
                "state": "measuring",
                "survey_id": number,
                "frames_done": 0,
                "frames_wanted": wanted,
                "position": position,
            }
            self._cancel.clear()
            self._start(self._run, number, pipe_id, position or "top", wanted)
            return {"survey_id": number}

    def _tell(self, state: str, message: str = "") -> None:
        survey = self._survey
        data = {key: survey[key] for key in ("survey_id", "frames_done", "frames_wanted")}
        self._bus.publish("measurement", {"kind": "diameter", **data, "state": state, "message": message})

    def _run(self, number: int, pipe_id: int | None, position: str, wanted: int) -> None:
        for done in range(1, wanted + 1):
            if self._cancel.wait(self.seconds / wanted):
                self._tell("cancelled", "The measurement was cancelled.")
                self._idle()
                return
            self._survey["frames_done"] = done
            self._tell("measuring")
        self._survey["state"] = "computing"
        self._tell("computing")
        time.sleep(0.2)
        if self.outcome == "failed":
            self._tell("failed", CAMERA_LOST["reason"])
            self._bus.publish("prompt", {"kind": "diameter", "survey_id": number, **CAMERA_LOST})
        else:
            self.add_survey(number, pipe_id, position, self.outcome)
            self._tell("saved")
        self._idle()

    def _idle(self) -> None:
        self._survey = {"state": "idle", "survey_id": None, "frames_done": 0, "frames_wanted": 0, "position": None}
        self._bus.publish("status", self.status())

    def add_survey(self, number: int | None, pipe_id: int | None, position: str, outcome: str) -> int:
        """Store a finished survey, or a further recording of one; returns its number."""
        with self._lock:
            number = number or next(self._ids)
            finding = result(outcome, position)
            survey = self._surveys.get(number) or {
                "id": number,
                "kind": "diameter",
                "created": "2026-11-22T02:14:09Z",
                "clock_source": "browser",
                "pipe": self.pipe(pipe_id),
                "state": "done",
                "recordings": [],
                "operator": None,
            }
            recordings = survey["recordings"]
            recordings.append(
                {"id": len(recordings) + 1, "camera": "front", "position": position, "frames": 50, "result": finding}
            )
            survey |= {"result": finding, "final_verdict": finding["verdict"], "verdict_by": "device"}
            self._surveys[number] = survey
            return number

    @property
    def measured(self) -> tuple[Any, ...]:
        """The arguments of the last call of `measure`."""
        arguments: tuple[Any, ...] = next(value for name, value in reversed(self.calls) if name == "measure")
        return arguments

    def cancel(self) -> None:
        self._cancel.set()

    def surveys(self, pipe_id: int | None = None, limit: int = 50, before: int | None = None) -> list[Json]:
        rows = []
        for survey in sorted(self._surveys.values(), key=lambda survey: -survey["id"]):
            pipe = survey["pipe"]
            if (pipe_id is not None and (pipe is None or pipe["id"] != pipe_id)) or (
                before is not None and survey["id"] >= before
            ):
                continue
            finding = survey["result"]
            rows.append(
                {
                    "id": survey["id"],
                    "created": survey["created"],
                    "pipe": pipe["name"] if pipe else None,
                    "diameter_mm": finding["diameter_mm"],
                    "interval_mm": finding["interval_mm"],
                    "dn": finding["dn"],
                    "final_verdict": survey["final_verdict"],
                    "reasons": finding["reasons"],
                }
            )
        for number, survey in self.anomaly.surveys.items():
            pipe = survey["pipe"] or {"id": None, "name": None}
            if pipe_id in (None, pipe["id"]) and (before is None or number < before):
                shown = {key: survey[key] for key in ("id", "kind", "created", "final_verdict")}
                rows.append({**shown, **survey["result"], "pipe": pipe["name"]})
        for row in self.drive.rows():
            if pipe_id in (None, row["pipe_id"]) and (before is None or row["id"] < before):
                rows.append(row)
        return sorted(rows, key=lambda row: -row["id"])[:limit]

    def survey(self, survey_id: int) -> Json:
        drive = self.drive.survey(survey_id)
        if drive is not None:
            return drive
        if survey_id in self.structure.maps:
            return {**self.structure.map(survey_id), "id": survey_id, "pipe": None, "result": None}
        if survey_id in self.anomaly.surveys:
            return self.anomaly.surveys[survey_id]
        if survey_id not in self._surveys:
            raise NotFound(f"There is no survey {survey_id}.")
        return self._surveys[survey_id]

    def answer(self, survey_id: int, data: Json) -> Json:
        survey = self.survey(survey_id)
        if data["verdict"] == "accept" and survey["result"]["verdict"] == "retry":
            raise Invalid("The device refused this measurement; it cannot be accepted by hand.")
        answers = {key: data[key] for key in ("image_good", "cloud_is_pipe", "fit_aligned")}
        said = {key: data[key] for key in ("verdict", "by", "note")}
        history = [*(survey["operator"] or {"history": []})["history"], {**answers, **said}]
        survey["operator"] = {"answers": answers, **said, "history": history}
        refused = data["verdict"] == "retry" or False in answers.values()
        if refused:
            survey["final_verdict"] = "retry"
        else:
            survey["final_verdict"] = survey["result"]["verdict"]
        both = data["verdict"] == survey["result"]["verdict"]
        survey["verdict_by"] = "both" if both else "operator" if refused else "device"
        return survey

    def delete_survey(self, survey_id: int) -> None:
        self.survey(survey_id)
        shelf = self.drive.maps if survey_id in self.drive.maps else self._surveys
        self._deleted[survey_id] = shelf.pop(survey_id)

    def restore_survey(self, survey_id: int) -> None:
        if survey_id not in self._deleted:
            raise NotFound(f"There is no deleted survey {survey_id}.")
        back = self._deleted.pop(survey_id)
        (self.drive.maps if "landmarks" in back else self._surveys)[survey_id] = back

    def set_clock(self, epoch_ms: int) -> None:
        self.calls.append(("set_clock", epoch_ms))
        self.clock_source = "browser"

    def close(self) -> None:
        self._stop.set()
        self.structure.close()
        self._cancel.set()
        while not self._threads.empty():
            self._threads.get().join(timeout=5)
        self._bus.close()
        self._database.close()
        self._folder.cleanup()
