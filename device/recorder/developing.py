"""Pictures on their way to a survey that is being recorded: each becomes its JPEG, and the survey reads what that shows.

So a replay reads the same picture, bit by bit. It happens in a thread of its own: the survey waits some milliseconds for a
picture, and works no slower.
"""

from __future__ import annotations

import logging
import threading
from collections import deque
from collections.abc import Callable

import cv2

from device.feeds.tap import Tap
from device.recorder.samples import Picture, picture
from drivers.grabber.base import VideoFrame

log = logging.getLogger(__name__)


class DevelopingTap(Tap[VideoFrame]):
    """A tap on a grabber: ``record`` is handed each picture before the survey can have it."""

    def __init__(self, size: int, on_close: Callable[[Tap[VideoFrame]], None], record: Callable[[Picture], object]) -> None:
        super().__init__(size, on_close)
        self._record = record
        self._exposed: deque[VideoFrame] = deque(maxlen=size)
        self._wake = threading.Condition()
        self._busy = 0
        self._thread = threading.Thread(target=self._develop, name="developing", daemon=True)
        self._thread.start()

    @property
    def waiting(self) -> int:
        """Those not yet developed too."""
        return len(self._exposed) + self._busy + super().waiting

    def offer(self, sample: VideoFrame) -> None:
        """Called by the feed. Returns at once."""
        with self._wake:
            if self._closed:
                return
            if len(self._exposed) == self._exposed.maxlen:
                self.dropped += 1
            self._exposed.append(sample)
            self._wake.notify()

    def close(self) -> None:
        """No more pictures. May be called twice."""
        super().close()
        with self._wake:
            self._exposed.clear()
            self._wake.notify()

    def _develop(self) -> None:
        while True:
            with self._wake:
                self._busy = 0
                while not self._exposed and not self._closed:
                    self._wake.wait()
                if self._closed:
                    return
                exposed = self._exposed.popleft()
                self._busy = 1
            try:
                developed = picture(exposed)
            except cv2.error as error:  # larger than any JPEG can be: the survey has it as it is
                log.error("a picture cannot be recorded: %s", error)
                super().offer(exposed)
                continue
            self._record(developed)
            super().offer(developed.frame())
