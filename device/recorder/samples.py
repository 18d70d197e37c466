"""What can be recorded: depth frames, pictures as JPEG, scans, readings of counter and navigation, words for the operator, and
notes of any kind."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.depth.base import DepthFrame
from drivers.encoder.base import Reading
from drivers.grabber.base import VideoFrame
from drivers.navigation.readings import NavReading
from drivers.navigation.scans import Scan

JPEG_QUALITY = 90
_PNG = b"\x89PNG"

Note = dict[str, Any]
"""Anything JSON-ready: estimates, what was consumed, findings."""


@dataclass(frozen=True)
class Picture:
    """A picture as it is recorded: what an estimator reads of it is ``frame``, decoded from ``jpeg`` (or from the PNG that it
    is where nothing may be lost)."""

    jpeg: bytes = field(repr=False)
    monotonic_ns: int
    number: int
    media_s: float | None = None
    source: str = ""

    @property
    def format(self) -> str:
        """ "jpeg" or "png", as its first bytes tell."""
        return "png" if self.jpeg.startswith(_PNG) else "jpeg"

    def frame(self) -> VideoFrame:
        """The picture as the estimators read it: (H, W, 3) BGR."""
        return VideoFrame(decoded(self.jpeg), self.monotonic_ns, self.number, self.media_s, self.source)


@dataclass(frozen=True)
class Words:
    """A prompt or another sentence for the operator."""

    code: str
    text: str


Sample = DepthFrame | Picture | Reading | Scan | NavReading | Words | Note


def picture(frame: VideoFrame, lossless: bool = False) -> Picture:
    """``frame`` as it is recorded; ``lossless`` for pictures that are matched with each other, at ten times the size."""
    data = _png(frame.image) if lossless else encoded(frame.image)
    return Picture(data, frame.monotonic_ns, frame.number, frame.media_s, frame.source)


def encoded(image: NDArray[np.uint8]) -> bytes:
    """JPEG of ``image`` (H, W, 3) BGR in its full size."""
    _, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    return data.tobytes()


def _png(image: NDArray[np.uint8]) -> bytes:
    _, data = cv2.imencode(".png", image, [cv2.IMWRITE_PNG_COMPRESSION, 1])
    return data.tobytes()


def decoded(jpeg: bytes) -> NDArray[np.uint8]:
    """(H, W, 3) BGR of a JPEG or a PNG. Raises ValueError for what is neither."""
    image = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)
    if image is None:
        raise ValueError("the picture is no JPEG and no PNG")
    return np.asarray(image, dtype=np.uint8)


def as_recorded(frame: DepthFrame) -> DepthFrame:
    """The frame as it comes back from a recording: its depth untouched, its colour through JPEG. What is judged of the colour
    is judged of this, so that a replay finds the same."""
    return frame if frame.color is None else replace(frame, color=decoded(encoded(frame.color)))


def size_of(sample: Sample) -> int:
    """Bytes that the sample holds in memory, roughly."""
    if isinstance(sample, DepthFrame):
        return sample.depth.nbytes + (0 if sample.color is None else sample.color.nbytes)
    if isinstance(sample, Scan):
        return 16 * len(sample.points)
    return len(sample.jpeg) if isinstance(sample, Picture) else 500
