"""Two plain cameras side by side: pictures of one moment, rectified by what ``borescout calibrate stereo`` found of the lenses.

They are not synchronised: pictures are joined by when they came, with up to half a frame's time between them.
"""

from __future__ import annotations

import time
from collections.abc import Callable

from drivers.base import BadFrame, DriverError, FrameTimeout, SensorLost, SensorMissing
from drivers.grabber.base import FrameGrabber, VideoFrame
from drivers.stereo.base import StereoCamera, StereoFrame
from drivers.stereo.rectifier import Calibrated, Rectifier

_APART_S = 0.025
"""How far the two pictures of a pair may be apart, where the cameras do not state their rate."""
_APART_FRAMES = 0.6


class GrabberPair:
    """Two grabbers that are opened, read and closed together. ``name`` is what the operator knows them as."""

    def __init__(self, left: FrameGrabber, right: FrameGrabber) -> None:
        self._both = (left, right)
        self._opened = False
        self.name = "pair of cameras"

    def open(self) -> None:
        """Start both, or neither. Raises SensorMissing, SensorLost."""
        self.close()
        try:
            for grabber in self._both:
                grabber.open()
        except DriverError:
            self.close()
            raise
        self._opened = True

    def read(self, timeout_s: float) -> tuple[VideoFrame, VideoFrame]:
        """The next two pictures of one moment. Raises FrameTimeout, SensorLost, BadFrame."""
        if not self._opened:
            raise SensorLost(f"The {self.name} is not open.")
        deadline = time.monotonic() + timeout_s
        left, right = (grabber.read(_until(deadline)) for grabber in self._both)
        apart_ns = 1e9 * self._apart_s()
        while abs(left.monotonic_ns - right.monotonic_ns) > apart_ns:
            if time.monotonic() > deadline:
                raise FrameTimeout(f"The {self.name} sends no two pictures of one moment: one of them is too slow.")
            if left.monotonic_ns < right.monotonic_ns:
                left = self._both[0].read(_until(deadline))
            else:
                right = self._both[1].read(_until(deadline))
        return left, right

    def _apart_s(self) -> float:
        rates = [grabber.frame_rate for grabber in self._both if grabber.frame_rate]
        return _APART_FRAMES / min(rates) if rates else _APART_S

    def reset(self) -> None:
        """Reset both; they are closed afterwards."""
        self._opened = False
        for grabber in self._both:
            grabber.reset()

    def close(self) -> None:
        """Stop and release both. Never raises, may be called twice."""
        self._opened = False
        for grabber in self._both:
            grabber.close()


class TwoCameras(StereoCamera):
    """The rectified pictures of a GrabberPair. ``calibrated`` is asked whenever they are opened: what is known of their lenses,
    None where that is nothing yet."""

    notice = "The two cameras are not synchronised: hold still while a pair is taken."

    def __init__(self, grabbers: GrabberPair, calibrated: Callable[[], Calibrated | None]) -> None:
        self._grabbers = grabbers
        self._calibrated = calibrated
        self._rectifier: Rectifier | None = None
        self.name = grabbers.name

    def _open(self) -> None:
        known = self._calibrated()
        if known is None:
            raise SensorMissing(f"The {self.name} is not calibrated yet: show it a board first.")
        self._rectifier = Rectifier(known)
        self._grabbers.open()

    def _read(self, timeout_s: float) -> StereoFrame:
        rectifier = self._rectifier
        left, right = self._grabbers.read(timeout_s)
        if rectifier is None:
            raise SensorLost(f"The {self.name} is not open.")
        for frame in (left, right):
            width, height = rectifier.size
            if frame.image.shape[:2] != (height, width):
                raise BadFrame(
                    f"The {frame.source} sends pictures of {frame.image.shape[1]} x {frame.image.shape[0]}, "
                    f"the calibration is for {width} x {height}: calibrate it as it is now."
                )
        moment = max(left.monotonic_ns, right.monotonic_ns)
        return rectifier.frame(left.image, right.image, moment, left.number, f"{left.source}, {right.source}")

    def reset(self) -> None:
        """Reset both cameras; they are closed afterwards."""
        self._grabbers.reset()

    def close(self) -> None:
        """Stop and release. Never raises, may be called twice."""
        self._grabbers.close()


def _until(deadline: float) -> float:
    return max(0.0, deadline - time.monotonic())
