"""One camera's recording: its frames estimated in the workers while the next ones arrive."""

from __future__ import annotations

import logging
import threading
import time
import zlib
from collections.abc import Callable
from concurrent.futures import CancelledError, Future
from typing import Any

import numpy as np

from device.diameter.result import SINGLE_FRAME_RESAMPLES
from device.diameter.take import Take
from device.errors import DeviceError
from device.feeds.feed import CameraFeed
from device.surveys.topics import ESTIMATES, FRAMES
from device.workers import WorkerPool
from drivers.depth.base import DepthFrame
from estimators.frame import FrameEstimate
from estimators.recording import MIN_FRAMES_FOR_SPREAD

log = logging.getLogger(__name__)

SILENCE_S = 2.5
"""A camera that sends no good frame for this long in mid-measurement is lost."""
LONGEST_S = 30.0
"""A camera too slow for its frames within this time is judged by what it sent."""
_IN_FLIGHT = 8
"""Frames on their way through the workers; bounds the memory where the workers are slower than the camera."""


class Recording:
    """Takes ``frames`` pictures of ``feed`` in a thread of its own.

    A played-back recording is what its pictures are: the same one again adds nothing to what is known and is counted, not
    estimated; and where the next recording begins, this one ends. ``note`` takes what a replay has to know.
    """

    def __init__(
        self,
        feed: CameraFeed,
        pool: WorkerPool,
        frames: int,
        on_estimate: Callable[[CameraFeed, DepthFrame, FrameEstimate], None],
        note: Callable[[str, dict[str, Any]], object] = lambda topic, told: None,
    ) -> None:
        self.feed = feed
        self.done = 0
        """Frames taken so far."""
        self.lost = False
        """The camera was lost before there was enough."""
        self.take = Take()
        """What has come back from the workers."""
        self._note = note
        self._pool = pool
        self._wanted = frames
        self._on_estimate = on_estimate
        self._pending: set[Future[FrameEstimate]] = set()
        self._submitted = 0
        self._change = threading.Condition()
        self._cancelled = False
        self._seen: set[int] = set()
        self._source_folder: str | None = None
        self.thread = threading.Thread(target=self._run, name=f"recording of {feed.name}", daemon=True)
        self.thread.start()

    @property
    def collecting(self) -> bool:
        """Whether pictures are still being taken."""
        return self.thread.is_alive()

    @property
    def computing(self) -> bool:
        """Whether estimates are still to come."""
        with self._change:
            return bool(self._pending)

    def cancel(self) -> None:
        """Stop taking pictures and forget what waits for the workers. Returns at once."""
        with self._change:
            self._cancelled = True
            pending = list(self._pending)
            self._change.notify_all()
        for future in pending:
            future.cancel()

    def _run(self) -> None:
        tap = self.feed.tap(_IN_FLIGHT)
        begun = heard = time.monotonic()
        try:
            while self.done < self._wanted and not self._cancelled:
                frame = tap.get(0.1)
                now = time.monotonic()
                if frame is None:
                    if now - heard > SILENCE_S or self.feed.status().state == "lost":
                        self.lost = True
                        return
                    continue
                heard = now
                if now - begun > LONGEST_S:
                    self.lost = self.done < MIN_FRAMES_FOR_SPREAD
                    return
                if not self._take(frame):
                    return
        except DeviceError as error:  # the workers are shutting down
            log.info("the recording of %s ends: %s", self.feed.name, error)
        finally:
            tap.close()

    def _take(self, frame: DepthFrame) -> bool:
        """Hand one frame to the workers; False where a played-back recording has come to its end."""
        resamples = SINGLE_FRAME_RESAMPLES if self._wanted < MIN_FRAMES_FOR_SPREAD else 0
        if self.feed.recorded:
            folder = frame.source.rpartition("/")[0]
            if self._source_folder not in (None, folder):
                self.done = self._wanted
                return False
            self._source_folder = folder
            fingerprint = zlib.crc32(np.ascontiguousarray(frame.depth).data)
            if fingerprint in self._seen:
                self.done += 1
                return True
            self._seen.add(fingerprint)
            if len(self._seen) < MIN_FRAMES_FOR_SPREAD:
                resamples = SINGLE_FRAME_RESAMPLES
        with self._change:
            while len(self._pending) >= _IN_FLIGHT and not self._cancelled:
                self._change.wait(0.2)
        index = self._submitted
        self._submitted += 1
        told = {"number": frame.number, "monotonic_ns": frame.monotonic_ns, "seed": index, "resamples": resamples}
        self._note(FRAMES, {"camera": self.feed.name, **told})
        future = self._pool.submit(frame.depth, frame.intrinsics, frame.depth_unit_m, index, resamples)
        with self._change:
            self._pending.add(future)
        future.add_done_callback(lambda done: self._collect(index, frame, done))
        self.done += 1
        return True

    def _collect(self, index: int, frame: DepthFrame, future: Future[FrameEstimate]) -> None:
        try:
            estimate = future.result()
        except CancelledError:
            estimate = None
        except DeviceError as error:
            log.warning("%s, frame %d of the recording: %s", self.feed.name, index + 1, error)
            estimate = None
        with self._change:
            self._pending.discard(future)
            self.take.add(index, None if estimate is None else (frame, estimate))
            self._change.notify_all()
        self._note(ESTIMATES, {"camera": self.feed.name, "seed": index, **_told(estimate)})
        if estimate is not None:
            self._on_estimate(self.feed, frame, estimate)


def _told(estimate: FrameEstimate | None) -> dict[str, Any]:
    if estimate is None:
        return {"failed": True}
    return {"diameter_m": estimate.diameter, "valid_share": estimate.valid_share, "points": estimate.points}
