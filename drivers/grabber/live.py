"""A live source behind cv2, read by a thread of its own, so that no picture waits in a buffer of cv2 and no call blocks.

cv2 hands out pictures in the order of their coming, however old they are, and may block for seconds when none comes. The thread
takes each one as it comes and keeps the newest few; each carries the number it came under, so that a gap is a lost picture.
"""

from __future__ import annotations

import logging
import threading
import time
from abc import abstractmethod
from collections import deque
from dataclasses import dataclass
from typing import Any, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.base import DriverError, FrameTimeout, SensorLost, SensorMissing
from drivers.bounded import call_within
from drivers.grabber.base import FrameGrabber, NoSignal, VideoFrame

log = logging.getLogger(__name__)

KEPT = 4
"""Pictures kept for a reader that is late by a moment."""
OPEN_S = 12.0
CLOSE_S = 1.0
SIGNAL_POLL_S = 0.5


class Capture(Protocol):
    """What is used of cv2.VideoCapture."""

    def grab(self) -> bool: ...
    def retrieve(self) -> tuple[bool, Any]: ...
    def get(self, prop: int) -> float: ...
    def isOpened(self) -> bool: ...
    def release(self) -> None: ...


@dataclass(frozen=True)
class _Arrival:
    image: NDArray[np.uint8]
    monotonic_ns: int
    number: int


class _Pump:
    """The thread of one opened capture. It alone touches the capture after the start, and releases it at the end."""

    def __init__(self, grabber: LiveGrabber, capture: Capture) -> None:
        self._grabber = grabber
        self._capture = capture
        self._arrivals: deque[_Arrival] = deque(maxlen=KEPT)
        self._condition = threading.Condition()
        self._stop = False
        self._ended = ""
        self._signal = True
        self.thread = threading.Thread(target=self._run, name=f"pump of {grabber.name}", daemon=True)

    def take(self, timeout_s: float) -> _Arrival:
        """The oldest picture kept. Raises FrameTimeout, NoSignal, SensorLost."""
        name = self._grabber.name
        with self._condition:
            self._condition.wait_for(lambda: self._arrivals or self._ended or self._stop, timeout_s)
            if self._stop:
                raise SensorLost(f"The {name} has been closed.")
            if self._arrivals:
                return self._arrivals.popleft()
            if self._ended:
                raise SensorLost(self._ended)
            if not self._signal:
                raise NoSignal(f"No camera sends a picture into the {name}: check its cable and its lamp.")
            raise FrameTimeout(f"The {name} sent no picture for {timeout_s:.3g} s.")

    def stop(self) -> None:
        """Ask the thread to end; it does once cv2 lets it go."""
        with self._condition:
            self._stop = True
            self._arrivals.clear()
            self._condition.notify_all()

    def _run(self) -> None:
        ended = f"The {self._grabber.name} stopped sending pictures."
        number = 0
        looked_s = 0.0
        try:
            while not self._stop and self._capture.grab():
                now_ns = time.monotonic_ns()
                number += self._grabber.count_since_last(self._capture)
                if now_ns / 1e9 - looked_s > SIGNAL_POLL_S:
                    looked_s = now_ns / 1e9
                    self._see(self._grabber.has_signal())
                if not self._signal:
                    continue  # noise, while the input is empty
                decoded, image = self._capture.retrieve()
                if not decoded:
                    continue
                with self._condition:
                    # cv2 may use its buffer again for the next picture
                    self._arrivals.append(_Arrival(np.array(image, dtype=np.uint8), now_ns, number))
                    self._condition.notify_all()
        except (cv2.error, DriverError, OSError) as error:
            ended = f"The {self._grabber.name} failed: {' '.join(str(error).split()) or 'no reason given'}."
        finally:
            self._capture.release()
            with self._condition:
                self._ended = ended
                self._condition.notify_all()

    def _see(self, signal: bool) -> None:
        if signal != self._signal:
            log.warning("%s: the signal %s", self._grabber.name, "is back" if signal else "is lost")
        with self._condition:
            self._signal = signal
            if not signal:
                self._arrivals.clear()


class LiveGrabber(FrameGrabber):
    """A source that runs whether it is read or not. A driver says how it is opened: ``start``."""

    def __init__(self, name: str) -> None:
        self.name = name
        self._pump: _Pump | None = None

    @abstractmethod
    def start(self) -> Capture:
        """Open it. May block for seconds; a capture that is not opened counts as missing. Raises DriverError."""

    @abstractmethod
    def missing(self) -> str:
        """The sentence for a source that is not there."""

    def has_signal(self) -> bool:
        """Whether a camera feeds it, as far as can be told. Asked now and then between two pictures."""
        return True

    def count_since_last(self, capture: Capture) -> int:
        """How many pictures the source made since the last one that came, this one included."""
        return 1

    def _open(self) -> None:
        self.close()
        capture = call_within(OPEN_S, self.start, f"The {self.name} does not start.", undo=lambda late: late.release())
        if not capture.isOpened():
            capture.release()
            raise SensorMissing(self.missing())
        stated = capture.get(cv2.CAP_PROP_FPS)
        self.frame_rate = stated if 0 < stated < 1000 else None
        self._pump = _Pump(self, capture)
        self._pump.thread.start()

    def _read(self, timeout_s: float) -> VideoFrame:
        pump = self._pump
        if pump is None:
            raise SensorLost(f"The {self.name} is not open.")
        arrival = pump.take(timeout_s)
        return VideoFrame(arrival.image, arrival.monotonic_ns, arrival.number, source=self.name)

    def close(self) -> None:
        """Stop and release; a thread still inside cv2 is waited for a moment and then left to end by itself."""
        pump, self._pump = self._pump, None
        if pump is None:
            return
        pump.stop()
        if pump.thread is not threading.current_thread():
            pump.thread.join(CLOSE_S)
        if pump.thread.is_alive():
            log.warning("%s: still inside cv2 while closing, left behind", self.name)
