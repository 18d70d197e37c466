"""The depth camera driver: written once against the pyrealsense2 surface, and given the module to use.

The module is ``pyrealsense2`` itself, ``drivers.depth.depthai_rs`` (the same surface over DepthAI, for OAK cameras) or the
virtual camera. Depth is never resampled: colour is for the operator's eye and comes as the camera took it.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.base import BadFrame, SensorLost
from drivers.depth.base import STEREO_SCALE_STD, TIME_OF_FLIGHT_SCALE_STD, DepthCamera, DepthFrame, DepthSettings
from drivers.depth.session import Request, Session, info, intrinsics_of, light, notice

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class _About:
    """What is kept of a pipeline that runs."""

    depth_unit_m: float
    source: str
    notice: str
    swap_color: bool
    scale_std: float


class LibrealsenseCamera(DepthCamera):
    """A camera, or a recording of one, behind the pyrealsense2 surface.

    ``module`` has pipeline, config, context, stream, format, option and camera_info. ``recording`` plays a .db3 or .bag file in
    place of a camera, every frame in its turn; ``loop`` starts it again at its end, where otherwise EndOfRecording is raised.
    """

    def __init__(
        self, module: Any, settings: DepthSettings | None = None, *, recording: Path | None = None, loop: bool = False
    ) -> None:
        self._module = module
        self._settings = settings or DepthSettings()
        self._recording = recording
        self._session: Session[_About] = Session(
            module, "depth camera", self._describe, serial=self._settings.serial, recording=recording, loop=loop
        )
        self._last_number: int | None = None
        self.name = self._session.name

    def _open(self) -> None:
        running = self._session.open(self._requests())
        self.name, self.notice = self._session.name, running.about.notice
        self._last_number = None
        if self.notice:
            log.warning("%s: %s", self.name, self.notice)

    def _requests(self) -> Iterator[Request]:
        """What to ask for, best first. Each later one asks less of the link, and its notice says what is missing."""
        settings = self._settings
        if self._recording is not None:
            if settings.color:
                yield Request(partial(self._enable, None, None, True), color=True)
            yield Request(partial(self._enable, None, None, False))
            return
        wanted = (settings.width, settings.height)
        sizes = [wanted] if wanted == (640, 480) else [wanted, (640, 480)]
        for size in sizes:
            lacks = [] if size == wanted else [f"depth is {size[0]} x {size[1]}"]
            if settings.color:
                yield Request(partial(self._enable, size, settings.fps, True), notice(lacks), color=True)
                lacks = [*lacks, "there is no colour picture"]
            yield Request(partial(self._enable, size, settings.fps, False), notice(lacks), last_hope=True)
        for fps in (15, 6):
            for size in sizes if fps < settings.fps else []:
                lacks = [] if size == wanted else [f"depth is {size[0]} x {size[1]}"]
                lacks += ["there is no colour picture"] if settings.color else []
                told = notice([*lacks, f"it sends {fps} frames a second"])
                yield Request(partial(self._enable, size, fps, False), told, last_hope=True)

    def _enable(self, size: tuple[int, int] | None, fps: int | None, color: bool, config: Any) -> None:
        """``size`` None and ``fps`` None: as recorded."""
        rs = self._module
        if size is None or fps is None:
            config.enable_stream(rs.stream.depth)
            if color:
                config.enable_stream(rs.stream.color)
            return
        config.enable_stream(rs.stream.depth, *size, rs.format.z16, fps)
        if color:
            config.enable_stream(rs.stream.color, *size, rs.format.bgr8, fps)

    def _describe(self, device: Any, profile: Any, request: Request) -> _About:
        rs = self._module
        sensor = device.first_depth_sensor()
        # librealsense keeps the unit as a 32-bit float: its shortest decimal is the number that was meant
        unit = float(str(np.float32(sensor.get_depth_scale())))
        lacks = [] if self._recording is not None else light(rs, self.name, sensor, self._settings)
        swap = False
        if self._recording is not None and request.color:
            swap = profile.get_stream(rs.stream.color).format() == rs.format.rgb8
        return _About(
            depth_unit_m=unit,
            source=(info(rs, device, "name") or self.name) if self._recording is None else self._recording.name,
            notice=" ".join([part for part in (request.notice, notice(lacks)) if part]),
            swap_color=swap,
            scale_std=_scale_std(info(rs, device, "product_line")),
        )

    def _read(self, timeout_s: float) -> DepthFrame:
        running = self._session.running
        if running is None:
            raise SensorLost(f"The {self.name} is not open.")
        deadline = time.monotonic() + timeout_s
        while True:
            frames = self._session.wait(deadline, timeout_s)
            arrived_ns = time.monotonic_ns()
            depth_frame = frames.get_depth_frame()
            if not depth_frame:
                raise BadFrame(f"The {self.name} sent a frame without depth.")
            number = int(depth_frame.get_frame_number())
            if number == self._last_number and running.playback is None:
                continue  # the set was completed with a picture that has been read before: only a new one counts
            self._last_number = number
            return self._frame(running.about, frames, depth_frame, number, arrived_ns)

    def _frame(self, about: _About, frames: Any, depth_frame: Any, number: int, arrived_ns: int) -> DepthFrame:
        try:
            # copied: the library takes its buffer back for a later frame
            depth = np.array(np.asanyarray(depth_frame.get_data()), copy=True)
            intrinsics = intrinsics_of(depth_frame.profile.as_video_stream_profile().get_intrinsics())
            color_frame = frames.get_color_frame()
            color: NDArray[np.uint8] | None = None
            if color_frame:
                channels = np.asanyarray(color_frame.get_data())
                if channels.dtype == np.uint8 and channels.ndim == 3 and channels.shape[2] == 3:  # old recordings may hold YUYV
                    color = np.array(channels[..., ::-1] if about.swap_color else channels, copy=True)
        except (RuntimeError, ValueError, TypeError, BufferError) as error:
            raise BadFrame(f"The {self.name} sent a frame that cannot be read: {error}.") from error
        return DepthFrame(
            depth=depth,
            intrinsics=intrinsics,
            depth_unit_m=about.depth_unit_m,
            monotonic_ns=arrived_ns,
            number=number,
            color=color,
            source=about.source,
            scale_std=about.scale_std,
        )

    def reset(self) -> None:
        """Reset the hardware where it can be reset. The camera is closed afterwards and away from the bus for some seconds."""
        self._session.reset()

    def close(self) -> None:
        """Stop and release. Never raises, may be called twice; leaves behind a library call that does not come back."""
        self._session.close()


def _scale_std(product_line: str | None) -> float:
    """By the principle of the camera: L500 is librealsense's time-of-flight line, the others say ToF."""
    line = product_line or ""
    return TIME_OF_FLIGHT_SCALE_STD if "ToF" in line or line == "L500" else STEREO_SCALE_STD
