"""A running pipeline behind the pyrealsense2 surface: found on the bus, started with what the camera can do, waited for with an
end to the waiting, reset, stopped. What is read from its frames is the business of the drivers that use it.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Generic, Protocol, TypeVar

from drivers.base import BadFrame, DriverError, EndOfRecording, FrameTimeout, RecordingBroken, SensorLost, SensorMissing
from drivers.bounded import call_within
from estimators.pinhole import DISTORTION_MODELS, Intrinsics

log = logging.getLogger(__name__)

START_SECONDS = 30.0
"""An OAK camera boots its firmware at every start, some 5 s over USB 2; librealsense itself waits 5 s for a device."""
STOP_SECONDS = 5.0
HANG_SECONDS = 1.0
"""How long after its own timeout a wait for frames counts as hung."""
PLAYBACK_SLICE_S = 0.1
"""How often the end of a recording is looked for: librealsense announces it by silence."""

T = TypeVar("T")


@dataclass(frozen=True)
class Request:
    """One set of streams to ask the camera for, and what the operator is told that it lacks. ``enable`` puts it into a config.

    ``last_hope``: a camera that does not start with this one is busy or broken, and no lesser request helps it.
    """

    enable: Callable[[Any], None]
    notice: str = ""
    color: bool = False
    last_hope: bool = False


class Lighting(Protocol):
    """What is asked of a camera's projector and exposure: see ``drivers.depth.base.DepthSettings``."""

    @property
    def emitter(self) -> bool: ...
    @property
    def exposure_us(self) -> int | None: ...
    @property
    def laser_power(self) -> float | None: ...


@dataclass(frozen=True)
class Running(Generic[T]):
    """A pipeline that runs. ``playback`` is the recording's device, None on a camera; ``about`` what its driver keeps of it."""

    pipeline: Any
    device: Any
    playback: Any | None
    about: T


