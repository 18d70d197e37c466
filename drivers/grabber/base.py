"""The source of CCTV pictures as the rest of the house sees it: one abstract class, one frame."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.base import BadFrame, FrameTimeout


@dataclass(frozen=True)
class VideoFrame:
    """One picture. ``image`` (H, W, 3) uint8 BGR.

    ``monotonic_ns`` is when it was taken on the host's clock (live: on arrival). ``media_s`` is its time in the recording it
    comes from, None for a live source; what is measured from a recording uses it, so that a video read faster than it was made
    gives the same result. ``number`` counts as the source counts, so that a gap is a lost frame. ``source`` names the file or
    device.
    """

    image: NDArray[np.uint8]
    monotonic_ns: int
    number: int
    media_s: float | None = None
    source: str = ""

    @property
    def time_s(self) -> float:
        """Seconds on the clock that this frame's run is measured with."""
        return self.monotonic_ns / 1e9 if self.media_s is None else self.media_s


class NoSignal(FrameTimeout):
    """The grabber works, but no camera sends anything into it."""


class FrameGrabber(ABC):
    """One source of pictures.

    A driver implements ``_open``, ``_read`` and ``close``, and ``reset`` where the hardware can be reset; it never overrides
    ``open`` or ``read``. No call blocks for more than some seconds, whatever the device does.
    """

    name: str = "CCTV grabber"
    notice: str = ""
    """One sentence for the operator where it runs with less than was asked, else empty."""
    frame_rate: float | None = None
    """Frames a second that the source states once it is open, None where it does not."""
    frame_count: int | None = None
    """Frames of a recording once it is open, as far as known; None for a live source."""

    def open(self) -> None:
        """Start. Raises SensorMissing where there is no such source, SensorLost where it does not start."""
        self._open()

    def read(self, timeout_s: float = 1.5) -> VideoFrame:
        """Wait for the next picture. Raises FrameTimeout, SensorLost, BadFrame, or EndOfRecording."""
        frame = self._read(timeout_s)
        if frame.image.dtype != np.uint8 or frame.image.ndim != 3 or frame.image.shape[2] != 3 or frame.image.size == 0:
            raise BadFrame(f"The {self.name} sent a picture of {frame.image.shape} {frame.image.dtype}.")
        return frame

    @abstractmethod
    def _open(self) -> None: ...

    @abstractmethod
    def _read(self, timeout_s: float) -> VideoFrame: ...

    def reset(self) -> None:
        """Reset the hardware, where it can. The source is closed afterwards; the default does no more than that."""
        self.close()

    @abstractmethod
    def close(self) -> None:
        """Stop and release. Never raises, may be called twice."""
