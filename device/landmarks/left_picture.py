"""The left pictures of the box's stereo camera as a CCTV grabber: one camera maps the drive and scans the wall."""

from __future__ import annotations

import time

from device.feeds.feed import StereoFeed
from device.feeds.tap import Tap
from device.landmarks.crawler import Optics
from device.pictures import in_colour
from drivers.base import FrameTimeout, SensorLost
from drivers.grabber.base import FrameGrabber, VideoFrame
from drivers.stereo.base import StereoFrame

_WAITING = 4
"""Pairs that may wait for who reads them, as in a grabber of its own."""
_TURN_S = 0.1
FIRST_PAIR_S = 5.0
"""A camera that rested until now takes so long to start."""


class LeftPicture(FrameGrabber):
    """Reads ``feed``, which looks after the camera itself and is awake as long as this is open."""

    def __init__(self, feed: StereoFeed) -> None:
        self._feed = feed
        self._tap: Tap[StereoFrame] | None = None
        self.name = f"left picture of the {feed.name}"

    def _open(self) -> None:
        if self._tap is None:
            self._tap = self._feed.tap(_WAITING)

    def _read(self, timeout_s: float) -> VideoFrame:
        tap = self._tap
        if tap is None:
            raise SensorLost(f"The {self.name} is not open.")
        deadline = time.monotonic() + timeout_s
        while (frame := tap.get(min(_TURN_S, max(deadline - time.monotonic(), 0.0)))) is None:
            status = self._feed.status()
            if status.state == "lost":
                raise SensorLost(status.message)
            if time.monotonic() >= deadline:
                raise FrameTimeout(status.message or f"The {self._feed.name} sent no picture for {timeout_s:g} s.")
        return VideoFrame(in_colour(frame.left), frame.monotonic_ns, frame.number, None, frame.source)

    def close(self) -> None:
        """Let the camera rest, if nobody else looks. Never raises, may be called twice."""
        tap, self._tap = self._tap, None
        if tap is not None:
            tap.close()


def optics_of(feed: StereoFeed) -> Optics:
    """How the left camera looks, as its pairs say: the newest, or the first that comes within FIRST_PAIR_S seconds; nothing is
    known where none does."""
    frame = feed.latest
    if frame is None:
        tap = feed.tap(1)
        try:
            frame = tap.get(FIRST_PAIR_S)
        finally:
            tap.close()
    if frame is None:
        return Optics()
    lens = frame.intrinsics
    return Optics((lens.fx, lens.fy), (lens.ppx, lens.ppy))
