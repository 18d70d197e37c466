"""What recording costs a survey, how soon its data is safe, and whether a replay finds the same (issue 5).

python -m tests.bench.replay
python -m tests.bench.replay --rounds 1 --seconds 10 --surveys 1 --damages 20     a quick look

Depth encodings are compared on the real frames of $BORESCOUT_DATA. The drive's pictures (720 x 576) are drawn beforehand and
given as fast as the survey takes them, so that its rate is its own; it runs with the shipped network, recorded and not recorded
in turns, and the ratio of the two is the figure. Replays are of these drives and of measurements with two cameras.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import tempfile
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import lz4.frame
import numpy as np
import zstandard
from numpy.typing import NDArray

from device.clock import Clock
from device.config import RecordingSettings, Settings
from device.daemon import Device
from device.fcdd.detector import shipped_detector
from device.feeds.feed import EncoderFeed, GrabberFeed
from device.landmarks.crawler import Crawler, Optics
from device.landmarks.tether import Tether
from device.recorder.names import Name, recordings_in
from device.recorder.reader import open_recording
from device.recorder.recovery import check, recover
from device.replay.survey import replay
from device.store import Store
from device.workers import WorkerPool
from drivers.encoder.base import Encoder, Reading
from drivers.grabber.base import FrameGrabber, VideoFrame
from drivers.virtual.drive import Drive, demo_drive
from drivers.virtual.grabber import FPS, Footage
from tests.bench.table import print_table
from tests.hil import rig

_DRAWN = 100
_SKIPPED_S = 6.0


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=3, help="of the drive, recorded and not")
    parser.add_argument("--seconds", type=float, default=20.0, help="of wall time for each")
    parser.add_argument("--surveys", type=int, default=3, help="measurements to replay")
    parser.add_argument("--damages", type=int, default=200, help="cuts, and as many flips")
    arguments = parser.parse_args()
    _encodings()
    with tempfile.TemporaryDirectory() as folder:
        drives = _rates(Path(folder), arguments.rounds, arguments.seconds)
        measured = [_measurement(Path(folder) / f"measured-{number}") for number in range(arguments.surveys)]
        _replays([*drives, *measured])
        _damages(drives[0], arguments.damages)


def _encodings() -> None:
    root = os.environ.get("BORESCOUT_DATA")
    if not root:
        print("depth encodings: no real frames, set BORESCOUT_DATA")
        return
    folder = Path(root) / "realsense_pipes"
    entries = [entry for entry in json.loads((folder / "manifest.json").read_text()) if entry.get("wall_visible", True)][::4]
    frames = [np.asarray(cv2.imread(str(folder / entry["depth"]), cv2.IMREAD_UNCHANGED)) for entry in entries]
    ways: dict[str, Callable[[NDArray[Any]], Any]] = {
        "RawImage, zstd chunk (taken)": lambda frame: zstandard.compress(frame.tobytes()),
        "RawImage, lz4 chunk": lambda frame: lz4.frame.compress(frame.tobytes()),
        "PNG-16, level 1": lambda frame: cv2.imencode(".png", frame, [cv2.IMWRITE_PNG_COMPRESSION, 1])[1],
        "PNG-16, level 6": lambda frame: cv2.imencode(".png", frame, [cv2.IMWRITE_PNG_COMPRESSION, 6])[1],
    }
    rows = []
    for name, encode in ways.items():
        encode(frames[0])
        begun = time.process_time()
        size = sum(len(encode(frame)) for frame in frames)
        spent = 1000 * (time.process_time() - begun) / len(frames)
        rows.append((name, f"{size / len(frames) / 1000:.0f}", f"{size / sum(f.nbytes for f in frames):.3f}", f"{spent:.1f}"))
    print_table(
        f"depth, lossless: {len(frames)} real frames of {frames[0].shape[1]} x {frames[0].shape[0]}",
        ("way", "kB a frame", "of raw", "CPU ms"),
        rows,
    )


@dataclass
class _Run:
    """The drawn pictures, there and back again, each with where the crawler was; the next one when the last was taken."""

    drive: Drive
    pictures: list[NDArray[np.uint8]]
    number: int = 0
    chainage: float = 0.0
    feed: GrabberFeed | None = None

    def __post_init__(self) -> None:
        self.step = threading.Condition()

    def next(self) -> VideoFrame:
        deadline = time.monotonic() + 5.0
        while self.feed is not None and any(tap.waiting for tap in list(self.feed._taps)) and time.monotonic() < deadline:
            time.sleep(0.0005)
        with self.step:
            self.number += 1
            self.chainage += 0.2 / FPS
            self.step.notify_all()
        place = self.number % (2 * len(self.pictures) - 2)
        place = place if place < len(self.pictures) else 2 * len(self.pictures) - 2 - place
        return VideoFrame(self.pictures[place], time.monotonic_ns(), self.number, media_s=self.number / FPS)


class _Grabber(FrameGrabber):
    name = "drawn CCTV"

    def __init__(self, run: _Run) -> None:
        self._run = run

    def _open(self) -> None: ...

    def _read(self, timeout_s: float) -> VideoFrame:
        return self._run.next()

    def close(self) -> None: ...


class _Counter(Encoder):
    name = "drawn tether"

    def __init__(self, run: _Run) -> None:
        self._run, self._told = run, -1

    def _open(self) -> None: ...

    def _read(self, timeout_s: float) -> Reading:
        with self._run.step:
            self._run.step.wait_for(lambda: self._run.number > self._told, timeout_s)
            self._told = self._run.number
            return Reading(self._run.chainage, time.monotonic_ns(), "m", 0.001, media_s=self._told / FPS)

    def close(self) -> None: ...


def _rates(folder: Path, rounds: int, seconds: float) -> list[Path]:
    drive = demo_drive(1)
    footage = Footage(drive)
    pictures = [footage.picture(_SKIPPED_S + k / FPS, k) for k in range(_DRAWN)]
    rows, kept, rates, own = [], [], {True: [], False: []}, {True: [], False: []}
    for turn in range(rounds):
        for recorded in (True, False):
            where = folder / f"drive-{turn}-{recorded}"
            told = _drive(where, _Run(drive, pictures), recorded, seconds)
            rates[recorded].append(told["rate"])
            own[recorded].append(told["own_ms"])
            what = "recorded" if recorded else "not recorded"
            rows.append(
                (
                    f"{turn + 1}, {what}",
                    f"{told['rate']:.2f}",
                    f"{told['own_ms']:.2f}",
                    f"{told['cpu_ms']:.1f}",
                    told["dropped"],
                    told["worst"],
                    told["mb"],
                )
            )
            if recorded:
                kept.append(where / "recordings" / str(Name(1, 1, 1)))
    header = (
        "round",
        "frames/s",
        "its thread, CPU ms a frame",
        "all, CPU ms a frame",
        "dropped",
        "longest unsynced, s",
        "MB a minute at 25/s",
    )
    print_table("a drive with the network, as fast as it goes", header, rows)
    rate, thread = (float(np.median(values[True]) / np.median(values[False])) for values in (rates, own))
    print(f"  recorded to not recorded, medians: frames a second {rate:.3f}, CPU of the survey's thread a frame {thread:.3f}")
    return kept


def _drive(folder: Path, run: _Run, recorded: bool, seconds: float) -> dict[str, Any]:
    def crawler(store: Store) -> Crawler:
        grabber = GrabberFeed("drawn CCTV", "virtual", lambda: _Grabber(run))
        tether = Tether(EncoderFeed("drawn tether", "virtual", lambda: _Counter(run)), store.remembered, 1.0)
        camera = run.drive.camera
        run.feed = grabber
        optics = Optics((camera.fx, camera.fy), (camera.cx, camera.cy))
        return Crawler(grabber, tether, None, shipped_detector, lambda: optics, run.drive.sewer.radius)

    settings = Settings(data_dir=folder, recording=RecordingSettings(enabled=recorded, keep_free_mb=100, stop_free_mb=100))
    device = Device(settings, feeds=[], pool=WorkerPool(1), clock=Clock(folder / "none"), crawler=crawler).start()
    try:
        while device.drive.state()["encoder"]["state"] != "up" or device.drive.state()["grabber"]["state"] != "up":
            time.sleep(0.05)
        device.drive.begin()
        while device.drive.state()["frames"] < 20:
            time.sleep(0.05)
        before, begun, cpu, own = device.drive.state()["frames"], time.monotonic(), time.process_time(), _survey_s()
        time.sleep(seconds)
        frames, spent, own = device.drive.state()["frames"] - before, time.process_time() - cpu, _survey_s() - own
        rate = frames / (time.monotonic() - begun)
        status = device.status()["recording"]["now"][-1]
        size = status["bytes"] / max(1, status["written"]) * 2
        device.drive.end()
        while device.drive.state()["state"] != "idle":
            time.sleep(0.05)
    finally:
        device.close()
    return {
        "rate": rate,
        "cpu_ms": 1000 * spent / max(1, frames),
        "own_ms": 1000 * own / max(1, frames),
        "dropped": status["dropped"] if recorded else "-",
        "worst": f"{status['worst_s']:.2f}" if recorded else "-",
        "mb": f"{60 * FPS * size / 1e6:.0f}" if recorded else "-",
    }


def _survey_s() -> float:
    """CPU seconds of the survey's own thread so far: where cores are free, its rate is one over its time a frame."""
    (thread,) = [thread for thread in threading.enumerate() if thread.name.startswith("drive ")]
    assert thread.ident is not None  # it runs
    return time.clock_gettime(time.pthread_getcpuclockid(thread.ident))


