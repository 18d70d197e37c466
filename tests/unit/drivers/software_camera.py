"""pyrealsense2 without a camera: its own ``software_device`` behind its own pipeline, and recordings of it."""

from __future__ import annotations

import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pyrealsense2 as rs

from drivers.depth.base import DepthSettings
from drivers.depth.librealsense import LibrealsenseCamera
from estimators.pinhole import Intrinsics
from tests.unit.drivers.depth_camera_contract import LiveRig

WIDTH, HEIGHT = 848, 480
LENS = Intrinsics(WIDTH, HEIGHT, 421.5, 422.25, 424.5, 238.75, "brown_conrady", (0.1, -0.05, 0.001, 0.002, 0.01))
SERIAL = "000000000001"
NAMED_COLOR = {"blue": (255, 0, 0)}


def rs_intrinsics(lens: Intrinsics) -> Any:
    found = rs.intrinsics()
    found.width, found.height = lens.size
    found.fx, found.fy, found.ppx, found.ppy = lens.fx, lens.fy, lens.ppx, lens.ppy
    found.model = getattr(rs.distortion, lens.model)
    found.coeffs = list(lens.coeffs)
    return found


class SoftwareDevice:
    """A software_device with a depth and a colour sensor, fed by a thread once it streams."""

    def __init__(self, lens: Intrinsics = LENS, color_format: Any = rs.format.bgr8) -> None:
        self.lens = lens
        self.device = rs.software_device()
        self.device.register_info(rs.camera_info.serial_number, SERIAL)
        self.device.register_info(rs.camera_info.name, "Software camera")
        self.depth_sensor = self.device.add_sensor("Stereo Module")
        self.depth_profile = self.depth_sensor.add_video_stream(self._stream(rs.stream.depth, rs.format.z16, 2, 1), True)
        self.depth_sensor.add_read_only_option(rs.option.depth_units, 0.001)
        for option, most, default in (
            (rs.option.emitter_enabled, 2.0, 0.0),
            (rs.option.laser_power, 360.0, 150.0),
            (rs.option.enable_auto_exposure, 1.0, 1.0),
            (rs.option.exposure, 200000.0, 8500.0),
        ):
            allowed = rs.option_range()
            allowed.min, allowed.max, allowed.step, allowed.default = 0.0, most, 1.0, default
            self.depth_sensor.add_option(option, allowed, True)
        self.color_sensor = self.device.add_sensor("RGB Camera")
        self.color_profile = self.color_sensor.add_video_stream(self._stream(rs.stream.color, color_format, 3, 2), True)
        self.number = 0

    def _stream(self, kind: Any, pixel: Any, bytes_each: int, uid: int) -> Any:
        stream = rs.video_stream()
        stream.type, stream.fmt, stream.bpp, stream.uid, stream.index, stream.fps = kind, pixel, bytes_each, uid, 0, 30
        stream.width, stream.height = self.lens.size
        stream.intrinsics = rs_intrinsics(self.lens)
        return stream

    def send(self, color: bool = True) -> None:
        """One depth picture, all pixels its number, and one blue picture of the same number."""
        self.number += 1
        depth = np.full((self.lens.height, self.lens.width), self.number, np.uint16)
        self.depth_sensor.on_video_frame(self._frame(depth, self.depth_profile, 2))
        if color:
            blue = np.zeros((self.lens.height, self.lens.width, 3), np.uint8)
            blue[...] = NAMED_COLOR["blue"]
            self.color_sensor.on_video_frame(self._frame(blue, self.color_profile, 3))

    def _frame(self, pixels: Any, profile: Any, bytes_each: int) -> Any:
        frame = rs.software_video_frame()
        frame.pixels, frame.bpp, frame.stride = pixels, bytes_each, bytes_each * self.lens.width
        frame.timestamp, frame.frame_number = self.number * 1000.0 / 30, self.number
        frame.domain, frame.profile = rs.timestamp_domain.hardware_clock, profile.as_video_stream_profile()
        if bytes_each == 2:
            frame.depth_units = 0.001
        return frame


class _Config(rs.config):
    """pyrealsense2's own config. A software device is set on the pipeline, it cannot be found by its serial number."""

    def enable_device(self, serial: str) -> None:
        assert serial == SERIAL


class _Device:
    """The device of a running pipeline, as it is, but for the cable."""

    def __init__(self, device: Any, module: SoftwareModule) -> None:
        self._device = device
        self._module = module

    def __getattr__(self, name: str) -> Any:
        return getattr(self._device, name)

    def is_connected(self) -> bool:
        return self._module.plugged

    def hardware_reset(self) -> None:
        self._module.resets += 1


class _Profile:
    def __init__(self, profile: Any, module: SoftwareModule) -> None:
        self._profile = profile
        self._module = module

    def get_device(self) -> _Device:
        return _Device(self._profile.get_device(), self._module)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._profile, name)


class _Pipeline:
    """pyrealsense2's own pipeline, with the software device set on it."""

    def __init__(self, module: SoftwareModule) -> None:
        self._module = module
        self._pipeline = rs.pipeline()
        self._pipeline.set_device(module.source.device)

    def start(self, config: Any) -> _Profile:
        if not self._module.plugged:
            raise RuntimeError("No device connected")
        return _Profile(self._pipeline.start(config), self._module)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._pipeline, name)


class SoftwareModule:
    """pyrealsense2 with one software device on its bus."""

    def __init__(self, source: SoftwareDevice | None = None) -> None:
        self.source = source or SoftwareDevice()
        self.plugged = True
        self.resets = 0

    def __getattr__(self, name: str) -> Any:
        return getattr(rs, name)

    def pipeline(self) -> _Pipeline:
        return _Pipeline(self)

    def config(self) -> _Config:
        return _Config()

    def context(self) -> Any:
        return self

    def query_devices(self) -> list[Any]:
        return [_Device(self.source.device, self)] if self.plugged else []


class SoftwareRig(LiveRig):
    """The driver over a software device that sends 60 frames a second."""

    def __init__(self, settings: DepthSettings | None = None, source: SoftwareDevice | None = None) -> None:
        self.module = SoftwareModule(source)
        self.camera = LibrealsenseCamera(self.module, settings or DepthSettings())
        self.intrinsics = self.module.source.lens
        self._sending = threading.Event()
        self._sending.set()
        self._over = threading.Event()
        self._feeder = threading.Thread(target=self._feed, daemon=True)
        self._feeder.start()

    def _feed(self) -> None:
        while not self._over.wait(1 / 60):
            if self._sending.is_set() and self.module.plugged:
                self.module.source.send()

    def fall_silent(self) -> None:
        self._sending.clear()

    def unplug(self) -> None:
        self.module.plugged = False

    def plug_in(self) -> None:
        self.module.plugged = True

    def close(self) -> None:
        self.camera.close()
        self._over.set()
        self._feeder.join(5.0)


def record(path: Path, frames: int, lens: Intrinsics, color_format: Any | None = None) -> None:
    """A .db3 recording of a software device, written by pyrealsense2's own recorder."""
    source = SoftwareDevice(lens, color_format or rs.format.bgr8)
    recorder = rs.recorder(str(path), source.device)
    received = rs.frame_queue(2 * frames + 2)
    sensors = recorder.query_sensors()
    chosen = sensors if color_format is not None else sensors[:1]
    for sensor in chosen:
        sensor.open(sensor.get_stream_profiles())
        sensor.start(received)
    for _ in range(frames):
        source.send(color=color_format is not None)
        time.sleep(0.02)
    for sensor in chosen:
        sensor.stop()
        sensor.close()
