"""The stereo camera as the rest of the house sees it: one abstract class, one rectified pair."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.base import BadFrame
from drivers.stream_settings import StreamSettings
from estimators.pinhole import Intrinsics


@dataclass(frozen=True)
class StereoFrame:
    """One rectified pair: ``left`` and ``right`` (H, W) grey or (H, W, 3) BGR, uint8; rows of both show the same line of sight.

    ``intrinsics`` of the left picture, without distortion. ``offset_px`` is what the camera knows to be too much in every
    disparity, None where it does not know (pictures that were shifted); ``offset_std_px`` and ``scale_std`` (relative, of the
    baseline) are how well it knows. ``monotonic_ns`` is the host's clock on arrival; ``number`` counts as the sensor counts.
    """

    left: NDArray[np.uint8]
    right: NDArray[np.uint8]
    intrinsics: Intrinsics
    baseline_m: float
    offset_px: float | None
    monotonic_ns: int
    number: int
    source: str = ""
    offset_std_px: float = 0.0
    scale_std: float = 0.0


@dataclass(frozen=True)
class PairSettings(StreamSettings):
    """What is asked of a live stereo camera; few pairs a second, since a pair takes a box a second to read. One that cannot do
    all of it does less and says so in ``StereoCamera.notice``."""

    width: int = 1280
    height: int = 720
    fps: int = 6


class StereoCamera(ABC):
    """One stereo camera.

    A driver implements ``_open``, ``_read`` and ``close``, and ``reset`` where the hardware can be reset; it never overrides
    ``open`` or ``read``. ``read`` refuses a pair of the wrong shape, type or size, so that no estimator has to.
    """

    name: str = "stereo camera"
    notice: str = ""
    """One sentence for the operator where the camera runs with less than was asked, else empty."""

    def open(self) -> None:
        """Start streaming. Raises SensorMissing where there is no camera, SensorLost where it does not start."""
        self._open()

    def read(self, timeout_s: float = 1.0) -> StereoFrame:
        """Wait for the next pair. Raises FrameTimeout, SensorLost, BadFrame, or EndOfRecording on replay."""
        frame = self._read(timeout_s)
        size = frame.intrinsics.height, frame.intrinsics.width
        for picture in (frame.left, frame.right):
            if picture.dtype != np.uint8 or picture.shape[:2] != size or picture.ndim not in (2, 3):
                raise BadFrame(f"The {self.name} sent a picture of {picture.shape} {picture.dtype}, expected {size} uint8.")
        if not frame.baseline_m > 0:
            raise BadFrame(f"The {self.name} states a baseline of {frame.baseline_m} m.")
        return frame

    @abstractmethod
    def _open(self) -> None: ...

    @abstractmethod
    def _read(self, timeout_s: float) -> StereoFrame: ...

    def reset(self) -> None:
        """Reset the hardware, where it can. The camera is closed afterwards; the default does no more than that."""
        self.close()

    @abstractmethod
    def close(self) -> None:
        """Stop and release. Never raises, may be called twice."""
