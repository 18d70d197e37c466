"""The depth camera as the rest of the house sees it: one abstract class, one frame."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.base import BadFrame
from drivers.stream_settings import StreamSettings
from estimators.pinhole import Intrinsics

STEREO_SCALE_STD = 0.004
"""Relative scale error that calibration and a window leave in active stereo: the shared recordings keep within it."""
TIME_OF_FLIGHT_SCALE_STD = 0.02
"""Time of flight reads a concave wall too far, since light also comes by way of the other side: some per cent."""


@dataclass(frozen=True)
class DepthFrame:
    """One depth picture. ``depth`` (H, W) uint16 in units of ``depth_unit_m``, 0 where nothing was measured.

    ``color`` (h, w, 3) uint8 BGR for the operator's eye, or None. ``monotonic_ns`` is the host's clock on arrival;
    ``number`` counts as the sensor counts, so that a gap is a lost frame. ``source`` says where it came from (camera, or file).
    ``scale_std`` is the relative error that every distance of this camera may share.
    """

    depth: NDArray[np.uint16]
    intrinsics: Intrinsics
    depth_unit_m: float
    monotonic_ns: int
    number: int
    color: NDArray[np.uint8] | None = None
    source: str = ""
    scale_std: float = STEREO_SCALE_STD


@dataclass(frozen=True)
class DepthSettings(StreamSettings):
    """What is asked of a depth camera, with or without ``color``. A camera that cannot do all of it does less and says so in
    ``DepthCamera.notice``."""

    color: bool = True


class DepthCamera(ABC):
    """One depth camera.

    A driver implements ``_open``, ``_read`` and ``close``, and ``reset`` where the hardware can be reset; it never overrides
    ``open`` or ``read``. ``read`` refuses a frame of the wrong shape, type or size, so that no estimator has to.
    """

    name: str = "depth camera"
    notice: str = ""
    """One sentence for the operator where the camera runs with less than was asked (no colour, fewer frames), else empty."""

    def open(self) -> None:
        """Start streaming. Raises SensorMissing where there is no camera, SensorLost where it does not start."""
        self._open()

    def read(self, timeout_s: float = 1.0) -> DepthFrame:
        """Wait for the next frame. Raises FrameTimeout, SensorLost, BadFrame, or EndOfRecording on replay."""
        frame = self._read(timeout_s)
        height, width = frame.intrinsics.height, frame.intrinsics.width
        if frame.depth.dtype != np.uint16 or frame.depth.shape != (height, width):
            raise BadFrame(
                f"The {self.name} sent a depth picture of {frame.depth.shape} {frame.depth.dtype}, "
                f"expected {(height, width)} uint16."
            )
        if not frame.depth_unit_m > 0:
            raise BadFrame(f"The {self.name} states a depth unit of {frame.depth_unit_m} m.")
        return frame

    @abstractmethod
    def _open(self) -> None: ...

    @abstractmethod
    def _read(self, timeout_s: float) -> DepthFrame: ...

    def reset(self) -> None:
        """Reset the hardware, where it can. The camera is closed afterwards; the default does no more than that."""
        self.close()

    @abstractmethod
    def close(self) -> None:
        """Stop and release. Never raises, may be called twice."""
