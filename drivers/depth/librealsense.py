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

from drivers.base import BadFrame, DriverError, EndOfRecording, FrameTimeout, RecordingBroken, SensorLost, SensorMissing
from drivers.depth.base import STEREO_SCALE_STD, TIME_OF_FLIGHT_SCALE_STD, DepthCamera, DepthFrame, DepthSettings
from drivers.depth.bounded import call_within
from estimators.pinhole import DISTORTION_MODELS, Intrinsics

log = logging.getLogger(__name__)

START_SECONDS = 30.0
"""An OAK camera boots its firmware at every start, some 5 s over USB 2; librealsense itself waits 5 s for a device."""
STOP_SECONDS = 5.0
HANG_SECONDS = 1.0
"""How long after its own timeout a wait for frames counts as hung."""
PLAYBACK_SLICE_S = 0.1
"""How often the end of a recording is looked for: librealsense announces it by silence."""


@dataclass(frozen=True)
class _Request:
    """One set of streams to ask the camera for. ``size`` None and ``fps`` None: as recorded."""

    size: tuple[int, int] | None
    fps: int | None
    color: bool
    notice: str


@dataclass(frozen=True)
class _Session:
    """A pipeline that runs. ``playback`` is the recording's device, None on a camera."""

    pipeline: Any
    device: Any
    playback: Any | None
    depth_unit_m: float
    name: str
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
        self._loop = loop
        self._context: Any | None = None
        self._session: _Session | None = None
        self._last_number: int | None = None
        self.name = "depth camera" if recording is None else recording.name

    def _open(self) -> None:
        self.close()
        session = call_within(
            START_SECONDS,
            self._start,
            f"The {self.name} does not start: unplug it and plug it in again.",
            undo=lambda late: _stop(late.pipeline),
        )
        self.name, self.notice = session.name, session.notice
        self._last_number = None
        self._session = session
        if session.notice:
            log.warning("%s: %s", session.name, session.notice)

    def _start(self) -> _Session:
        rs = self._module
        serial = None if self._recording is not None else self._find()[1]
        first_error: RuntimeError | None = None
        for request in self._requests():
            pipeline, config = rs.pipeline(), rs.config()
            try:
                if self._recording is not None:
                    config.enable_device_from_file(str(self._recording), self._loop)
                elif serial:
                    config.enable_device(serial)
                self._enable(config, request)
                if self._recording is not None:
                    # before the start, or the first frames run away in real time
                    config.resolve(rs.pipeline_wrapper(pipeline)).get_device().as_playback().set_real_time(False)
                profile = pipeline.start(config)
            except RuntimeError as error:
                if self._recording is None and _says_gone(error):
                    raise SensorMissing("The depth camera is not there: plug it in, or try another cable.") from error
                first_error = first_error or error
                if self._recording is None and not request.color and "resolve" not in str(error):
                    break  # no lesser request helps a camera that is busy or broken
                continue
            return self._session_of(pipeline, profile, request)
        raise self._not_started(first_error) from first_error

    def _find(self) -> tuple[Any, str | None]:
        """The camera to use and its serial number, None where it states none. Raises SensorMissing."""
        rs = self._module
        try:
            if self._context is None:
                self._context = rs.context()
            devices = list(self._context.query_devices())
        except RuntimeError as error:
            raise SensorMissing(f"The depth cameras could not be listed: {error}.") from error
        if not devices:
            raise SensorMissing("No depth camera is plugged in.")
        serials = [_info(rs, device, "serial_number") for device in devices]
        wanted = self._settings.serial
        if wanted is not None and wanted not in serials:
            raise SensorMissing(f"No depth camera with serial number {wanted} is plugged in.")
        index = 0 if wanted is None else serials.index(wanted)
        return devices[index], serials[index]

    def _requests(self) -> Iterator[_Request]:
        """What to ask for, best first. Each later one asks less of the link, and its notice says what is missing."""
        settings = self._settings
        if self._recording is not None:
            if settings.color:
                yield _Request(None, None, True, "")
            yield _Request(None, None, False, "")
            return
        wanted = (settings.width, settings.height)
        sizes = [wanted] if wanted == (640, 480) else [wanted, (640, 480)]
        for size in sizes:
            lacks = [] if size == wanted else [f"depth is {size[0]} x {size[1]}"]
            if settings.color:
                yield _Request(size, settings.fps, True, _notice(lacks))
                lacks = [*lacks, "there is no colour picture"]
            yield _Request(size, settings.fps, False, _notice(lacks))
        for fps in (15, 6):
            for size in sizes if fps < settings.fps else []:
                lacks = [] if size == wanted else [f"depth is {size[0]} x {size[1]}"]
                lacks += ["there is no colour picture"] if settings.color else []
                yield _Request(size, fps, False, _notice([*lacks, f"it sends {fps} frames a second"]))

    def _enable(self, config: Any, request: _Request) -> None:
        rs = self._module
        if request.size is None or request.fps is None:
            config.enable_stream(rs.stream.depth)
            if request.color:
                config.enable_stream(rs.stream.color)
            return
        config.enable_stream(rs.stream.depth, *request.size, rs.format.z16, request.fps)
        if request.color:
            config.enable_stream(rs.stream.color, *request.size, rs.format.bgr8, request.fps)

    def _session_of(self, pipeline: Any, profile: Any, request: _Request) -> _Session:
        rs = self._module
        try:
            device = profile.get_device()
            sensor = device.first_depth_sensor()
            # librealsense keeps the unit as a 32-bit float: its shortest decimal is the number that was meant
            unit = float(str(np.float32(sensor.get_depth_scale())))
            lacks = [] if self._recording is not None else self._set_options(sensor)
            swap = False
            if self._recording is not None and request.color:
                swap = profile.get_stream(rs.stream.color).format() == rs.format.rgb8
            name = _info(rs, device, "name") or self.name
            return _Session(
                pipeline=pipeline,
                device=device,
                playback=None if self._recording is None else device.as_playback(),
                depth_unit_m=unit,
                name=name if self._recording is None else self._recording.name,
                notice=" ".join([part for part in (request.notice, _notice(lacks)) if part]),
                swap_color=swap,
                scale_std=_scale_std(_info(rs, device, "product_line")),
            )
        except RuntimeError as error:
            _stop(pipeline)
            raise SensorLost(f"The {self.name} went away while it was starting: {error}.") from error

    def _set_options(self, sensor: Any) -> list[str]:
        """Emitter, laser power and exposure, where the camera has them. Returns what it refused, for the operator."""
        rs, settings = self._module, self._settings
        wanted: list[tuple[Any, float, str]] = [(rs.option.emitter_enabled, float(settings.emitter), "its emitter")]
        if settings.laser_power is not None and sensor.supports(rs.option.laser_power):
            most = sensor.get_option_range(rs.option.laser_power).max
            wanted.append((rs.option.laser_power, settings.laser_power * most, "its laser power"))
        if settings.exposure_us is not None:
            wanted.append((rs.option.enable_auto_exposure, 0.0, "its automatic exposure"))
            wanted.append((rs.option.exposure, float(settings.exposure_us), "its exposure"))
        refused = []
        for option, value, what in wanted:
            if not sensor.supports(option):
                log.info("%s has no option for %s", self.name, what)
                continue
            try:
                sensor.set_option(option, value)
            except RuntimeError as error:
                log.warning("%s: could not set %s to %s: %s", self.name, what, value, error)
                refused.append(f"{what} could not be set")
        return refused

    def _not_started(self, error: RuntimeError | None) -> DriverError:
        if self._recording is not None:
            if not self._recording.is_file():
                return RecordingBroken(f"There is no recording {self._recording.name}.")
            return RecordingBroken(f"The recording {self._recording.name} cannot be played: it is damaged or holds no depth.")
        return SensorLost(f"The {self.name} is there but does not start: {error}.")

    def _read(self, timeout_s: float) -> DepthFrame:
        session = self._session
        if session is None:
            raise SensorLost(f"The {self.name} is not open.")
        deadline = time.monotonic() + timeout_s
        while True:
            frames = self._wait(session, deadline, timeout_s)
            arrived_ns = time.monotonic_ns()
            depth_frame = frames.get_depth_frame()
            if not depth_frame:
                raise BadFrame(f"The {self.name} sent a frame without depth.")
            number = int(depth_frame.get_frame_number())
            if number == self._last_number and session.playback is None:
                continue  # the set was completed with a picture that has been read before: only a new one counts
            self._last_number = number
            return self._frame(session, frames, depth_frame, number, arrived_ns)

    def _wait(self, session: _Session, deadline: float, timeout_s: float) -> Any:
        while True:
            remaining = deadline - time.monotonic()
            if remaining <= 0:
                raise FrameTimeout(f"The {self.name} sent no picture for {timeout_s:g} s.")
            slice_s = remaining if session.playback is None else min(remaining, PLAYBACK_SLICE_S)
            timeout_ms = max(1, round(slice_s * 1000))
            try:
                if session.playback is not None:
                    return session.pipeline.wait_for_frames(timeout_ms)
                return call_within(
                    slice_s + HANG_SECONDS,
                    partial(session.pipeline.wait_for_frames, timeout_ms),
                    f"The {self.name} hangs: unplug it and plug it in again.",
                )
            except RuntimeError as error:
                if "didn't arrive" not in str(error):
                    raise SensorLost(f"The {self.name} is gone: {error}.") from error
                if session.playback is not None:
                    if session.playback.current_status() == self._module.playback_status.stopped:
                        raise EndOfRecording(f"The recording {self.name} has been played to its end.") from error
                elif not _connected(session.device):
                    raise SensorLost(f"The {self.name} has been unplugged.") from error

    def _frame(self, session: _Session, frames: Any, depth_frame: Any, number: int, arrived_ns: int) -> DepthFrame:
        try:
            # copied: the library takes its buffer back for a later frame
            depth = np.array(np.asanyarray(depth_frame.get_data()), copy=True)
            intrinsics = intrinsics_of(depth_frame.profile.as_video_stream_profile().get_intrinsics())
            color_frame = frames.get_color_frame()
            color: NDArray[np.uint8] | None = None
            if color_frame:
                channels = np.asanyarray(color_frame.get_data())
                if channels.dtype == np.uint8 and channels.ndim == 3 and channels.shape[2] == 3:  # old recordings may hold YUYV
                    color = np.array(channels[..., ::-1] if session.swap_color else channels, copy=True)
        except (RuntimeError, ValueError, TypeError, BufferError) as error:
            raise BadFrame(f"The {self.name} sent a frame that cannot be read: {error}.") from error
        return DepthFrame(
            depth=depth,
            intrinsics=intrinsics,
            depth_unit_m=session.depth_unit_m,
            monotonic_ns=arrived_ns,
            number=number,
            color=color,
            source=session.name,
            scale_std=session.scale_std,
        )

    def reset(self) -> None:
        """Reset the hardware where it can be reset. The camera is closed afterwards and away from the bus for some seconds."""
        session = self._session
        self.close()
        if self._recording is not None:
            return

        def reset() -> None:
            device = self._find()[0] if session is None else session.device
            device.hardware_reset()

        try:
            call_within(STOP_SECONDS, reset, f"The {self.name} does not answer to a reset.")
        except (RuntimeError, DriverError) as error:
            log.warning("%s could not be reset: %s", self.name, error)

    def close(self) -> None:
        """Stop and release. Never raises, may be called twice; leaves behind a library call that does not come back."""
        session, self._session = self._session, None
        if session is not None:
            _stop(session.pipeline)


