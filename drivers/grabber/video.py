"""Video files through the FFmpeg of cv2: every picture once, in its turn, with its time in the video."""

from __future__ import annotations

import math
import threading
import time
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.base import EndOfRecording, RecordingBroken, SensorLost
from drivers.grabber.base import FrameGrabber, VideoFrame

MOST_LOST = 50
"""A picture that cannot be decoded is a failed read, and so is the end: beyond so many in a row it is the end."""
USUAL_RATE = 25.0
"""For a video that states no frame rate and has no time stamps."""
CUT_OFF = 0.9
"""A video that ends before this share of the pictures it states is damaged. The stated number is itself often an estimate."""


def next_media_s(stamp_ms: float, last_s: float | None, frame_rate: float) -> float:
    """The time (s) of a picture in its video: its stamp, or one frame after the last where the stamp does not grow."""
    stamp = stamp_ms / 1000.0
    if last_s is None:
        return stamp if math.isfinite(stamp) and stamp >= 0 else 0.0
    return stamp if math.isfinite(stamp) and stamp > last_s else last_s + 1.0 / frame_rate


class VideoFile(FrameGrabber):
    """A video file, read as fast as it is asked for. Pictures count from 1, those that cannot be decoded too."""

    def __init__(self, file: Path | str) -> None:
        self._file = Path(file)
        self.name = f"video {self._file.name}"
        self._lock = threading.Lock()
        self._capture: cv2.VideoCapture | None = None
        self._number = 0
        self._media_s: float | None = None
        self._broken = False

    def _open(self) -> None:
        self.close()
        if not self._file.is_file():
            raise RecordingBroken(f"There is no video {self._file}.")
        # an absolute path, which FFmpeg cannot take for an option or a protocol
        capture = cv2.VideoCapture(str(self._file.resolve()), cv2.CAP_FFMPEG)
        if not capture.isOpened():
            capture.release()
            raise RecordingBroken(f"{self._file} is not a video that can be read.")
        rate, count = capture.get(cv2.CAP_PROP_FPS), capture.get(cv2.CAP_PROP_FRAME_COUNT)
        self.frame_rate = rate if 0 < rate < 1000 else None
        self.frame_count = int(count) if 0 < count < 1e9 else None
        with self._lock:
            self._number, self._media_s, self._broken = 0, None, False
            self._capture = capture

    def _read(self, timeout_s: float) -> VideoFrame:
        with self._lock:
            if self._capture is None:
                raise SensorLost(f"The {self.name} is not open.")
            image = None
            failed = 0
            while image is None and failed < MOST_LOST:
                image = self._decoded(self._capture)
                failed += image is None
            if image is None:
                raise self._end()
            self._number += 1 + failed
            stamp_ms = self._capture.get(cv2.CAP_PROP_POS_MSEC)
            self._media_s = next_media_s(stamp_ms, self._media_s, self.frame_rate or USUAL_RATE)
            return VideoFrame(image, time.monotonic_ns(), self._number, self._media_s, source=self._file.name)

    @staticmethod
    def _decoded(capture: cv2.VideoCapture) -> NDArray[np.uint8] | None:
        try:
            found, image = capture.read()
        except cv2.error:
            return None
        # cv2 may use its buffer again for the next picture
        return np.array(image, dtype=np.uint8) if found and image is not None else None

    def _end(self) -> EndOfRecording | RecordingBroken:
        stated = self.frame_count
        if stated is not None and self._number < CUT_OFF * stated and not self._broken:
            self._broken = True  # said once; what was read is good
            return RecordingBroken(f"The {self.name} breaks off: {self._number} of its {stated} pictures can be read.")
        return EndOfRecording(f"The {self.name} has been played to its end.")

    def close(self) -> None:
        """Stop and release. Never raises, may be called twice."""
        with self._lock:
            capture, self._capture = self._capture, None
        if capture is not None:
            capture.release()
