"""A drive in its recording: what a replay has to know before it, and what is noted of each picture."""

from __future__ import annotations

from dataclasses import asdict, fields
from functools import partial
from typing import Any

from device.feeds.feed import GrabberFeed
from device.feeds.tap import Tap
from device.landmarks.detectors import Detector
from device.landmarks.pipeline import PipelineSetup, Step
from device.recorder import Recorder
from device.recorder.developing import DevelopingTap
from device.recorder.samples import Words
from device.recorder.schemas import topic_name
from device.recorder.versions import versions
from device.surveys.topics import ENDED, FINDINGS, MARKS, NUMBERS, PROMPTED, STEPS
from drivers.encoder.base import Reading
from drivers.encoder.calibration import Calibration
from drivers.grabber.base import VideoFrame
from estimators.landmarks.types import Observation

TETHER = "/tether"


def head(
    setup: PipelineSetup, calibration: Calibration | None, detector: Detector, seed: int, settings: dict[str, Any]
) -> dict[str, Any]:
    """What a replay has to know, JSON-ready. ``calibration`` is None where the distance is read from the picture."""
    return {
        "kind": "landmarks",
        "versions": versions(),
        "setup": {field.name: getattr(setup, field.name) for field in fields(setup) if field.name != "mapper"},
        "calibration": None if calibration is None else asdict(calibration),
        "detector": {"name": detector.name, "model": getattr(detector, "model", None)},
        "seed": seed,
        "settings": settings,
    }


def _seen(seen: Observation) -> dict[str, Any]:
    """What was made of a picture, in full: of a detector that cannot be asked again a replay takes the detections from here."""
    view = seen.view
    return {
        "chainage_m": view.position,
        "chainage_std_m": seen.position_std,
        "centre_px": view.centre,
        "centre_std_px": seen.centre_std,
        "axis_m": view.axis,
        "detections": None if seen.detections is None else [list(vars(one).values()) for one in seen.detections],
    }


class DriveLog:
    """What goes into ``recorder`` while a drive goes on. Nothing here waits."""

    def __init__(self, recorder: Recorder) -> None:
        self.recorder = recorder
        self._numbers: dict[int, int] = {}
        self._told: list[str] = []
        self._state = "driving"

    def frames(self, grabber: GrabberFeed, size: int) -> Tap[VideoFrame]:
        """The grabber's pictures as the survey is to read them: as they are recorded, where they are."""
        if not self.recorder.recording:
            return grabber.tap(size)
        topic = topic_name("grabber", grabber.name)
        return grabber.attach(DevelopingTap(size, grabber.detach, partial(self.recorder.write, topic)))

    def reading(self, reading: Reading) -> None:
        """The next reading that counts."""
        self.recorder.write(TETHER, reading)

    def step(self, frame: VideoFrame, readings: int, step: Step | None) -> None:
        """A picture was mapped, or passed over in a pause (None), after so many readings."""
        told: dict[str, Any] = {"monotonic_ns": frame.monotonic_ns, "number": frame.number, "readings": readings}
        if step is None:
            told["paused"] = True
        elif step.seen is not None:
            told |= _seen(step.seen)
        self.recorder.write(STEPS, told)

    def numbered(self, numbers: dict[int, int]) -> None:
        """The numbers that landmarks have by now."""
        for landmark in numbers.keys() - self._numbers.keys():
            self._numbers[landmark] = numbers[landmark]
            self.recorder.write(NUMBERS, {"landmark": landmark, "number": numbers[landmark]})

    def marked(self, number: int, time_s: float, row: dict[str, Any]) -> None:
        """Somebody marked a landmark by hand."""
        self.recorder.write(MARKS, {"number": number, "time_s": time_s, "row": row})

    def prompts(self, prompts: list[dict[str, str]]) -> None:
        """What the operator is told just now; what is new of it is noted."""
        for prompt in prompts:
            if prompt["code"] not in self._told:
                self.recorder.write(PROMPTED, Words(prompt["code"], f"{prompt['reason']} {prompt['remedy']}"))
        self._told = [prompt["code"] for prompt in prompts]

    def ended(self, state: str, length_m: float | None) -> None:
        """No more pictures: ``state`` "finishing" or "interrupted"."""
        self.recorder.write(ENDED, {"state": state, "length_m": length_m})

    def close(self, findings: dict[str, Any] | None, wanted: bool = True) -> None:
        """The drive is over; nothing is waited for. ``wanted``: it was not cancelled."""
        if findings is not None:
            self.recorder.write(FINDINGS, findings)
        self.recorder.close(discard=not wanted, wait_s=0.0)