def _measurement(folder: Path) -> Path:
    box = rig.Bench(folder, rig.PipeCamera("left", 0.1), rig.PipeCamera("right", 0.12, noise=0.05), frames=50)
    try:
        box.up()
        box.finish(box.device.measure()["survey_id"])
    finally:
        box.close()
    return recordings_in(folder / "recordings")[0]


def _replays(files: list[Path]) -> None:
    rows = []
    for path in files:
        outcome = replay(path)
        told = {None: "nothing to compare", True: "bit for bit", False: f"{len(outcome.differences)} values differ"}[
            outcome.equal
        ]
        speed = outcome.recorded_s / outcome.replay_s
        rows.append((outcome.kind, outcome.frames, outcome.missing, told, f"{outcome.recorded_s:.1f}", f"{speed:.1f}"))
    print_table("replays", ("survey", "frames", "missing", "findings", "recorded, s", "times as fast"), rows)


def _damages(path: Path, count: int) -> None:
    whole = path.read_bytes()
    chance = random.Random(1)
    messages = check(path).messages
    samples = sum(1 for _ in open_recording(path).entries())
    target = path.with_name("survey-000099-01-001.mcap")
    rows = []
    for what in ("cut", "flip"):
        unreadable, lost, losses = 0, [], []
        for _ in range(count):
            at = chance.randrange(len(whole))
            data = bytearray(whole[:at] if what == "cut" else whole)
            if what == "flip":
                data[at] ^= 1 << chance.randrange(8)
            target.write_bytes(data)
            report = recover(target)
            unreadable += not check(target).ok
            lost.append(report.lost_seconds)
            losses.append(messages - report.messages)
        told = f"{max(losses)} of {messages}" if what == "flip" else "-"
        rows.append((what, count, unreadable, told, f"{max(lost):.3f}"))
    target.unlink(missing_ok=True)
    header = ("damage", "tried", "not whole after recovery", "most messages lost", "most seconds lost")
    print_table(f"damage to a recording of {samples} samples, {len(whole) / 1e6:.1f} MB", header, rows)


if __name__ == "__main__":
    main()
