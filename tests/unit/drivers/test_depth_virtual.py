"""The driver over the virtual cameras: the twin passes what real cameras must pass."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from drivers.base import BadFrame, SensorLost
from drivers.depth import session
from drivers.depth.base import DepthSettings
from drivers.depth.librealsense import LibrealsenseCamera
from drivers.registry import open_depth_cameras
from drivers.virtual.cameras import STEREO_SERIAL, TIME_OF_FLIGHT_FPS, TIME_OF_FLIGHT_SERIAL, virtual_bus
from drivers.virtual.demo import Description
from drivers.virtual.depth_camera import STEREO_LENSES, TIME_OF_FLIGHT_LENSES
from drivers.virtual.noise import UNIT_M
from estimators.pinhole import Intrinsics
from tests.unit.drivers.depth_camera_contract import READ_S, LiveCameraContract, LiveRig
from tests.unit.drivers.sensor_contract import TwinPlug

STEREO = DepthSettings(serial=STEREO_SERIAL)
TIME_OF_FLIGHT = DepthSettings(*TIME_OF_FLIGHT_LENSES[0].size, TIME_OF_FLIGHT_FPS, color=False, serial=TIME_OF_FLIGHT_SERIAL)


class VirtualRig(TwinPlug, LiveRig):
    def __init__(self, settings: DepthSettings, lens: Intrinsics) -> None:
        bus = virtual_bus(Description())
        self.twin = next(camera for camera in bus.cameras if camera.serial == settings.serial)
        self.camera = LibrealsenseCamera(bus, settings)
        self.intrinsics = lens

    def close(self) -> None:
        self.twin.faults.end()
        self.camera.close()


@pytest.fixture
def stereo() -> Iterator[VirtualRig]:
    made = VirtualRig(STEREO, STEREO_LENSES[0])
    yield made
    made.close()


class TestVirtualStereo(LiveCameraContract):
    @pytest.fixture(params=STEREO_LENSES, ids=lambda lens: f"{lens.width}x{lens.height}")
    def rig(self, request: pytest.FixtureRequest) -> Iterator[VirtualRig]:
        lens = request.param
        made = VirtualRig(DepthSettings(*lens.size, serial=STEREO_SERIAL), lens)
        made.depth_unit_m = UNIT_M
        yield made
        made.close()


class TestVirtualTimeOfFlight(LiveCameraContract):
    @pytest.fixture
    def rig(self) -> Iterator[VirtualRig]:
        made = VirtualRig(TIME_OF_FLIGHT, TIME_OF_FLIGHT_LENSES[0])
        made.depth_unit_m = UNIT_M
        yield made
        made.close()


def test_colour_comes_beside_depth(stereo: VirtualRig) -> None:
    stereo.camera.open()
    frame = stereo.camera.read(READ_S)
    assert frame.color is not None
    assert frame.color.shape == (480, 848, 3)
    assert stereo.camera.notice == ""


@pytest.mark.parametrize(
    ("fault", "error"), [("wrong size", BadFrame), ("hang", SensorLost)], ids=["half a picture", "the library hangs"]
)
def test_faults_are_exceptions_of_the_driver(
    stereo: VirtualRig, fault: str, error: type[Exception], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(session, "HANG_SECONDS", 0.3)
    stereo.camera.open()
    stereo.camera.read(READ_S)
    stereo.twin.faults.trigger(fault)
    started = time.monotonic()
    with pytest.raises(error) as caught:
        stereo.camera.read(1.0)
    assert str(caught.value).endswith(".")
    assert time.monotonic() - started < 4.0
    stereo.twin.faults.end()
    stereo.camera.close()
    stereo.camera.open()
    assert stereo.camera.read(READ_S).depth.any()


@pytest.mark.parametrize("fault", ["all zero", "partial blackout", "garbage", "freeze"])
def test_pictures_that_are_only_bad_to_look_at_pass_the_driver(stereo: VirtualRig, fault: str) -> None:
    """Whether they are good enough is the survey's to say."""
    stereo.camera.open()
    stereo.twin.faults.trigger(fault)
    frames = [stereo.camera.read(READ_S) for _ in range(3)]
    assert frames[2].number > frames[0].number
    if fault == "all zero":
        assert not frames[2].depth.any()
    if fault == "freeze":
        assert np.array_equal(frames[1].depth, frames[2].depth)


@pytest.mark.parametrize("cameras", [1, 2])
def test_the_registry_gives_as_many_as_are_asked(cameras: int) -> None:
    found: list[Any] = open_depth_cameras("virtual", seed=3, cameras=cameras)
    assert len(found) == cameras
    try:
        for camera in found:
            camera.open()
        sources = {camera.read(READ_S).source for camera in found}
        assert len(sources) == cameras
    finally:
        for camera in found:
            camera.close()
