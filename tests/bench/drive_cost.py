"""What a whole drive costs without the network (issue 3, figure 5): grab, flow, focus of expansion, rings, mapping, publishing.

python -m tests.bench.drive_cost
python -m tests.bench.drive_cost --network    with the shipped network at every second picture (issue 4, figure 4)

Pictures of 720 x 576 of the virtual demo drive are rendered beforehand into a video file; then the survey's own pipeline reads
it, with the virtual sewer's corrupted detections in place of the network's, and publishes as the page is served: the picture
with overlay and the list of landmarks at 5 Hz of the drive's time. Beside it, in the same run, the baseline: sorting 400 000
float32. Best and median of some runs, frames a second of wall time.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np

from device.fcdd.detector import shipped_detector
from device.json_text import dumps
from device.landmarks import looking
from device.landmarks.as_json import landmark_json
from device.landmarks.detectors import Detector
from device.landmarks.overlay import draw
from device.landmarks.pipeline import LandmarkPipeline
from device.landmarks.recorded_way import RecordedWay
from device.landmarks.virtual_crawler import VirtualRun
from drivers.base import EndOfRecording
from drivers.grabber.base import VideoFrame
from drivers.registry import open_grabber
from estimators.detections import Detection
from estimators.fcdd import Fcdd
from tests.bench.table import print_table

FPS = 25.0
PUBLISH_EVERY = 5
"""Pictures: 5 Hz."""


def main() -> None:
    """Print frames a second, and where the time goes."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=600)
    parser.add_argument("--skip", type=int, default=200, help="pictures of the drive that are left out at its start")
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--network", action="store_true", help="the shipped network, as this machine runs it fastest")
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    run = VirtualRun(1)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "drive.avi"
        moments = _record(run, file, arguments.skip, arguments.frames)
        way = run.way()
        told: Detector = shipped_detector() if arguments.network else _Told(run.detector(), moments)
        rates, baselines, spent = [], [], []
        for _ in range(arguments.runs):
            baselines.append(_baseline())
            begun = time.process_time()
            rates.append(_drive(run, file, way, told, moments))
            spent.append(1000 * (time.process_time() - begun) / arguments.frames)
    wanted = 40 if arguments.network else 60
    best, median = max(rates), float(np.median(rates))
    print(f"{arguments.frames} pictures of 720 x 576: best {best:.0f}, median {median:.0f} frames a second (wanted: {wanted})")
    print(f"processor time of all threads: {min(spent):.1f} ms a picture (two cores have 33.3 for 60 a second)")
    print(
        f"baseline of the same run: best {1000 * min(baselines):.1f} ms; a picture costs {1 / best / min(baselines):.2f} of it"
    )
    _stages(run, way, told, moments)


class _Told:
    """The detections of each picture, made beforehand: the network is not part of this."""

    name = "told"

    def __init__(self, detector: Detector, frames: list[VideoFrame]) -> None:
        self._told = {frame.number: detector.detect(frame) for frame in frames}

    def detect(self, frame: VideoFrame) -> tuple[Detection, ...] | None:
        """Those of this picture."""
        return self._told[frame.number]


def _record(run: VirtualRun, file: Path, skip: int, count: int) -> list[VideoFrame]:
    frames = [frame for k, frame in zip(range(skip + count), run.frames(), strict=False) if k >= skip]
    height, width = frames[0].image.shape[:2]
    writer = cv2.VideoWriter(str(file), cv2.VideoWriter_fourcc(*"MJPG"), FPS, (width, height))
    for frame in frames:
        writer.write(frame.image)
    writer.release()
    return frames


def _drive(run: VirtualRun, file: Path, way: RecordedWay, told: Detector, moments: list[VideoFrame]) -> float:
    """Frames a second."""
    pipeline = LandmarkPipeline(run.setup(), told)
    grabber = open_grabber("video", file=file)
    grabber.open()
    started = time.perf_counter()
    for k, known in enumerate(moments):
        try:
            read = grabber.read()
        except EndOfRecording:
            break
        frame = VideoFrame(read.image, known.monotonic_ns, known.number, known.media_s)
        step = pipeline.step(frame, way.at(frame.time_s))
        if k % PUBLISH_EVERY == 0:
            _publish(pipeline, frame, step)
    rate = len(moments) / (time.perf_counter() - started)
    grabber.close()
    return rate


def _publish(pipeline: LandmarkPipeline, frame: VideoFrame, step: object) -> int:
    """What the page is sent: the picture with overlay as JPEG, the landmarks as JSON."""
    image = frame.image
    if getattr(step, "view", None) is not None:
        image = draw(image, pipeline.scene(step, {}))  # type: ignore[arg-type]
    _, jpeg = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 80])
    landmarks = [landmark_json(found.id, found) for found in pipeline.landmarks(candidates=True)]
    return len(jpeg) + len(dumps(landmarks))


def _baseline() -> float:
    values = np.random.default_rng(0).random(400_000, dtype=np.float32)
    started = time.perf_counter()
    for _ in range(5):
        np.sort(values)
    return (time.perf_counter() - started) / 5


def _stages(run: VirtualRun, way: RecordedWay, told: Detector, moments: list[VideoFrame]) -> None:
    """Milliseconds a picture of each stage, averaged over all pictures (rings are not looked for in each)."""
    spent: dict[str, float] = defaultdict(float)
    stages: tuple[tuple[object, str, str], ...] = (
        (looking.Tracker, "step", "flow"),
        (looking, "estimate", "focus of expansion"),
        (looking, "find", "rings"),
        (looking.Watch, "add", "self-checks"),
        (Fcdd, "detect", "network"),
        (LandmarkPipeline, "_map", "mapping"),
        (LandmarkPipeline, "step", "all of a picture"),
    )
    with _timed(stages, spent):
        pipeline = LandmarkPipeline(run.setup(), told)
        for frame in moments:
            pipeline.step(frame, way.at(frame.time_s))
    rows = [(name, f"{1000 * spent[name] / len(moments):.2f}") for _, _, name in stages]
    print_table("Where the time goes", ("stage", "ms a picture"), rows)


@contextmanager
def _timed(stages: tuple[tuple[object, str, str], ...], spent: dict[str, float]) -> Iterator[None]:
    """While it lasts, the time in each (owner, function) is added up under its name."""

    def watched(function: Callable[..., object], name: str) -> Callable[..., object]:
        def call(*args: object, **kwargs: object) -> object:
            started = time.perf_counter()
            try:
                return function(*args, **kwargs)
            finally:
                spent[name] += time.perf_counter() - started

        return call

    kept = [(owner, attribute, getattr(owner, attribute)) for owner, attribute, _ in stages]
    try:
        for owner, attribute, name in stages:
            setattr(owner, attribute, watched(getattr(owner, attribute), name))
        yield
    finally:
        for owner, attribute, function in kept:
            setattr(owner, attribute, function)


if __name__ == "__main__":
    main()
