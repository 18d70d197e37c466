"""The thread that reads one camera, with its ladder: reopen, reset, tell the operator, go on trying ever more slowly."""

from __future__ import annotations

import logging
import threading
import time
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, Protocol, TypeVar

import numpy as np

from drivers.base import BadFrame, DriverError, EndOfRecording, FrameTimeout, RecordingBroken, SensorMissing
from drivers.depth.base import DepthCamera, DepthFrame

log = logging.getLogger(__name__)

T = TypeVar("T")
FeedState = Literal["starting", "up", "degraded", "lost"]

_BROKEN_PICTURE_S = 0.05
_LOST_SENTENCE = "The camera sends no pictures: check its cable. The box keeps trying."


@dataclass(frozen=True)
class FeedTiming:
    """How patient a feed is, in seconds and counts."""

    read_s: float = 1.0
    """What the driver is given for one frame."""
    stale_s: float = 1.5
    """A good frame older than this makes the camera "degraded"."""
    read_limit_s: float = 6.0
    """A read that takes longer is stuck."""
    open_limit_s: float = 40.0
    """Any other driver call (make, open, reset, close) that takes longer is stuck; the drivers bound theirs at 20 s."""
    faults_before_reopen: int = 3
    good_before_trust: int = 5
    """Good frames after which a reopened camera starts at the foot of the ladder again."""
    openings_before_reset: int = 2
    back_off_s: tuple[float, ...] = (0.2, 0.5, 1.0, 2.0, 5.0, 10.0)
    repeats_before_frozen: int = 15
    empty_before_reopen: int = 60
    """Empty pictures are often the operator's hand on the window: be slower than with a silent camera."""
    abandoned_limit: int = 3
    """Threads left behind in stuck calls; beyond these no new one is started until one of them returns."""


class FrozenCamera(BadFrame):
    """The camera sends the same picture again and again."""


class EmptyPictures(BadFrame):
    """The camera sends nothing but empty depth pictures."""


class Sink(Protocol):
    """Whom a reader reports to. Reports of a reader that is no longer wanted are ignored by it."""

    def wanted(self, reader: CameraReader) -> bool: ...
    def opened(self, reader: CameraReader) -> None: ...
    def good_frame(self, reader: CameraReader, frame: DepthFrame, lost_before: int) -> None: ...
    def bad_frame(self, reader: CameraReader, empty: bool = False) -> None: ...
    def become(self, reader: CameraReader, state: FeedState, message: str) -> None: ...