def intrinsics_of(found: Any) -> Intrinsics:
    """The house's Intrinsics from pyrealsense2's. Raises BadFrame for a lens model or numbers nothing here can compute with."""
    model = getattr(found.model, "name", str(found.model))
    coeffs = tuple(float(value) for value in found.coeffs)
    if not any(coeffs):
        model = "none"
    if model not in DISTORTION_MODELS:
        raise BadFrame(f"The camera states a lens model {model}, which cannot be computed with.")
    try:
        return Intrinsics(
            width=int(found.width),
            height=int(found.height),
            fx=float(found.fx),
            fy=float(found.fy),
            ppx=float(found.ppx),
            ppy=float(found.ppy),
            model=model,
            coeffs=coeffs,
        )
    except ValueError as error:
        raise BadFrame(f"The camera states impossible intrinsics: {error}.") from error


def _notice(lacks: list[str]) -> str:
    if not lacks:
        return ""
    text = ", ".join(lacks) + ": the camera or its USB link does no more."
    return text[0].upper() + text[1:]


def _says_gone(error: RuntimeError) -> bool:
    text = str(error).lower()
    return "no device" in text or "disconnected" in text


def _connected(device: Any) -> bool:
    asked = getattr(device, "is_connected", None)  # not on every release of pyrealsense2
    if asked is None:
        return True
    try:
        return bool(asked())
    except RuntimeError:
        return False


def _scale_std(product_line: str | None) -> float:
    """By the principle of the camera: L500 is librealsense's time-of-flight line, the others say ToF."""
    line = product_line or ""
    return TIME_OF_FLIGHT_SCALE_STD if "ToF" in line or line == "L500" else STEREO_SCALE_STD


def _info(rs: Any, device: Any, what: str) -> str | None:
    """A text the device states of itself, or None."""
    key = getattr(rs.camera_info, what)
    return str(device.get_info(key)) if device.supports(key) else None


def _stop(pipeline: Any) -> None:
    try:
        call_within(STOP_SECONDS, pipeline.stop, "The depth camera does not stop.")
    except (RuntimeError, SensorLost) as error:
        log.warning("a depth camera was left behind while stopping: %s", error)
