"""A drive computed again: the same pictures at the same places through the same pipeline, to the same map."""

from __future__ import annotations

from collections import deque
from pathlib import Path
from typing import Any

from device.errors import Invalid
from device.landmarks.detectors import Detector, NoDetector
from device.landmarks.drive_findings import Marks, filtered_rows, findings
from device.landmarks.drive_log import TETHER
from device.landmarks.pipeline import LandmarkPipeline, PipelineSetup, Step
from device.landmarks.placing import Placing
from device.recorder.reader import Entry
from device.recorder.samples import Picture
from device.surveys.topics import ENDED, MARKS, NUMBERS, STEPS
from drivers.encoder.base import Reading
from drivers.encoder.calibration import Calibration
from drivers.grabber.base import VideoFrame
from estimators.detections import Detection

Seen = tuple[Detection, ...] | None


class SaidThen:
    """The detector of the recording: it says what it said."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.said: Seen = None

    def detect(self, frame: VideoFrame) -> Seen:
        """What was said of this picture."""
        return self.said


class Again:
    """The detector asked again, about the pictures that it looked at then."""

    def __init__(self, detector: Detector, then: SaidThen) -> None:
        self.name = detector.name
        self._detector, self._then = detector, then

    def detect(self, frame: VideoFrame) -> Seen:
        """What it says of this picture, if it said anything then."""
        return None if self._then.said is None else self._detector.detect(frame)


class DriveReplay:
    """``head`` as ``surveys.drive_log`` writes it. Raises Invalid where its detector is not to be had."""

    def __init__(self, head: dict[str, Any], model: Path | None, recorded_detections: bool) -> None:
        self.missing = self.frames = 0
        setup = _setup(head["setup"])
        calibration = head["calibration"]
        self._placing = Placing(None if calibration is None else Calibration(**calibration))
        self._then = SaidThen(head["detector"]["name"])
        self._pipeline = LandmarkPipeline(setup, self._detector(head, model, recorded_detections), seed=head["seed"])
        self._pictures: deque[Picture] = deque()
        self._readings: deque[tuple[int, Reading]] = deque()
        self._placed = 0
        self._numbers: dict[int, int] = {}
        self._marks: Marks = {}
        self._end: dict[str, Any] = {"state": "finishing", "length_m": None}

    def take(self, entry: Entry) -> str | None:
        """Pictures and readings wait until it is noted that they were mapped."""
        sample = entry.sample
        if isinstance(sample, Picture):
            self._pictures.append(sample)
        elif isinstance(sample, Reading) and entry.topic == TETHER:
            self._readings.append((entry.sequence, sample))
        elif not isinstance(sample, dict):
            return None
        elif entry.topic == STEPS:
            return self._step(sample)
        elif entry.topic == NUMBERS:
            self._numbers[sample["landmark"]] = sample["number"]
        elif entry.topic == MARKS:
            self._marks[sample["number"]] = (sample["time_s"], sample["row"])
        elif entry.topic == ENDED:
            self._end = sample
        return None

    def finish(self) -> dict[str, Any]:
        """As the survey ends: the filter's map, then smoothed; as it stood where the box was switched off."""
        if self._end["state"] == "closing":
            return self._findings("interrupted", smooth=False)
        self._pipeline.finish()
        return self._findings("saved", smooth=True)

    def close(self) -> None:
        """Nothing is held."""
        self._placing.close()

    def _detector(self, head: dict[str, Any], model: Path | None, recorded_detections: bool) -> Detector:
        sha256 = head["detector"]["model"]
        if sha256 is None or recorded_detections:
            return NoDetector() if head["detector"]["name"] == NoDetector.name else self._then
        from device.fcdd.detector import same_detector

        return Again(same_detector(sha256, model), self._then)

    def _findings(self, state: str, smooth: bool) -> dict[str, Any]:
        pipeline, numbers, marks = self._pipeline, self._numbers, self._marks
        filtered = filtered_rows(pipeline, numbers, marks)
        smoothed = pipeline.smooth(length=self._end["length_m"]) if smooth else None
        filtered = filtered_rows(pipeline, numbers, marks)
        return findings(pipeline, state, filtered, numbers, marks, smoothed).to_json()

    def _step(self, told: dict[str, Any]) -> str | None:
        frame = self._find(told["monotonic_ns"])
        if frame is None:
            self.missing += 1
            return None
        if told.get("paused"):
            self._pipeline.paused()
            return None
        self._hear(told["readings"])
        self.frames += 1
        detections = told.get("detections")
        self._then.said = None if detections is None else tuple(_detection(one) for one in detections)
        step = self._pipeline.step(frame, self._placing.at(frame.time_s))
        return _line(step)

    def _find(self, monotonic_ns: int) -> VideoFrame | None:
        """The picture of that moment; those before it were never mapped."""
        waiting = self._pictures
        while waiting and waiting[0].monotonic_ns < monotonic_ns:
            waiting.popleft()
        return waiting.popleft().frame() if waiting and waiting[0].monotonic_ns == monotonic_ns else None

    def _hear(self, count: int) -> None:
        """The readings up to the ``count``-th."""
        while self._readings and self._readings[0][0] < count:
            sequence, reading = self._readings.popleft()
            self.missing += sequence - self._placed
            self._placed = sequence + 1
            self._placing.add(reading)
        self.missing += max(0, count - self._placed)
        self._placed = max(self._placed, count)


def _setup(told: dict[str, Any]) -> PipelineSetup:
    """JSON knows no tuples. Raises Invalid where this program does not know all of it."""
    values: dict[str, Any] = {name: tuple(value) if isinstance(value, list) else value for name, value in told.items()}
    try:
        return PipelineSetup(**values)
    except TypeError:
        raise Invalid("This recording was made by a newer borescout: update the program to replay it.") from None


def _detection(told: list[Any]) -> Detection:
    u, v, label, score, area, outline = told
    return Detection(u, v, label, score, area, tuple((x, y) for x, y in outline))


def _line(step: Step) -> str:
    where = "nobody knows where" if step.position is None else f"{step.position.chainage:.3f} m"
    seen = step.seen.detections if step.seen is not None else None
    labels = "not looked" if seen is None else ", ".join(one.label for one in seen) or "nothing"
    return f"frame {step.number}: {where}, {labels}{''.join(f', {code}' for code in step.prompts)}"