class Session(Generic[T]):
    """One camera, or a recording of one, of ``module``. ``noun`` is what the operator knows the sensor as.

    ``describe`` makes of (device, profile, request) what the driver keeps of a pipeline that has just started.
    """

    def __init__(
        self,
        module: Any,
        noun: str,
        describe: Callable[[Any, Any, Request], T],
        *,
        serial: str | None = None,
        recording: Path | None = None,
        loop: bool = False,
    ) -> None:
        self._module = module
        self._noun = noun
        self._describe = describe
        self._serial = serial
        self._recording = recording
        self._loop = loop
        self._context: Any | None = None
        self.name = noun if recording is None else recording.name
        self.running: Running[T] | None = None

    def open(self, requests: Iterable[Request]) -> Running[T]:
        """Start with the first of ``requests`` that the camera can do. Raises SensorMissing, SensorLost, RecordingBroken."""
        self.close()
        running = call_within(
            START_SECONDS,
            lambda: self._start(requests),
            f"The {self.name} does not start: unplug it and plug it in again.",
            undo=lambda late: _stop(late.pipeline),
        )
        self.running = running
        return running

    def _start(self, requests: Iterable[Request]) -> Running[T]:
        rs = self._module
        serial = None if self._recording is not None else self._find()[1]
        first_error: RuntimeError | None = None
        for request in requests:
            pipeline, config = rs.pipeline(), rs.config()
            try:
                if self._recording is not None:
                    config.enable_device_from_file(str(self._recording), self._loop)
                elif serial:
                    config.enable_device(serial)
                request.enable(config)
                if self._recording is not None:
                    # before the start, or the first frames run away in real time
                    config.resolve(rs.pipeline_wrapper(pipeline)).get_device().as_playback().set_real_time(False)
                profile = pipeline.start(config)
            except RuntimeError as error:
                if self._recording is None and _says_gone(error):
                    raise SensorMissing(f"The {self._noun} is not there: plug it in, or try another cable.") from error
                first_error = first_error or error
                if self._recording is None and request.last_hope and "resolve" not in str(error):
                    break
                continue
            return self._started(pipeline, profile, request)
        raise self._not_started(first_error) from first_error

    def _started(self, pipeline: Any, profile: Any, request: Request) -> Running[T]:
        try:
            device = profile.get_device()
            about = self._describe(device, profile, request)
            if self._recording is None:
                self.name = info(self._module, device, "name") or self.name
            return Running(pipeline, device, None if self._recording is None else device.as_playback(), about)
        except RuntimeError as error:
            _stop(pipeline)
            raise SensorLost(f"The {self.name} went away while it was starting: {error}.") from error
        except DriverError:
            _stop(pipeline)
            raise

    def _find(self) -> tuple[Any, str | None]:
        """The camera to use and its serial number, None where it states none. Raises SensorMissing."""
        rs = self._module
        try:
            if self._context is None:
                self._context = rs.context()
            devices = list(self._context.query_devices())
        except RuntimeError as error:
            raise SensorMissing(f"The {self._noun}s could not be listed: {error}.") from error
        if not devices:
            raise SensorMissing(f"No {self._noun} is plugged in.")
        serials = [info(rs, device, "serial_number") for device in devices]
        wanted = self._serial
        if wanted is not None and wanted not in serials:
            raise SensorMissing(f"No {self._noun} with serial number {wanted} is plugged in.")
        index = 0 if wanted is None else serials.index(wanted)
        return devices[index], serials[index]

    def _not_started(self, error: RuntimeError | None) -> DriverError:
        if self._recording is not None:
            if not self._recording.is_file():
                return RecordingBroken(f"There is no recording {self._recording.name}.")
            return RecordingBroken(f"The recording {self._recording.name} cannot be played: it is damaged or holds no depth.")
        return SensorLost(f"The {self.name} is there but does not start: {error}.")

    def wait(self, deadline: float, timeout_s: float) -> Any:
        """The next frames before ``deadline``. Raises FrameTimeout, SensorLost, EndOfRecording."""
        running = self.running
        if running is None:
            raise SensorLost(f"The {self.name} is not open.")
        while True:
            remaining = deadline - time.monotonic()
            if remaining <= 0:
                raise FrameTimeout(f"The {self.name} sent no picture for {timeout_s:.3g} s.")
            slice_s = remaining if running.playback is None else min(remaining, PLAYBACK_SLICE_S)
            timeout_ms = max(1, round(slice_s * 1000))
            try:
                if running.playback is not None:
                    return running.pipeline.wait_for_frames(timeout_ms)
                return call_within(
                    slice_s + HANG_SECONDS,
                    partial(running.pipeline.wait_for_frames, timeout_ms),
                    f"The {self.name} hangs: unplug it and plug it in again.",
                )
            except RuntimeError as error:
                if "didn't arrive" not in str(error):
                    raise SensorLost(f"The {self.name} is gone: {error}.") from error
                if running.playback is not None:
                    if running.playback.current_status() == self._module.playback_status.stopped:
                        raise EndOfRecording(f"The recording {self.name} has been played to its end.") from error
                elif not _connected(running.device):
                    raise SensorLost(f"The {self.name} has been unplugged.") from error

    def reset(self) -> None:
        """Reset the hardware where it can be reset. The camera is closed afterwards and away from the bus for some seconds."""
        running = self.running
        self.close()
        if self._recording is not None:
            return

        def reset() -> None:
            device = self._find()[0] if running is None else running.device
            device.hardware_reset()

        try:
            call_within(STOP_SECONDS, reset, f"The {self.name} does not answer to a reset.")
        except (RuntimeError, DriverError) as error:
            log.warning("%s could not be reset: %s", self.name, error)

    def close(self) -> None:
        """Stop and release. Never raises, may be called twice; leaves behind a library call that does not come back."""
        running, self.running = self.running, None
        if running is not None:
            _stop(running.pipeline)


def light(rs: Any, name: str, sensor: Any, asked: Lighting) -> list[str]:
    """Set emitter, laser power and exposure, where the camera has them. Returns what it refused, for the operator."""
    wanted: list[tuple[Any, float, str]] = [(rs.option.emitter_enabled, float(asked.emitter), "its emitter")]
    if asked.laser_power is not None and sensor.supports(rs.option.laser_power):
        most = sensor.get_option_range(rs.option.laser_power).max
        wanted.append((rs.option.laser_power, asked.laser_power * most, "its laser power"))
    if asked.exposure_us is not None:
        wanted.append((rs.option.enable_auto_exposure, 0.0, "its automatic exposure"))
        wanted.append((rs.option.exposure, float(asked.exposure_us), "its exposure"))
    refused = []
    for option, value, what in wanted:
        if not sensor.supports(option):
            log.info("%s has no option for %s", name, what)
            continue
        try:
            sensor.set_option(option, value)
        except RuntimeError as error:
            log.warning("%s: could not set %s to %s: %s", name, what, value, error)
            refused.append(f"{what} could not be set")
    return refused


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


def notice(lacks: list[str]) -> str:
    """What a camera that does less than was asked tells the operator; empty where it lacks nothing."""
    if not lacks:
        return ""
    text = ", ".join(lacks) + ": the camera or its USB link does no more."
    return text[0].upper() + text[1:]


def info(rs: Any, device: Any, what: str) -> str | None:
    """A text the device states of itself, or None."""
    key = getattr(rs.camera_info, what)
    return str(device.get_info(key)) if device.supports(key) else None


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


def _stop(pipeline: Any) -> None:
    try:
        call_within(STOP_SECONDS, pipeline.stop, "The camera does not stop.")
    except (RuntimeError, SensorLost) as error:
        log.warning("a camera was left behind while stopping: %s", error)
