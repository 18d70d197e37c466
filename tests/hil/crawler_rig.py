"""A crawler on a bench: pictures of a textured pipe, a tether, a detector that knows the truth, all on one virtual clock.

The clock goes with the pictures, so that a drive of a minute takes seconds and comes out the same on a slow machine. Faults are
strings that a test sets while the drive goes on.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from device.clock import Clock
from device.config import Settings
from device.daemon import Device
from device.feeds.feed import EncoderFeed, GrabberFeed
from device.feeds.reader import FeedTiming
from device.landmarks.crawler import Crawler, Optics
from device.landmarks.tether import Tether
from device.store import Store
from device.workers import WorkerPool
from drivers.base import FrameTimeout, SensorLost
from drivers.encoder.base import Encoder, Reading
from drivers.grabber.base import FrameGrabber, VideoFrame
from estimators.detections import Detection
from estimators.landmarks.projection import PipeCamera, View, project
from tests.pairing import PIN
from tests.waiting import wait_until

CAMERA = PipeCamera(170.0, 170.0, 0.15, 240, 192)
CENTRE = (119.5, 95.5)
TIMING = FeedTiming(read_s=3.0, read_limit_s=10.0, stale_s=5.0, back_off_s=(0.05, 0.1), faults_before_reopen=2)
FPS = 25.0
COUNTS_PER_METRE = 1000.0
SIGHT_M = (0.12, 1.4)


@dataclass(frozen=True)
class Thing:
    """A landmark: what, where along (m), where around (rad)."""

    label: str
    chainage: float
    angle: float


class Bench:
    """The pipe, the crawler in it, and a device that maps it."""

    def __init__(self, folder: Path, things: Sequence[Thing], speed: float = 0.4, period_s: float = 0.008) -> None:
        self.things = tuple(things)
        self.speed = speed
        self.period_s = period_s
        self.moving = True
        self.counter_offset = 0.0
        self.grabber = BenchGrabber(self)
        self.encoder = BenchEncoder(self)
        self.position = 0.0
        self.time_s = 0.0
        self.step = threading.Condition()
        self._pictures = PipePictures()
        self.tether: Tether | None = None
        self.feed: GrabberFeed | None = None
        self.device = Device(
            Settings(data_dir=folder, pin=PIN), feeds=[], pool=WorkerPool(1), clock=Clock(folder / "x"), crawler=self._crawler
        )
        self.ear = self.device.subscribe()
        self.device.start()

    def _crawler(self, store: Store) -> Crawler:
        grabber = GrabberFeed("bench CCTV", "virtual", lambda: self.grabber, timing=TIMING)
        feed = EncoderFeed("bench tether", "virtual", lambda: self.encoder, timing=TIMING)
        self.feed = grabber
        self.tether = Tether(feed, store.remembered, COUNTS_PER_METRE)
        optics = Optics((CAMERA.fx, CAMERA.fy), CENTRE)
        return Crawler(grabber, self.tether, None, lambda: Truth(self), lambda: optics, CAMERA.radius)

    def tick(self) -> tuple[float, NDArray[np.uint8]]:
        """The next moment: its time and its picture."""
        time.sleep(self.period_s)
        self._wait_for_the_survey()
        with self.step:
            self.time_s += 1 / FPS
            if self.moving:
                self.position += self.speed / FPS
            self.step.notify_all()
        return self.time_s, self._pictures.at(self.position)

    def _wait_for_the_survey(self) -> None:
        """However slow the machine is, no picture is lost for it: the next one comes when the last one was taken."""
        feed, deadline = self.feed, time.monotonic() + 1.0
        while feed is not None and any(tap.waiting for tap in list(feed._taps)) and time.monotonic() < deadline:
            time.sleep(0.001)

    def up(self) -> Bench:
        """Wait until pictures and distances come."""
        self.wait(lambda: all(self.device.drive.state()[which]["state"] == "up" for which in ("grabber", "encoder")))
        return self

    def drive_to(self, chainage: float, within_s: float = 60.0) -> None:
        """Wait until the crawler is there."""
        self.wait(lambda: self.position >= chainage, within_s)

    def finished(self, within_s: float = 60.0) -> None:
        """Wait until the box has done with the drive."""
        self.wait(lambda: self.device.drive.state()["state"] == "idle", within_s)

    @staticmethod
    def wait(condition: Callable[[], Any], within_s: float = 30.0) -> None:
        wait_until(condition, within_s)

    def close(self) -> None:
        self.device.close()


class BenchGrabber(FrameGrabber):
    """Faults: "silent", "lost", "stall" (one picture comes 100 ms late)."""

    name = "bench CCTV"

    def __init__(self, bench: Bench) -> None:
        self.fault = ""
        self._bench = bench
        self._number = 0

    def _open(self) -> None:
        if self.fault == "lost":
            raise SensorLost("The CCTV signal is gone.")

    def _read(self, timeout_s: float) -> VideoFrame:
        moment, image = self._bench.tick()
        self._number += 1
        if self.fault == "silent":
            raise FrameTimeout("The CCTV sends nothing.")
        if self.fault == "lost":
            raise SensorLost("The CCTV signal is gone.")
        if self.fault == "stall":
            self.fault = ""
            time.sleep(0.1)
        return VideoFrame(image, time.monotonic_ns(), self._number, media_s=moment)

    def close(self) -> None: ...


class BenchEncoder(Encoder):
    """Counts at every picture. Faults: "unplugged"."""

    name = "bench tether"

    def __init__(self, bench: Bench) -> None:
        self.fault = ""
        self._bench = bench
        self._told = -1.0

    def _open(self) -> None:
        if self.fault == "unplugged":
            raise SensorLost("The tether encoder is not plugged in.")

    def _read(self, timeout_s: float) -> Reading:
        bench = self._bench
        with bench.step:
            if not bench.step.wait_for(lambda: bench.time_s > self._told, timeout_s):
                raise FrameTimeout("The tether encoder says nothing.")
            self._told, position = bench.time_s, bench.position
        if self.fault == "unplugged":
            raise SensorLost("The tether encoder is not plugged in.")
        counts = round((position + bench.counter_offset) * COUNTS_PER_METRE)
        return Reading(float(counts), time.monotonic_ns(), media_s=self._told)

    def close(self) -> None: ...


class Truth:
    """A detector that sees every landmark in sight, a little beside where it is."""

    name = "truth"

    def __init__(self, bench: Bench) -> None:
        self._bench = bench
        self._rng = np.random.default_rng(3)

    def detect(self, frame: VideoFrame) -> tuple[Detection, ...]:
        position = _position_of(self._bench, frame)
        near = [thing for thing in self._bench.things if SIGHT_M[0] < thing.chainage - position < SIGHT_M[1]]
        if not near:
            return ()
        states = np.array([(thing.chainage, thing.angle) for thing in near])
        pixels = project(CAMERA, View(position, CENTRE), states) + self._rng.normal(0, 1.5, (len(near), 2))
        return tuple(
            Detection(float(u), float(v), thing.label, 0.9, 150.0)
            for thing, (u, v) in zip(near, pixels, strict=True)
            if 0 <= u < CAMERA.width and 0 <= v < CAMERA.height
        )


def _position_of(bench: Bench, frame: VideoFrame) -> float:
    """Where the crawler was at the frame; it may have gone on since."""
    return bench.position - (bench.speed * (bench.time_s - frame.time_s) if bench.moving else 0.0)


class PipePictures:
    """A round pipe with a lively wall, lit from the camera."""

    def __init__(self, contrast: float = 160.0) -> None:
        v, u = np.mgrid[0 : CAMERA.height, 0 : CAMERA.width].astype(np.float32)
        x, y = u - CENTRE[0], v - CENTRE[1]
        self._depth = CAMERA.fx * CAMERA.radius / np.maximum(np.hypot(x, y), 6.0)
        self._column = ((np.arctan2(y, x) + math.pi) / (2 * math.pi) * 96).astype(int) % 96
        self._light = np.clip(1.6 / (0.5 + self._depth), 0.1, 1.2)
        rng = np.random.default_rng(5)
        rough = rng.normal(0, 1, (1000, 96))
        for _ in range(2):
            rough = (rough + np.roll(rough, 1, 0) + np.roll(rough, 1, 1) + np.roll(rough, -1, 1)) / 4
        self._wall = 120 + contrast * rough
        self._rng = rng

    def at(self, position: float) -> NDArray[np.uint8]:
        rows = ((position + self._depth) * 50).astype(int) % 1000
        grey = self._wall[rows, self._column] * self._light + self._rng.normal(0, 1.5, self._depth.shape)
        return np.repeat(np.clip(grey, 0, 255).astype(np.uint8)[..., None], 3, axis=2)
