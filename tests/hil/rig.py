"""A box on the bench: the whole device around cameras that look into a pipe of known diameter and fail on command."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from device.bus import Event, Subscription
from device.clock import Clock
from device.config import Settings
from device.daemon import Device
from device.feeds.feed import CameraFeed
from device.feeds.reader import FeedTiming
from device.workers import WorkerPool
from drivers.base import FrameTimeout, SensorLost
from drivers.depth.base import DepthCamera, DepthFrame
from estimators.frame import estimate_frame
from tests.pairing import PIN
from tests.unit.estimators.analytic_scenes import SMALL, cylinder, to_depth

TIMING = FeedTiming(
    read_s=0.2,
    stale_s=0.5,
    read_limit_s=1.0,
    open_limit_s=2.0,
    faults_before_reopen=2,
    openings_before_reset=1,
    back_off_s=(0.1,),
)
PATIENCE_S = 90.0
"""Two cores shared with whatever else runs: nothing here measures speed."""


class PipeCamera(DepthCamera):
    """Looks along a pipe of ``radius_m``, each frame with its own noise. ``fault`` is "", "gone", "silent" or "stuck"."""

    def __init__(self, name: str, radius_m: float = 0.1, noise: float = 0.02, fps: float = 60.0) -> None:
        self.name = name
        self.fault = ""
        self.sent = 0
        self._period_s = 1.0 / fps
        self._scene = cylinder(radius_m, SMALL, offset=(0.01, 0.005), tilt=(0.05, 0.02))
        self._noise = noise
        self._unstuck = threading.Event()

    def free(self) -> None:
        """Let a stuck call return."""
        self._unstuck.set()

    def _open(self) -> None:
        if self.fault == "gone":
            raise SensorLost(f"The {self.name} is gone.")

    def _read(self, timeout_s: float) -> DepthFrame:
        time.sleep(self._period_s)
        if self.fault == "gone":
            raise SensorLost(f"The {self.name} is gone.")
        if self.fault == "silent":
            raise FrameTimeout(f"The {self.name} is silent.")
        if self.fault == "stuck":
            self._unstuck.wait()
            raise SensorLost(f"The {self.name} is back.")
        self.sent += 1
        depth = to_depth(self._scene, self._noise, seed=self.sent)
        color = np.full((60, 80, 3), 90, np.uint8)
        return DepthFrame(depth, SMALL, 0.001, time.monotonic_ns(), self.sent, color, self.name)

    def close(self) -> None: ...


class Bench:
    """A running device with its cameras, and an ear on its bus."""

    def __init__(
        self, folder: Path, *cameras: DepthCamera, estimate: Callable[..., Any] = estimate_frame, frames: int = 12
    ) -> None:
        self.cameras = cameras
        settings = Settings(data_dir=folder, frames=frames, pin=PIN)
        feeds = [CameraFeed(camera.name, "virtual", lambda camera=camera: camera, timing=TIMING) for camera in cameras]
        self.pool = WorkerPool(2, estimate, limit_s=30.0)
        self.device = Device(settings, feeds=feeds, pool=self.pool, clock=Clock(folder / "no-machine"))
        self.ear: Subscription = self.device.subscribe()
        self.device.start()

    def wait_for(self, name: str, check: Callable[[dict[str, Any]], bool] = lambda data: True) -> dict[str, Any]:
        """The data of the next event of that name that fits."""
        deadline = time.monotonic() + PATIENCE_S
        while time.monotonic() < deadline:
            event: Event | None = self.ear.get(1.0)
            if event is not None and event.name == name and check(event.data):
                return event.data
        raise AssertionError(f"no fitting {name} event came")

    def up(self) -> Bench:
        """Wait until every camera sends and the workers answer."""
        self.wait_for("status", lambda data: all(camera["state"] == "up" for camera in data["cameras"]))
        self.wait_for("live")
        return self

    def finish(self, survey_id: int) -> dict[str, Any]:
        """Wait until the measurement has ended; its last event."""
        ended = ("saved", "failed", "cancelled")
        return self.wait_for("measurement", lambda data: data["survey_id"] == survey_id and data["state"] in ended)

    def close(self) -> None:
        """Free whatever hangs and stop."""
        for camera in self.cameras:
            if isinstance(camera, PipeCamera):
                camera.free()
        self.device.close()
