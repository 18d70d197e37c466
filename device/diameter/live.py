"""Estimates while the operator aims: the newest picture of every camera through the workers, a few times a second."""

from __future__ import annotations

import logging
import threading
import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import CancelledError, Future
from typing import Any

from device.bus import Bus
from device.diameter.result import LIVE_FRAMES, SINGLE_FRAME_RESAMPLES, live_summary
from device.errors import Closed, DeviceError
from device.feeds.feed import CameraFeed
from device.workers import WorkerPool
from drivers.depth.base import DepthFrame
from estimators.frame import FrameEstimate

log = logging.getLogger(__name__)

STALE_S = 3.0
"""An estimate older than this is not live any more."""


class LiveEstimates:
    """Publishes "live" ``rate_hz`` times a second.

    One frame of each camera at a time is in the workers, so that a measurement is never kept waiting; during a measurement its
    own estimates are shown instead (``pause``, ``add``).
    """

    def __init__(self, feeds: list[CameraFeed], pool: WorkerPool, bus: Bus, rate_hz: float) -> None:
        self._bus = bus
        self._pool = pool
        self._period_s = 1.0 / rate_hz
        self._cameras = {feed.name: _Camera(feed) for feed in feeds}
        self._lock = threading.Lock()
        self._stop = threading.Event()
        self._paused = False
        self.on_turn: Callable[[], None] = lambda: None
        """Called with each turn of the loop."""
        self._newest: dict[str, Any] | None = None
        self._thread = threading.Thread(target=self._run, name="live estimates", daemon=True)

    def start(self) -> None:
        """Begin to estimate and publish."""
        self._thread.start()

    def close(self, wait_s: float = 2.0) -> None:
        """Stop. May be called twice."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join(wait_s)

    def pause(self, paused: bool) -> None:
        """While paused no frame is estimated for the live view; publishing goes on with what ``add`` brings."""
        self._paused = paused

    def add(self, feed: CameraFeed, frame: DepthFrame, estimate: FrameEstimate) -> None:
        """An estimate that was made for a measurement."""
        with self._lock:
            self._cameras[feed.name].add(frame, estimate)

    def newest(self) -> dict[str, Any] | None:
        """{"camera", "frame", "age_s", ...live_summary} of the best camera; None while there is nothing live."""
        newest = self._newest
        if newest is None:
            return None
        age_s = time.monotonic() - newest["monotonic_s"]
        if age_s > STALE_S:
            return None
        return {"age_s": round(age_s, 2), **{key: value for key, value in newest.items() if key != "monotonic_s"}}

    def shown(self) -> tuple[DepthFrame, FrameEstimate] | None:
        """The picture and its estimate behind ``newest``."""
        newest = self._newest
        if newest is None or self.newest() is None:
            return None
        with self._lock:
            return self._cameras[newest["camera"]].latest

    def _run(self) -> None:
        due = time.monotonic()
        while not self._stop.wait(due - time.monotonic()):
            due = max(due + self._period_s, time.monotonic())
            self.on_turn()
            try:
                if not self._paused:
                    for camera in self._cameras.values():
                        self._submit(camera)
                self._newest = self._summarise()
                live = self.newest()
                if live is not None:
                    self._bus.publish("live", live)
            except Closed:
                return
            except Exception:  # the aiming aid may fail on a picture; the box must go on
                log.exception("the live estimate failed")

    def _submit(self, camera: _Camera) -> None:
        frame = camera.feed.latest
        if frame is None or camera.busy or camera.is_known(frame):
            return
        camera.busy = True
        resamples = SINGLE_FRAME_RESAMPLES if camera.feed.recorded else 0
        future = self._pool.submit(frame.depth, frame.intrinsics, frame.depth_unit_m, frame.number, resamples)
        future.add_done_callback(lambda done: self._collect(camera, frame, done))

    def _collect(self, camera: _Camera, frame: DepthFrame, future: Future[FrameEstimate]) -> None:
        camera.busy = False
        try:
            estimate = future.result()
        except (CancelledError, Closed):
            return
        except DeviceError as error:
            log.warning("no live estimate of %s: %s", camera.feed.name, error)
            return
        with self._lock:
            camera.add(frame, estimate)

    def _summarise(self) -> dict[str, Any] | None:
        best: dict[str, Any] | None = None
        for camera in self._cameras.values():
            with self._lock:
                frames, latest = list(camera.estimates), camera.latest
            if latest is None:
                continue
            summary = camera.summary(frames)
            frame = camera.feed.latest if camera.feed.recorded and camera.is_current() else latest[0]
            if frame is None or time.monotonic() - frame.monotonic_ns / 1e9 > STALE_S:
                continue
            if best is None or summary["trust"] > best["trust"]:
                seen = {"camera": camera.feed.name, "frame": frame.number, "monotonic_s": frame.monotonic_ns / 1e9}
                best = {**seen, **summary}
        return best


class _Camera:
    """What is known of one camera's last few pictures."""

    def __init__(self, feed: CameraFeed) -> None:
        self.feed = feed
        self.busy = False
        self.estimates: deque[FrameEstimate] = deque(maxlen=LIVE_FRAMES)
        self.latest: tuple[DepthFrame, FrameEstimate] | None = None
        self._summary: tuple[int, dict[str, Any]] | None = None
        self._count = 0

    def add(self, frame: DepthFrame, estimate: FrameEstimate) -> None:
        if self.feed.recorded and self.latest is not None and self.latest[0].source != frame.source:
            self.estimates.clear()  # another recording, another pipe
        self.estimates.append(estimate)
        self.latest = frame, estimate
        self._count += 1

    def is_known(self, frame: DepthFrame) -> bool:
        """Whether this very picture has been estimated: the frame itself, or the held picture of a recording."""
        if self.latest is None:
            return False
        known = self.latest[0]
        return frame.depth is known.depth or frame.monotonic_ns <= known.monotonic_ns

    def is_current(self) -> bool:
        """Whether the recording still shows the picture of the latest estimate."""
        shown = self.feed.latest
        return self.latest is not None and shown is not None and shown.depth is self.latest[0].depth

    def summary(self, frames: list[FrameEstimate]) -> dict[str, Any]:
        """``live_summary``, made once for every new estimate."""
        if self._summary is None or self._summary[0] != self._count:
            self._summary = self._count, live_summary(frames)
        return self._summary[1]
