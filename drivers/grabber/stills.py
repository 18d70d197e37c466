"""A folder of stills as a video: each picture's name is its time in milliseconds (``129000.jpg``, ``129040.5.png``)."""

from __future__ import annotations

import re
import threading
import time
from itertools import pairwise
from pathlib import Path

import numpy as np

from drivers.base import EndOfRecording, RecordingBroken, SensorLost
from drivers.grabber.base import FrameGrabber, VideoFrame
from drivers.picture_folder import read_picture

SUFFIXES = (".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff", ".webp")
_MILLISECONDS = re.compile(r"\d{1,12}(\.\d{1,6})?", re.ASCII)


def named_time_s(path: Path) -> float | None:
    """The time (s) that a picture's name tells, None where it tells none."""
    return float(path.stem) / 1000.0 if _MILLISECONDS.fullmatch(path.stem) else None


class StillsFolder(FrameGrabber):
    """The stills of a folder in the order of their times, read as fast as they are asked for. Pictures count from 1.

    A still that cannot be read is RecordingBroken, and the next read goes on behind it: its number is missing.
    """

    def __init__(self, folder: Path | str) -> None:
        self._folder = Path(folder)
        self.name = f"stills {self._folder.name}"
        self._lock = threading.Lock()
        self._stills: list[tuple[float, Path]] | None = None
        self._next = 0

    def _open(self) -> None:
        if not self._folder.is_dir():
            raise RecordingBroken(f"There is no folder {self._folder}.")
        try:
            pictures = [path for path in self._folder.iterdir() if path.suffix.lower() in SUFFIXES]
        except OSError as error:
            raise RecordingBroken(f"The folder {self._folder} cannot be read: {error}.") from error
        timed = {path: named_time_s(path) for path in pictures}
        stills = sorted((moment, path) for path, moment in timed.items() if moment is not None)
        if not stills:
            raise RecordingBroken(f"The folder {self._folder} has no picture whose name is a number of milliseconds.")
        for (earlier, one), (later, other) in pairwise(stills):
            if later <= earlier:
                raise RecordingBroken(f"The folder {self._folder} has two pictures of one moment: {one.name} and {other.name}.")
        left_out = len(pictures) - len(stills)
        self.notice = f"{left_out} pictures without a time in their name are left out." if left_out else ""
        steps = np.diff([moment for moment, _ in stills])
        self.frame_rate = float(1.0 / np.median(steps)) if len(steps) else None
        self.frame_count = len(stills)
        with self._lock:
            self._stills, self._next = stills, 0

    def _read(self, timeout_s: float) -> VideoFrame:
        with self._lock:
            if self._stills is None:
                raise SensorLost(f"The {self.name} is not open.")
            if self._next >= len(self._stills):
                raise EndOfRecording(f"The {self.name} has been played to its end.")
            media_s, path = self._stills[self._next]
            self._next += 1  # before it is read: a broken picture is reported once and then left behind
            number = self._next
        image = np.asarray(read_picture(path), dtype=np.uint8)
        return VideoFrame(image, time.monotonic_ns(), number, media_s, source=path.name)

    def close(self) -> None:
        """Stop. Never raises, may be called twice."""
        with self._lock:
            self._stills = None
