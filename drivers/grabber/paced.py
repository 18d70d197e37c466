"""A recording played as fast as it was made: what a drive on the page needs, where reading ahead would lose pictures."""

from __future__ import annotations

import time
from dataclasses import replace

from drivers.base import FrameTimeout
from drivers.grabber.base import FrameGrabber, VideoFrame

LATE_S = 1.0
"""Who takes pictures slower than they were made is not hurried after such a delay."""


class PacedGrabber(FrameGrabber):
    """``recording`` in the time of its own. Played again, its times go on from where they ended."""

    def __init__(self, recording: FrameGrabber) -> None:
        self._recording = recording
        self.name, self.notice = recording.name, recording.notice
        self._next: VideoFrame | None = None
        self._begun: float | None = None
        self._shift = self._last = 0.0

    def _open(self) -> None:
        self._recording.open()
        self.notice = self._recording.notice
        self.frame_rate, self.frame_count = self._recording.frame_rate, self._recording.frame_count
        self._next, self._begun = None, None

    def _read(self, timeout_s: float) -> VideoFrame:
        frame = self._next or self._recording.read(timeout_s)
        if frame.media_s is None:
            return frame
        now = time.monotonic()
        if self._begun is None:
            self._shift = self._last + (1 / self.frame_rate if self.frame_rate and self._last else 0.0) - frame.media_s
            self._begun = now - frame.media_s
        wait = self._begun + frame.media_s - now
        if wait < -LATE_S:
            self._begun -= wait
        if wait > timeout_s:
            self._next = frame
            time.sleep(timeout_s)
            raise FrameTimeout(f"The next picture of {self.name} is not due yet.")
        time.sleep(max(wait, 0.0))
        self._next, self._last = None, frame.media_s + self._shift
        return replace(frame, monotonic_ns=time.monotonic_ns(), media_s=self._last)

    def close(self) -> None:
        """See FrameGrabber."""
        self._recording.close()
