"""Virtual depth cameras behind the pyrealsense2 surface.

``VirtualBus`` stands in for the module ``pyrealsense2``: ``drivers.depth.librealsense`` drives the cameras plugged into it as
it drives real ones. A picture is rendered when it is waited for; times and numbers run on as a camera's that does not wait.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from drivers.depth.depthai_rs.alignment import align
from drivers.depth.depthai_rs.configs import StreamRequest, config, pipeline_wrapper
from drivers.depth.depthai_rs.devices import option_range
from drivers.depth.depthai_rs.frames import composite_frame, frame, stream_profile
from drivers.depth.depthai_rs.lens import extrinsics, intrinsics
from drivers.depth.depthai_rs.names import camera_info, distortion, format, option, stream
from drivers.depth.depthai_rs.profile import pipeline_profile
from drivers.virtual.color import Painter
from drivers.virtual.demo import DemoRig
from drivers.virtual.faults import FaultScript
from drivers.virtual.noise import UNIT_M, StereoCamera, TimeOfFlightCamera, coarse_rays
from drivers.virtual.rig import Pose
from drivers.virtual.world import Hits, VirtualSewer
from estimators.pinhole import Intrinsics

GRID = 2
"""Rays are cast for every second pixel of every second row."""
COLOR_GRID = 4
"""Colour is painted for every fourth pixel and enlarged. A multiple of GRID."""
COLOR_FPS = 10
"""The operator's eye needs no more; between two colour pictures the last one is sent again, as pyrealsense2 does."""
RESET_SECONDS = 0.5
"""For how long a camera is off the bus after a reset."""
_LATE_S, _LATE_EACH = 1.5, 10
_SLOW_FPS = 2
_HANG_CHECK_S = 0.02

STEREO_LENSES = (
    Intrinsics(848, 480, 421.139, 421.139, 426.176, 237.017),
    Intrinsics(640, 480, 381.41, 381.41, 321.97, 237.26),
)
"""Those of the shared recordings."""
TIME_OF_FLIGHT_LENSES = (Intrinsics(224, 172, 186.4, 186.4, 111.6, 85.8),)
"""62 degrees wide, as small time-of-flight cameras are."""

_RANGES = {
    option.emitter_enabled: option_range(0.0, 2.0, 1.0, 1.0),
    option.laser_power: option_range(0.0, 360.0, 30.0, 150.0),
    option.enable_auto_exposure: option_range(0.0, 1.0, 1.0, 1.0),
    option.exposure: option_range(1.0, 165000.0, 1.0, 8500.0),
}

Imager = StereoCamera | TimeOfFlightCamera


@dataclass
class VirtualCamera:
    """One camera as a piece of hardware: it is there whether it is open or not, and remembers its faults.

    ``imager`` makes the sensor for a lens; ``painter`` the colour picture, None for a camera without colour; ``most_fps`` is
    the highest rate it sends, ``line`` its product line.
    """

    name: str
    serial: str
    sewer: VirtualSewer
    rig: DemoRig
    imager: Callable[[Intrinsics], Imager]
    lenses: tuple[Intrinsics, ...]
    painter: Painter | None = None
    most_fps: int = 30
    line: str = "virtual stereo"
    faults: FaultScript = field(default_factory=FaultScript)
    options: dict[option, float] = field(
        default_factory=lambda: {wanted: allowed.default for wanted, allowed in _RANGES.items()}
    )
    resets: int = 0
    _back_at: float = 0.0

    def plugged_in(self) -> bool:
        """Whether the cable is in."""
        return "disconnect" not in self.faults.active()

    def reset(self) -> None:
        """As unplugging and plugging in again."""
        self.resets += 1
        self.faults.was_reset()
        self._back_at = time.monotonic() + RESET_SECONDS

    def wait_for_reset(self) -> None:
        """Until it is back on the bus."""
        time.sleep(max(0.0, self._back_at - time.monotonic()))


class VirtualBus:
    """The module: what ``import pyrealsense2 as rs`` gives, for the cameras of one bus."""

    align, camera_info, config, distortion, extrinsics = align, camera_info, config, distortion, extrinsics
    format, frame, composite_frame, intrinsics, option = format, frame, composite_frame, intrinsics, option
    pipeline_wrapper, stream, stream_profile = pipeline_wrapper, stream, stream_profile

    def __init__(self, cameras: Sequence[VirtualCamera]) -> None:
        self.cameras = tuple(cameras)

    def context(self) -> Context:
        return Context(self)

    def pipeline(self, ctx: Context | None = None) -> Pipeline:
        return Pipeline(self)

    def found(self) -> list[VirtualCamera]:
        """The cameras that are plugged in; waits for those that come back from a reset."""
        for camera in self.cameras:
            camera.wait_for_reset()
        return [camera for camera in self.cameras if camera.plugged_in()]


class Context:
    """The bus, asked for its devices."""

    def __init__(self, bus: VirtualBus) -> None:
        self._bus = bus

    def query_devices(self) -> list[Device]:
        return [Device(camera) for camera in self._bus.found()]

    @property
    def devices(self) -> list[Device]:
        return self.query_devices()


