"""One camera kept alive: frames as they come, the age of the last good one, and a watchdog over the thread that reads.

A driver call stuck in native code cannot be interrupted: its thread is left behind and another one starts with a new camera
object, a few times at most. Everything short of that is the reader's own ladder (``camera_reader.py``).
"""

from __future__ import annotations

import logging
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from device.camera_reader import CameraReader, FeedState, FeedTiming
from device.frame_tap import FrameTap
from drivers.depth.base import DepthCamera, DepthFrame

log = logging.getLogger(__name__)

_STUCK_SENTENCE = "The camera does not answer at all: unplug it, plug it in again, and restart the box if that does not help."
_FPS_WINDOW_S = 2.0


@dataclass(frozen=True)
class FeedStatus:
    """What is known of a camera. ``age_s`` is the age of the last good frame, None before the first one."""

    state: FeedState
    age_s: float | None
    fps: float
    frames: int
    drops: int
    reconnects: int
    bad_frames: int
    message: str


class CameraFeed:
    """Reads one camera in a thread of its own and hands the frames on.

    ``make`` builds the camera; it is called again after a stuck call, since the old object can no longer be trusted.
    ``recorded`` says that the frames come from a recording, where repeated or empty pictures are how it was.
    ``on_change`` is called, from any thread, when the state or its sentence changes.
    """

    def __init__(
        self,
        name: str,
        kind: str,
        make: Callable[[], DepthCamera],
        *,
        recorded: bool = False,
        timing: FeedTiming | None = None,
        on_change: Callable[[], None] = lambda: None,
    ) -> None:
        self.name = name
        self.kind = kind
        self.recorded = recorded
        self._make = make
        self._timing = timing or FeedTiming()
        self._on_change = on_change
        self._lock = threading.Lock()
        self._stop = threading.Event()
        self._taps: list[FrameTap] = []
        self._latest: DepthFrame | None = None
        self._blind = False
        self._arrivals: deque[float] = deque(maxlen=100)
        self._state: FeedState = "starting"
        self._message = "The camera is being started."
        self._frames = self._drops = self._bad = self._openings = 0
        self._abandoned: list[CameraReader] = []
        self._reader: CameraReader | None = None
        self._watchdog = threading.Thread(target=self._watch, name=f"watchdog of {name}", daemon=True)

    def start(self) -> None:
        """Begin to read. Returns at once, whether there is a camera or not."""
        self._begin_reader()
        self._watchdog.start()

    def close(self, wait_s: float = 3.0) -> None:
        """Stop reading; a reader stuck in native code is left behind after ``wait_s`` seconds. May be called twice."""
        self._stop.set()
        for tap in list(self._taps):
            tap.close()
        reader = self._reader
        if reader is None:
            return
        self._watchdog.join(wait_s)
        reader.thread.join(wait_s)
        if reader.thread.is_alive():
            log.warning("%s: still inside a driver call (%s) while stopping, left behind", self.name, reader.call)

    @property
    def latest(self) -> DepthFrame | None:
        """The newest good frame."""
        return self._latest

    @property
    def blind(self) -> bool:
        """Whether the camera works and sees nothing: its last picture was empty."""
        return self._blind

    def tap(self, size: int) -> FrameTap:
        """Every good frame from now on, through a queue of ``size`` in which the newest win. Close it after use."""
        tap = FrameTap(size, self._untap)
        with self._lock:
            self._taps.append(tap)
        return tap

    def status(self) -> FeedStatus:
        """The state of this moment."""
        now = time.monotonic()
        with self._lock:
            latest, state, message = self._latest, self._state, self._message
            drops = self._drops + sum(tap.dropped for tap in self._taps)
            recent = [moment for moment in self._arrivals if now - moment < _FPS_WINDOW_S]
        age_s = None if latest is None else max(0.0, now - latest.monotonic_ns / 1e9)
        if state == "up" and age_s is not None and age_s > self._timing.stale_s:
            state, message = "degraded", f"No picture for {age_s:.0f} s."
        return FeedStatus(
            state=state,
            age_s=age_s,
            fps=(len(recent) - 1) / (recent[-1] - recent[0]) if len(recent) > 1 and recent[-1] > recent[0] else 0.0,
            frames=self._frames,
            drops=drops,
            reconnects=max(0, self._openings - 1),
            bad_frames=self._bad,
            message=message,
        )

    # What the reader reports (camera_reader.Sink). One that was left behind may still come back from its call: nobody listens.

    def wanted(self, reader: CameraReader) -> bool:
        """Whether this reader is still the one in charge."""
        return reader is self._reader and not self._stop.is_set()

    def opened(self, reader: CameraReader) -> None:
        """The camera was opened."""
        with self._lock:
            if self.wanted(reader):
                self._openings += 1

    def good_frame(self, reader: CameraReader, frame: DepthFrame, lost_before: int) -> None:
        """A good frame came, after ``lost_before`` that the sensor counted and nobody saw."""
        with self._lock:
            if not self.wanted(reader):
                return
            self._latest = frame
            self._blind = False
            self._frames += 1
            self._drops += lost_before
            self._arrivals.append(time.monotonic())
            taps = list(self._taps)
        for tap in taps:
            tap.offer(frame)
        self.become(reader, "up", "")

    def bad_frame(self, reader: CameraReader, empty: bool = False) -> None:
        """A picture came that is none; ``empty``: it is one, but nothing was measured in it."""
        with self._lock:
            if self.wanted(reader):
                self._bad += 1
                self._blind = empty

    def become(self, reader: CameraReader, state: FeedState, message: str) -> None:
        """The camera is in another state, or for another reason."""
        with self._lock:
            if not self.wanted(reader) or (state, message) == (self._state, self._message):
                return
            self._state, self._message = state, message
        level = logging.INFO if state == "up" else logging.WARNING
        log.log(level, "camera %s is %s%s", self.name, state, f": {message}" if message else "")
        self._on_change()

    def _untap(self, tap: FrameTap) -> None:
        with self._lock:
            if tap in self._taps:
                self._taps.remove(tap)
                self._drops += tap.dropped

    def _begin_reader(self) -> None:
        self._reader = CameraReader(self.name, self._make, self.recorded, self._timing, self, self._stop)
        self._reader.thread.start()

    def _watch(self) -> None:
        while not self._stop.wait(min(0.2, self._timing.read_limit_s / 4)):
            self._abandoned = [reader for reader in self._abandoned if reader.thread.is_alive()]
            reader = self._reader
            if reader is None:
                continue
            if reader.thread.is_alive():
                if not reader.stuck():
                    continue
                self.become(reader, "lost", _STUCK_SENTENCE)
                if len(self._abandoned) >= self._timing.abandoned_limit:
                    continue
                log.error("camera %s: its driver does not return from %s, starting anew", self.name, reader.call)
                self._abandoned.append(reader)
            self._begin_reader()
