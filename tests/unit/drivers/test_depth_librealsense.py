"""The depth camera driver over pyrealsense2's own software device."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("pyrealsense2", reason="pyrealsense2 is not installed")

import pyrealsense2 as rs

from drivers.base import BadFrame, FrameTimeout, SensorLost, SensorMissing
from drivers.depth import session
from drivers.depth.base import DepthSettings
from drivers.depth.librealsense import LibrealsenseCamera
from drivers.depth.session import intrinsics_of
from tests.unit.drivers.depth_camera_contract import READ_S, LiveCameraContract
from tests.unit.drivers.software_camera import SERIAL, SoftwareModule, SoftwareRig


@pytest.fixture
def rig() -> Iterator[SoftwareRig]:
    made = SoftwareRig()
    yield made
    made.close()


class TestSoftwareDevice(LiveCameraContract):
    @pytest.fixture
    def rig(self) -> Iterator[SoftwareRig]:
        made = SoftwareRig()
        yield made
        made.close()


def test_colour_comes_beside_depth(rig: SoftwareRig) -> None:
    rig.camera.open()
    frame = rig.camera.read(READ_S)
    while frame.color is None:  # the first set may hold depth alone
        frame = rig.camera.read(READ_S)
    assert frame.color.shape == (480, 848, 3)
    assert frame.color[0, 0].tolist() == [255, 0, 0]
    assert rig.camera.notice == ""


def test_options_are_set_where_the_camera_has_them() -> None:
    rig = SoftwareRig(DepthSettings(emitter=True, exposure_us=4000, laser_power=0.5))
    try:
        rig.camera.open()
        sensor = rig.module.source.depth_sensor
        assert sensor.get_option(rs.option.emitter_enabled) == 1
        assert sensor.get_option(rs.option.laser_power) == 180
        assert sensor.get_option(rs.option.enable_auto_exposure) == 0
        assert sensor.get_option(rs.option.exposure) == 4000
    finally:
        rig.close()


def test_the_serial_number_picks_the_camera(rig: SoftwareRig) -> None:
    LibrealsenseCamera(rig.module, DepthSettings(serial=SERIAL)).open()
    with pytest.raises(SensorMissing, match="12345"):
        LibrealsenseCamera(rig.module, DepthSettings(serial="12345")).open()


def test_a_reset_reaches_the_hardware(rig: SoftwareRig) -> None:
    rig.camera.open()
    rig.camera.reset()
    assert rig.module.resets == 1
    rig.camera.reset()
    assert rig.module.resets == 2, "the ladder closes a camera before it resets it"
    rig.unplug()
    rig.camera.reset()


def test_pyrealsense2_without_a_camera_is_a_missing_camera() -> None:
    if len(rs.context().query_devices()):
        pytest.skip("a RealSense camera is plugged in")
    started = time.monotonic()
    with pytest.raises(SensorMissing, match="No depth camera is plugged in"):
        LibrealsenseCamera(rs, DepthSettings()).open()
    assert time.monotonic() - started < 5.0


class _Narrow(SoftwareModule):
    """A link that carries only what ``carries`` allows, as pyrealsense2 says it of USB 2."""

    def __init__(self, carries: Any) -> None:
        super().__init__()
        self.carries = carries
        self.asked: list[tuple[Any, ...]] = []

    def config(self) -> Any:
        real = super().config()
        module = self
        streams: list[tuple[Any, ...]] = []

        class Config:
            def enable_device(self, serial: str) -> None:
                real.enable_device(serial)

            def enable_stream(self, *stream: Any) -> None:
                streams.append(stream)

            def start(self, pipeline: Any) -> Any:
                module.asked.append(tuple(streams))
                if not module.carries(streams):
                    raise RuntimeError("Couldn't resolve requests")
                real.enable_stream(rs.stream.depth)
                return pipeline.start(real)

        return Config()

    def pipeline(self) -> Any:
        real = super().pipeline()
        return SimpleNamespace(start=lambda config: config.start(real), stop=real.stop, wait_for_frames=real.wait_for_frames)


def test_without_room_for_colour_depth_comes_alone_and_the_operator_is_told() -> None:
    module = _Narrow(lambda streams: len(streams) == 1)
    camera = LibrealsenseCamera(module, DepthSettings())
    camera.open()
    try:
        module.source.send(color=False)
        assert camera.read(READ_S).color is None
        assert "no colour picture" in camera.notice
        assert camera.notice.endswith(".")
        assert module.asked[-1] == ((rs.stream.depth, 848, 480, rs.format.z16, 30),)
    finally:
        camera.close()


def test_a_slow_link_gets_fewer_frames() -> None:
    module = _Narrow(lambda streams: len(streams) == 1 and streams[0][-1] <= 15)
    camera = LibrealsenseCamera(module, DepthSettings())
    camera.open()
    camera.close()
    assert "15 frames a second" in camera.notice
    assert module.asked[-1][0][1:3] == (848, 480)


def test_a_camera_that_starts_nothing_is_lost_with_its_own_words() -> None:
    camera = LibrealsenseCamera(_Narrow(lambda _: False), DepthSettings())
    with pytest.raises(SensorLost, match="Couldn't resolve requests"):
        camera.open()


class _Answers:
    """A camera whose every answer is a function: for what real ones do only when they are broken."""

    def __init__(self, **answers: Any) -> None:
        device = SimpleNamespace(
            supports=lambda _: False,
            first_depth_sensor=lambda: SimpleNamespace(get_depth_scale=lambda: 0.001, supports=lambda _: False),
            is_connected=lambda: True,
            hardware_reset=answers.get("reset", lambda: None),
        )
        profile = SimpleNamespace(get_device=lambda: device)
        self._pipeline = SimpleNamespace(
            start=lambda config: answers.get("start", lambda: profile)() or profile,
            stop=answers.get("stop", lambda: None),
            wait_for_frames=answers.get("wait", lambda ms: None),
        )
        self._devices = answers.get("devices", lambda: [device])

    def __getattr__(self, name: str) -> Any:
        return getattr(rs, name)

    def pipeline(self) -> Any:
        return self._pipeline

    def config(self) -> Any:
        return SimpleNamespace(enable_stream=lambda *_: None, enable_device=lambda _: None)

    def context(self) -> Any:
        return SimpleNamespace(query_devices=self._devices)


def _frames(depth: Any, number: int = 1, lens: Any = None) -> Any:
    intrinsics = lens or SimpleNamespace(width=4, height=3, fx=2.0, fy=2.0, ppx=2.0, ppy=1.5, model="none", coeffs=[0.0] * 5)
    profile = SimpleNamespace(as_video_stream_profile=lambda: SimpleNamespace(get_intrinsics=lambda: intrinsics))
    frame = SimpleNamespace(get_data=lambda: depth, get_frame_number=lambda: number, profile=profile)
    return SimpleNamespace(get_depth_frame=lambda: frame, get_color_frame=lambda: None)


def _opened(**answers: Any) -> LibrealsenseCamera:
    camera = LibrealsenseCamera(_Answers(**answers), DepthSettings())
    camera.open()
    return camera


@pytest.mark.parametrize(
    "frames",
    [
        _frames(np.zeros((2, 4), np.uint16)),
        _frames(np.zeros((3, 4), np.uint8)),
        _frames(np.zeros(5, np.uint16)),
        SimpleNamespace(get_depth_frame=lambda: None),
    ],
    ids=["short", "8 bits", "no picture at all", "no depth"],
)
def test_what_is_no_depth_picture_is_refused(frames: Any) -> None:
    with pytest.raises(BadFrame):
        _opened(wait=lambda ms: frames).read(1.0)


def test_the_same_picture_again_is_no_new_frame() -> None:
    camera = _opened(wait=lambda ms: _frames(np.ones((3, 4), np.uint16)))
    camera.read(1.0)
    started = time.monotonic()
    with pytest.raises(FrameTimeout):
        camera.read(0.2)
    assert time.monotonic() - started < 1.0


def test_an_unknown_fault_while_reading_is_a_lost_camera() -> None:
    def broken(ms: int) -> Any:
        raise RuntimeError("Device disconnected. Failed to recconect: 5000")

    with pytest.raises(SensorLost, match="Device disconnected"):
        _opened(wait=broken).read(1.0)


def test_a_library_call_that_hangs_does_not_hang_the_driver(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(session, "START_SECONDS", 0.2)
    monkeypatch.setattr(session, "STOP_SECONDS", 0.2)
    release, stopped = threading.Event(), threading.Event()

    def hang() -> None:
        release.wait(10.0)

    camera = LibrealsenseCamera(_Answers(start=hang, stop=stopped.set), DepthSettings())
    started = time.monotonic()
    with pytest.raises(SensorLost, match="does not start"):
        camera.open()
    assert time.monotonic() - started < 2.0
    release.set()
    assert stopped.wait(5.0), "a pipeline that starts too late must be stopped, or it keeps the camera"

    release.clear()
    monkeypatch.setattr(session, "HANG_SECONDS", 0.2)
    camera = _opened(wait=lambda ms: hang())
    started = time.monotonic()
    with pytest.raises(SensorLost, match="hangs"):
        camera.read(0.1)
    assert time.monotonic() - started < 2.0
    release.set()

    release.clear()
    camera = _opened(stop=hang)
    started = time.monotonic()
    camera.close()
    assert time.monotonic() - started < 2.0
    release.set()


def test_a_failing_reset_is_no_fault_of_the_driver() -> None:
    def broken() -> None:
        raise RuntimeError("hardware_reset failed")

    camera = _opened(reset=broken)
    camera.reset()
    with pytest.raises(SensorLost, match="not open"):
        camera.read(0.1)


def test_a_bus_that_cannot_be_listed_is_a_missing_camera() -> None:
    def broken() -> Any:
        raise RuntimeError("failed to open usb interface")

    with pytest.raises(SensorMissing, match="failed to open usb interface"):
        _opened(devices=broken)


@pytest.mark.parametrize("model", ["none", "brown_conrady", "inverse_brown_conrady", "modified_brown_conrady"])
def test_lens_models_are_taken_over(model: str) -> None:
    found = rs.intrinsics()
    found.width, found.height, found.fx, found.fy, found.ppx, found.ppy = 640, 480, 380.0, 381.0, 320.5, 239.5
    found.model = getattr(rs.distortion, model)
    found.coeffs = [0.1, 0.2, 0.003, 0.004, 0.5]
    taken = intrinsics_of(found)
    assert taken.model == model
    assert taken.coeffs == pytest.approx((0.1, 0.2, 0.003, 0.004, 0.5))
    found.coeffs = [0.0] * 5
    assert intrinsics_of(found).model == "none"


def test_a_lens_nobody_can_compute_with_is_refused() -> None:
    found = rs.intrinsics()
    found.width, found.height, found.fx, found.fy = 640, 480, 380.0, 380.0
    found.model = rs.distortion.kannala_brandt4
    found.coeffs = [0.1, 0.2, 0.003, 0.004, 0.0]
    with pytest.raises(BadFrame, match="kannala_brandt4"):
        intrinsics_of(found)
    found.model, found.fx = rs.distortion.none, 0.0
    found.coeffs = [0.0] * 5
    with pytest.raises(BadFrame, match="focal"):
        intrinsics_of(found)