class Device:
    """A camera while it stays plugged in."""

    def __init__(self, camera: VirtualCamera) -> None:
        self.camera = camera
        self._unplugged = camera.faults.times_unplugged()
        self._resets = camera.resets

    def supports(self, what: camera_info) -> bool:
        return what in (camera_info.name, camera_info.serial_number, camera_info.product_line)

    def get_info(self, what: camera_info) -> str:
        if not self.supports(what):
            raise RuntimeError(f"{what.name} is not supported by the device")
        if what is camera_info.product_line:
            return self.camera.line
        return self.camera.name if what is camera_info.name else self.camera.serial

    def is_connected(self) -> bool:
        same = self.camera.faults.times_unplugged() == self._unplugged and self.camera.resets == self._resets
        return same and self.camera.plugged_in()

    def first_depth_sensor(self) -> Sensor:
        return Sensor(self)

    def query_sensors(self) -> list[Sensor]:
        return [Sensor(self)]

    def hardware_reset(self) -> None:
        if not self.camera.plugged_in():
            raise RuntimeError("Device disconnected")
        self.camera.reset()


class Sensor:
    """The depth sensor of a device, with its unit and options."""

    def __init__(self, owner: Device) -> None:
        self._owner = owner

    def is_depth_sensor(self) -> bool:
        return True

    def get_depth_scale(self) -> float:
        return UNIT_M

    def supports(self, wanted: option) -> bool:
        return wanted in _RANGES

    def get_option_range(self, wanted: option) -> option_range:
        if wanted not in _RANGES:
            raise RuntimeError(f"object doesn't support option {wanted.name}")
        return _RANGES[wanted]

    def get_option(self, wanted: option) -> float:
        self.get_option_range(wanted)
        return self._owner.camera.options[wanted]

    def set_option(self, wanted: option, value: float) -> None:
        allowed = self.get_option_range(wanted)
        if not allowed.min <= value <= allowed.max:
            raise RuntimeError(f"out of range value for argument {wanted.name}: {value}")
        if not self._owner.is_connected():
            raise RuntimeError("Device disconnected")
        self._owner.camera.options[wanted] = float(value)


class Pipeline:
    """The streams of one camera."""

    def __init__(self, bus: VirtualBus) -> None:
        self._bus = bus
        self._running: _Running | None = None

    def start(self, wanted: config | None = None) -> pipeline_profile[Device]:
        """Raises RuntimeError: "No device connected", "Couldn't resolve requests"."""
        if self._running is not None:
            raise RuntimeError("start() cannot be called before stop()")
        profile = self.resolve(wanted or config())
        camera = profile.get_device().camera
        camera.rig.begin()
        camera.faults.begin()
        camera.faults.restarted()
        self._running = _Running(profile)
        return profile

    def resolve(self, wanted: config) -> pipeline_profile[Device]:
        """What ``start`` would run."""
        for camera in self._bus.found():
            if wanted.serial in (None, camera.serial):
                return _resolved(camera, wanted)
        raise RuntimeError("No device connected")

    def get_active_profile(self) -> pipeline_profile[Device]:
        return self._started("get_active_profile").profile

    def wait_for_frames(self, timeout_ms: int = 5000) -> composite_frame:
        """Raises RuntimeError "Frame didn't arrive within ..."; an unplugged camera is silent, as a real one."""
        found = self._started("wait_for_frames").next(timeout_ms / 1000)
        if found is None:
            raise RuntimeError(f"Frame didn't arrive within {timeout_ms}")
        return found

    def try_wait_for_frames(self, timeout_ms: int = 5000) -> tuple[bool, composite_frame]:
        found = self._started("try_wait_for_frames").next(timeout_ms / 1000)
        return found is not None, found or composite_frame([])

    def poll_for_frames(self) -> composite_frame:
        return self._started("poll_for_frames").next(0.0) or composite_frame([])

    def stop(self) -> None:
        running = self._started("stop")
        self._running = None
        running.stop()

    def _started(self, call: str) -> _Running:
        if self._running is None:
            raise RuntimeError(f"{call} cannot be called before start()")
        return self._running


def _resolved(camera: VirtualCamera, wanted: config) -> pipeline_profile[Device]:
    requests = list(wanted.requests.values()) or [StreamRequest(stream.depth), StreamRequest(stream.color)]
    profiles = [
        _profile(camera, request) for request in requests if camera.painter or request.kind is stream.depth or wanted.requests
    ]
    if len({(profile.width(), profile.height()) for profile in profiles}) != 1:
        raise RuntimeError("Couldn't resolve requests")
    return pipeline_profile(Device(camera), profiles)


