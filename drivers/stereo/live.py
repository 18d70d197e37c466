"""The rectified infrared pair of a RealSense or an OAK: written once against the pyrealsense2 surface, as the depth camera is.

The module is ``pyrealsense2`` itself or ``drivers.depth.depthai_rs``. Both devices rectify their pair and say of each stream
what it is seen through; what they say is checked. The dot projector is on: it is the texture of a smooth wall.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.base import BadFrame, SensorLost
from drivers.depth.base import STEREO_SCALE_STD
from drivers.depth.session import Request, Session, info, intrinsics_of, light, notice
from drivers.stereo.base import PairSettings, StereoCamera, StereoFrame
from estimators.pinhole import Intrinsics

log = logging.getLogger(__name__)

OFFSET_STD_PX = 0.2
"""Disparity error that a factory calibration leaves: makers promise 2 % of the distance where the disparity is ten pixels."""
_PARALLEL = 0.002
"""A rectified pair's axes are parallel, and its step sideways is level, to this (rad, and share of the baseline)."""
_ALIKE_PX = 0.5


@dataclass(frozen=True)
class _About:
    """What is kept of a pipeline that runs."""

    source: str
    notice: str
    baseline_m: float


class LivePair(StereoCamera):
    """The pair of one camera behind the pyrealsense2 surface. ``module`` has pipeline, config, context, stream, format, option
    and camera_info."""

    def __init__(self, module: Any, settings: PairSettings | None = None) -> None:
        self._module = module
        self._settings = settings or PairSettings()
        self._session: Session[_About] = Session(module, "stereo camera", self._describe, serial=self._settings.serial)
        self._last: int | None = None
        self.name = self._session.name

    def _open(self) -> None:
        running = self._session.open(self._requests())
        self.name, self.notice = self._session.name, running.about.notice
        self._last = None
        if self.notice:
            log.warning("%s: %s", self.name, self.notice)

    def _requests(self) -> Iterator[Request]:
        """What to ask for, best first: smaller pictures before fewer of them, since the pipe stands still meanwhile."""
        settings = self._settings
        wanted = (settings.width, settings.height)
        sizes = [wanted, *(size for size in ((848, 480), (640, 480), (640, 400)) if size[0] < wanted[0])]
        rates = [settings.fps, *(fps for fps in (15, 6) if fps < settings.fps)]
        for fps in rates:
            for size in sizes:
                lacks = [] if size == wanted else [f"the pictures are {size[0]} x {size[1]}"]
                lacks += [] if fps == settings.fps else [f"it sends {fps} pairs a second"]
                yield Request(partial(self._enable, size, fps), notice(lacks), last_hope=True)

    def _enable(self, size: tuple[int, int], fps: int, config: Any) -> None:
        rs = self._module
        for index in (1, 2):
            config.enable_stream(rs.stream.infrared, index, *size, rs.format.y8, fps)

    def _describe(self, device: Any, profile: Any, request: Request) -> _About:
        rs = self._module
        refused = light(rs, self.name, device.first_depth_sensor(), self._settings)
        left, right = (profile.get_stream(rs.stream.infrared, index) for index in (1, 2))
        name = info(rs, device, "name") or self.name
        return _About(
            source=name,
            notice=" ".join(part for part in (request.notice, notice(refused)) if part),
            baseline_m=_baseline(name, left.get_extrinsics_to(right)),
        )

    def _read(self, timeout_s: float) -> StereoFrame:
        running = self._session.running
        if running is None:
            raise SensorLost(f"The {self.name} is not open.")
        deadline = time.monotonic() + timeout_s
        while True:
            frames = self._session.wait(deadline, timeout_s)
            arrived_ns = time.monotonic_ns()
            left, right = frames.get_infrared_frame(1), frames.get_infrared_frame(2)
            if not left or not right:
                continue  # the other picture of this moment was lost on its way
            number = int(left.get_frame_number())
            if number == self._last or abs(left.get_timestamp() - right.get_timestamp()) > 500.0 / self._settings.fps:
                continue  # read before, or not of one moment
            self._last = number
            return self._frame(running.about, left, right, number, arrived_ns)

    def _frame(self, about: _About, left: Any, right: Any, number: int, arrived_ns: int) -> StereoFrame:
        try:
            pictures = [_picture(frame) for frame in (left, right)]
            lenses = [intrinsics_of(frame.profile.as_video_stream_profile().get_intrinsics()) for frame in (left, right)]
        except (RuntimeError, ValueError, TypeError, BufferError) as error:
            raise BadFrame(f"The {self.name} sent a pair that cannot be read: {error}.") from error
        self._refuse_unless_rectified(*lenses)
        return StereoFrame(
            left=pictures[0],
            right=pictures[1],
            intrinsics=lenses[0],
            baseline_m=about.baseline_m,
            offset_px=lenses[0].ppx - lenses[1].ppx,
            monotonic_ns=arrived_ns,
            number=number,
            source=about.source,
            offset_std_px=OFFSET_STD_PX,
            scale_std=STEREO_SCALE_STD,
        )

    def _refuse_unless_rectified(self, left: Intrinsics, right: Intrinsics) -> None:
        apart = max(abs(left.fx - right.fx), abs(left.fy - right.fy), abs(left.ppy - right.ppy))
        if any(left.coeffs) or any(right.coeffs) or apart > _ALIKE_PX:
            raise BadFrame(f"The {self.name} sends a pair that is not rectified: it cannot be matched along its rows.")

    def reset(self) -> None:
        """Reset the hardware where it can be reset. The camera is closed afterwards and away from the bus for some seconds."""
        self._session.reset()

    def close(self) -> None:
        """Stop and release. Never raises, may be called twice; leaves behind a library call that does not come back."""
        self._session.close()


def _picture(frame: Any) -> NDArray[np.uint8]:
    """(H, W), copied: the library takes its buffer back for a later frame. Raises ValueError for what is no grey picture."""
    found = np.array(np.asanyarray(frame.get_data()), copy=True)
    if found.dtype != np.uint8 or found.ndim != 2:
        raise ValueError(f"a picture of {found.shape} {found.dtype}")
    return found


def _baseline(name: str, between: Any) -> float:
    """Metres from the left camera to the right one, which must stand beside it. Raises SensorLost.

    A point lies by the baseline further left for the right camera: p_right = R p_left + t has t = (-b, 0, 0).
    """
    step = np.asarray(between.translation, dtype=np.float64)
    turned = np.asarray(between.rotation, dtype=np.float64).reshape(3, 3) - np.eye(3)
    baseline = float(-step[0])
    level = bool(np.abs(step[1:]).max() <= _PARALLEL * max(baseline, 0.0))
    if not (0.005 <= baseline <= 1.0 and level and np.abs(turned).max() <= _PARALLEL):
        raise SensorLost(f"The {name} does not say how its two cameras stand to each other: its calibration is missing.")
    return baseline