class CameraReader:
    """One thread with one camera object, made by ``make`` inside it.

    Once it is no longer wanted it closes its camera and ends; while a driver call holds it, ``stuck`` says so after the limit.
    ``recorded``: repeated or empty pictures are how the recording is, and nothing to recover from.
    """

    def __init__(
        self,
        name: str,
        make: Callable[[], DepthCamera],
        recorded: bool,
        timing: FeedTiming,
        sink: Sink,
        stop: threading.Event,
    ) -> None:
        self.name = name
        self.call = ""
        """The driver call under way."""
        self._make = make
        self._recorded = recorded
        self._timing = timing
        self._sink = sink
        self._stop = stop
        self._camera: DepthCamera | None = None
        self._call_since: float | None = None
        self._call_limit = 0.0
        self._number: int | None = None
        self._pictures_to_prove = 0
        self._fingerprint: int | None = None
        self._repeats = self._empties = 0
        self._missing = False
        self.thread = threading.Thread(target=self._run, name=f"reader of {name}", daemon=True)

    def stuck(self) -> bool:
        """Whether a driver call has been under way for longer than it may."""
        since = self._call_since
        return since is not None and time.monotonic() - since > self._call_limit

    def _run(self) -> None:
        openings = 0  # in a row, without enough good frames
        while self._sink.wanted(self):
            try:
                self._climb(openings)
                self._open()
                good = 0
                while self._sink.wanted(self):
                    good += self._read_until_fault()
                    if good >= self._timing.good_before_trust:
                        openings = 0
            except EndOfRecording as end:
                # a recording in place of a camera is played again and again
                self._sink.become(self, "degraded", _sentence(end))
            except EmptyPictures as fault:
                self._sink.become(self, "degraded", str(fault))
            except DriverError as fault:
                self._missing = isinstance(fault, SensorMissing)
                beyond_help = self._missing or openings >= self._timing.openings_before_reset
                self._sink.become(self, "lost" if beyond_help else "degraded", _sentence(fault) or _LOST_SENTENCE)
            except Exception:  # a driver's own bug or its native code: it costs a reopening, never the daemon
                if openings == 0:  # the trace once; how often it happens again is in the count of reconnects
                    log.exception("%s: its driver failed in an unexpected way", self.name)
                self._sink.become(self, "lost", _LOST_SENTENCE)
            self._close()
            if self._sink.wanted(self):
                self._stop.wait(self._timing.back_off_s[min(openings, len(self._timing.back_off_s) - 1)])
            openings += 1

    def _climb(self, openings: int) -> None:
        """The second rung: every other opening beyond the first few begins with a reset of the hardware."""
        beyond = openings - self._timing.openings_before_reset
        if self._camera is not None and not self._missing and beyond >= 0 and beyond % 2 == 0:
            log.log(logging.DEBUG if beyond else logging.WARNING, "%s: resetting the hardware", self.name)
            self._timed("reset", self._timing.open_limit_s, self._camera.reset)

    def _open(self) -> None:
        if self._camera is None:
            self._camera = self._timed("make", self._timing.open_limit_s, self._make)
        self._timed("open", self._timing.open_limit_s, self._camera.open)
        self._number = None  # but not the fingerprint: a camera that shows the old picture after reopening is still frozen
        self._repeats = self._empties = 0
        self._sink.opened(self)
        if self._camera.notice:
            log.warning("%s: %s", self.name, self._camera.notice)

    def _close(self) -> None:
        if self._camera is None:
            return
        try:
            self._timed("close", self._timing.open_limit_s, self._camera.close)
        except Exception:  # close() promises not to raise; a driver that breaks the promise must not end this thread
            log.exception("%s: its driver failed while closing", self.name)

    def _read_until_fault(self) -> bool:
        """Read until a good frame has come (True), or raise when faults have added up to a reason to reopen."""
        assert self._camera is not None  # opened just before
        camera = self._camera
        for faults_left in reversed(range(self._timing.faults_before_reopen)):
            if not self._sink.wanted(self):
                return False
            try:
                frame = self._timed("read", self._timing.read_limit_s, lambda: camera.read(self._timing.read_s))
            except RecordingBroken as fault:
                # one picture of a recording: the next read goes on behind it, while reopening would begin all over again
                self._sink.bad_frame(self)
                self._sink.become(self, "degraded", _sentence(fault))
                self._stop.wait(_BROKEN_PICTURE_S)
                return False
            except (FrameTimeout, BadFrame) as fault:
                if isinstance(fault, BadFrame):
                    self._sink.bad_frame(self)
                self._sink.become(self, "degraded", _sentence(fault) or _LOST_SENTENCE)
                if faults_left == 0:
                    raise
                continue
            return self._judge(frame)
        return False

    def _judge(self, frame: DepthFrame) -> bool:
        """Hand a good frame on. Raises FrozenCamera or EmptyPictures after too many that are none."""
        lost_before = 0 if self._number is None else max(0, frame.number - self._number - 1)
        if not self._recorded:
            fingerprint = zlib.crc32(np.ascontiguousarray(frame.depth[::4]).data)
            empty = not frame.depth.any()
            repeated = not empty and (fingerprint == self._fingerprint or frame.number == self._number)
            self._fingerprint = fingerprint
            self._number = frame.number
            self._empties = self._empties + 1 if empty else 0
            self._repeats = self._repeats + 1 if repeated else 0
            if empty or repeated:
                self._sink.bad_frame(self, empty)
                if self._repeats >= self._timing.repeats_before_frozen:
                    self._pictures_to_prove = 2
                    raise FrozenCamera("The camera sends the same picture again and again; it is being restarted.")
                if self._empties >= self._timing.empty_before_reopen:
                    raise EmptyPictures("The depth picture is empty: is the window covered, or is it too dark?")
                return False
            self._pictures_to_prove = max(0, self._pictures_to_prove - 1)
            if self._pictures_to_prove:
                return False  # one new picture after a freeze may be the next frozen one: a second proves that it moves
        self._number = frame.number
        self._sink.good_frame(self, frame, lost_before)
        return True

    def _timed(self, what: str, limit_s: float, call: Callable[[], T]) -> T:
        self.call, self._call_limit, self._call_since = what, limit_s, time.monotonic()
        try:
            return call()
        finally:
            self._call_since = None


def _sentence(fault: DriverError) -> str:
    """What the driver says, as a sentence for the operator."""
    text = str(fault).strip()
    return text if not text or text.endswith((".", "!", "?")) else f"{text}."