def _profile(camera: VirtualCamera, request: StreamRequest) -> stream_profile:
    size, fps = (request.width, request.height), request.fps or camera.most_fps
    lens = next((one for one in camera.lenses if size in ((0, 0), one.size)), None)
    formats = {stream.depth: (format.z16,), stream.color: (format.bgr8, format.rgb8) if camera.painter else ()}
    allowed = formats.get(request.kind, ())
    if lens is None or not allowed or fps > camera.most_fps or request.pixels not in (format.any, *allowed):
        raise RuntimeError("Couldn't resolve requests")
    seen = intrinsics(lens.width, lens.height, lens.fx, lens.fy, lens.ppx, lens.ppy)
    pixels = allowed[0] if request.pixels is format.any else request.pixels
    return stream_profile(request.kind, 0, pixels, lens.size, fps, lambda: seen, True, lambda other: _SAME_PLACE)


_SAME_PLACE = extrinsics([1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0], [0.0, 0.0, 0.0])


class _Running:
    """Started streams. One thread waits for frames, any other may stop them."""

    def __init__(self, profile: pipeline_profile[Device]) -> None:
        self.profile = profile
        self._owner = profile.get_device()
        self._camera = self._owner.camera
        self._streams = {one.stream_type(): one for one in profile.get_streams()}
        first = profile.get_streams()[0]
        self._lens = next(lens for lens in self._camera.lenses if lens.size == (first.width(), first.height()))
        self._period_s = 1.0 / first.fps()
        self._imager = self._camera.imager(self._lens)
        self._grid = coarse_rays(self._lens, GRID)
        self._began = time.monotonic()
        self._last = 0
        self._held: tuple[int, float] | None = None
        self._color: frame | None = None
        self._color_due = 0.0
        self._frozen: NDArray[np.uint16] | None = None
        self._garbage = np.random.default_rng(0)
        self._stopped = threading.Event()

    def stop(self) -> None:
        self._stopped.set()

    def next(self, timeout_s: float) -> composite_frame | None:
        """The next set, or None when none came in time."""
        deadline = time.monotonic() + timeout_s
        while "hang" in self._camera.faults.active():
            time.sleep(_HANG_CHECK_S)
        number, ready = self._due()
        while True:
            wait_s = min(ready, deadline) - time.monotonic()
            if wait_s > 0 and self._stopped.wait(wait_s):
                raise RuntimeError("Device disconnected")
            silent = "never comes" in self._camera.faults.active() or not self._owner.is_connected()
            if not silent and time.monotonic() >= ready:
                self._last, self._held = number, None
                return self._set(number)
            if time.monotonic() >= deadline:
                return None
            if silent:
                ready = time.monotonic() + self._period_s

    def _due(self) -> tuple[int, float]:
        """(number, time) of the next picture: a reader who comes late has missed those before the latest, one that is late
        itself is waited for."""
        if self._held is not None:
            return self._held
        faults = self._camera.faults.active()
        period_s = max(self._period_s, 1 / _SLOW_FPS if "slow" in faults else 0.0)
        number = max(self._last + max(1, round(period_s / self._period_s)), self._at(time.monotonic()))
        ready = self._began + number * self._period_s
        if "late" in faults and number % _LATE_EACH == 0:
            self._held = (number, ready + _LATE_S)
        return self._held or (number, ready)

    def _at(self, moment: float) -> int:
        return math.floor((moment - self._began) / self._period_s)

    def _set(self, number: int) -> composite_frame:
        faults = self._camera.faults.active()
        pose = self._camera.rig.pose()
        hits = self._camera.sewer.cast(pose.position, pose.rotation, self._grid)
        stamp_ms = 1000 * (self._began + number * self._period_s)
        found = []
        if stream.depth in self._streams:
            depth = self._faulty(self._imager.picture(hits), faults)
            found.append(frame(depth, self._streams[stream.depth], number, stamp_ms))
        painter = self._camera.painter
        if stream.color in self._streams and painter is not None:
            if stamp_ms >= self._color_due or self._color is None:
                self._color_due = stamp_ms + 1000 / COLOR_FPS - 1
                self._color = self._painted(painter, hits, pose, number, stamp_ms)
            found.append(self._color)
        return composite_frame(found)

    def _painted(self, painter: Painter, hits: Hits, pose: Pose, number: int, stamp_ms: float) -> frame:
        profile = self._streams[stream.color]
        step = COLOR_GRID // GRID
        seen = Hits(hits.depth[::step, ::step], hits.cosine[::step, ::step], hits.material[::step, ::step])
        picture = painter.picture(seen, pose, self._grid[::step, ::step], self._lens.size)
        if profile.format() is format.rgb8:
            picture = np.ascontiguousarray(picture[..., ::-1])
        return frame(picture, profile, number, stamp_ms)

    def _faulty(self, depth: NDArray[np.uint16], faults: frozenset[str]) -> NDArray[np.uint16]:
        """The picture as the faults leave it."""
        if "freeze" in faults:
            self._frozen = depth if self._frozen is None else self._frozen
            depth = self._frozen.copy()
        else:
            self._frozen = None
        if "garbage" in faults:
            depth = self._garbage.integers(0, 65536, depth.shape, np.uint16)
        if "partial blackout" in faults:
            depth[:, : 2 * depth.shape[1] // 3] = 0
        if "all zero" in faults:
            depth[:] = 0
        if "wrong size" in faults:
            depth = depth[: depth.shape[0] // 2]
        return depth
