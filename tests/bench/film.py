"""Footage drawn beforehand: a virtual drive whose pictures cost the box no more than those of a camera."""

from __future__ import annotations

from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.virtual.drive import Drive
from drivers.virtual.grabber import Footage

_QUALITY = 92


class Film(Footage):
    """The first ``seconds`` of ``drive`` as JPEG; afterwards its last picture stays."""

    def __init__(self, drive: Drive, fps: float, seconds: float) -> None:
        super().__init__(drive, fps)
        numbers = range(round(seconds * fps))
        with ProcessPoolExecutor(2, get_context("spawn"), initializer=_take, initargs=(drive, fps)) as pool:
            self._pictures = list(pool.map(_drawn, numbers, chunksize=25))

    def picture(self, t: float, number: int, dark: bool = False) -> NDArray[np.uint8]:
        """See Footage."""
        kept = self._pictures[min(int(t * self.fps), len(self._pictures) - 1)]
        return np.asarray(cv2.imdecode(np.frombuffer(kept, np.uint8), cv2.IMREAD_COLOR), np.uint8)


_footage: Footage


def _take(drive: Drive, fps: float) -> None:
    global _footage
    cv2.setNumThreads(1)
    _footage = Footage(drive, fps)


def _drawn(number: int) -> bytes:
    picture = _footage.picture(number / _footage.fps, number)
    return bytes(cv2.imencode(".jpg", picture, (cv2.IMWRITE_JPEG_QUALITY, _QUALITY))[1])
