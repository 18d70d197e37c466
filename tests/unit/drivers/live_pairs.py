"""Live stereo cameras that are not there: a software device of librealsense with an infrared pair, an OAK that sends one."""

from __future__ import annotations

import threading
from collections.abc import Callable
from datetime import timedelta
from typing import Any

import depthai as dai
import numpy as np
import pyrealsense2 as rs

from drivers.stereo.base import PairSettings
from drivers.stereo.live import LivePair
from estimators.pinhole import Intrinsics
from tests.unit.drivers.fake_oak import FakeDai, gray_message
from tests.unit.drivers.software_camera import SERIAL, SoftwareModule, rs_intrinsics
from tests.unit.drivers.stereo_camera_contract import LiveRig

SMALL = PairSettings(640, 400, fps=30)
LENS = Intrinsics(640, 400, 373.0, 373.0, 319.5, 199.5)
BASELINE_M = 0.05


def picture(number: int) -> np.ndarray[Any, Any]:
    """One that no other number has, (400, 640) grey."""
    return np.full((LENS.height, LENS.width), 1 + number % 250, np.uint8)


class SoftwarePair:
    """A software_device with infrared 1 and 2. ``lenses`` and ``step`` (m) are what it says of itself."""

    def __init__(
        self, lenses: tuple[Intrinsics, Intrinsics] = (LENS, LENS), step: tuple[float, float, float] = (-BASELINE_M, 0.0, 0.0)
    ) -> None:
        self.device = rs.software_device()
        self.device.register_info(rs.camera_info.serial_number, SERIAL)
        self.device.register_info(rs.camera_info.name, "Software pair")
        self.sensor = self.device.add_sensor("Stereo Module")
        self.profiles = [self.sensor.add_video_stream(_stream(lens, index), True) for index, lens in enumerate(lenses, 1)]
        self.sensor.add_read_only_option(rs.option.depth_units, 0.001)
        allowed = rs.option_range()
        allowed.min, allowed.max, allowed.step, allowed.default = 0.0, 2.0, 1.0, 0.0
        self.sensor.add_option(rs.option.emitter_enabled, allowed, True)
        between = rs.extrinsics()
        between.rotation, between.translation = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0], list(step)
        self.profiles[0].register_extrinsics_to(self.profiles[1], between)
        self.device.create_matcher(rs.matchers.default)
        self.number = 0

    def send(self, sides: tuple[int, ...] = (0, 1)) -> None:
        """One pair, or one side of it."""
        self.number += 1
        for side in sides:
            frame = rs.software_video_frame()
            frame.pixels, frame.bpp, frame.stride = picture(self.number), 1, LENS.width
            frame.timestamp, frame.frame_number = self.number * 1000.0 / 30, self.number
            frame.domain, frame.profile = rs.timestamp_domain.hardware_clock, self.profiles[side].as_video_stream_profile()
            self.sensor.on_video_frame(frame)


def _stream(lens: Intrinsics, index: int) -> Any:
    stream = rs.video_stream()
    stream.type, stream.fmt, stream.bpp, stream.uid, stream.index, stream.fps = (
        rs.stream.infrared,
        rs.format.y8,
        1,
        index,
        index,
        30,
    )
    stream.width, stream.height = lens.size
    stream.intrinsics = rs_intrinsics(lens)
    return stream


class Fed(LiveRig):
    """A camera that a thread sends 30 pairs a second into."""

    def __init__(self) -> None:
        self._sending = threading.Event()
        self._sending.set()
        self._over = threading.Event()
        self._feeder = threading.Thread(target=self._feed, daemon=True)
        self._feeder.start()

    def _feed(self) -> None:
        while not self._over.wait(1 / 30):
            if self._sending.is_set():
                self.send()

    def send(self) -> None:
        """One pair on its way."""
        raise NotImplementedError

    def fall_silent(self) -> None:
        self._sending.clear()

    def close(self) -> None:
        self.camera.close()
        self._over.set()
        self._feeder.join(5.0)


class RealSenseRig(Fed):
    """The driver over a software device."""

    def __init__(self, settings: PairSettings = SMALL, source: SoftwarePair | None = None) -> None:
        self.source = source or SoftwarePair()
        self.module = SoftwareModule(self.source)  # type: ignore[arg-type]
        self.camera = LivePair(self.module, settings)
        self.intrinsics, self.baseline_m = LENS, BASELINE_M
        super().__init__()

    def send(self) -> None:
        if self.module.plugged:
            self.source.send()

    def unplug(self) -> None:
        self.module.plugged = False

    def plug_in(self) -> None:
        self.module.plugged = True


OAK_LENS = [[400.0, 0.0, 320.0], [0.0, 400.0, 200.0], [0.0, 0.0, 1.0]]


class OakPairRig(Fed):
    """The driver over depthai_rs over a device that is not there. ``skip`` says which numbers of
    which port are lost on their way."""

    def __init__(self, settings: PairSettings = SMALL) -> None:
        self.bus = FakeDai()
        self.camera = LivePair(self.bus.surface(), settings)
        self.intrinsics = Intrinsics(640, 400, 400.0, 400.0, 320.0, 200.0)
        self.baseline_m = 0.075
        self.number = 0
        self.skip: Callable[[int, str], bool] = lambda number, port: False
        super().__init__()

    def send(self) -> None:
        pipeline = None if self.bus.device is None else self.bus.device.pipeline
        if pipeline is None or not pipeline.running:
            return
        self.number += 1
        for (_, port), queue in list(pipeline.queues.items()):
            if self.skip(self.number, port):
                continue
            message = gray_message(picture(self.number), self.number)
            message.setTimestampDevice(timedelta(milliseconds=1000 + self.number * 1000 / 30))
            message.setTransformation(dai.ImgTransformation(LENS.width, LENS.height, OAK_LENS))
            try:
                queue.send(message)
            except dai.MessageQueue.QueueException:
                return  # closed by the test under way

    def unplug(self) -> None:
        self.bus.plugged = False
        if self.bus.device is not None:
            self.bus.device.close()

    def plug_in(self) -> None:
        self.bus.plugged = True
