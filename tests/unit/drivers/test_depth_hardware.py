"""The contract on real cameras: run with ``pytest --hardware`` and the camera on the USB bus."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from drivers.base import SensorMissing
from drivers.depth.base import DepthSettings
from drivers.registry import open_depth_cameras
from tests.unit.drivers.depth_camera_contract import READ_S, DepthCameraContract, Rig

pytestmark = [pytest.mark.hardware, pytest.mark.timeout(180)]


class HardwareRig(Rig):
    """The camera of a kind. What it states of itself at first is what it must go on stating."""

    def __init__(self, kind: str, settings: DepthSettings) -> None:
        try:
            (self.camera,) = open_depth_cameras(kind, settings)
            self.camera.open()
        except SensorMissing as error:
            pytest.skip(str(error))
        frame = self.camera.read(READ_S)
        self.intrinsics, self.depth_unit_m = frame.intrinsics, frame.depth_unit_m
        self.camera.close()

    def close(self) -> None:
        self.camera.close()


class HardwareContract(DepthCameraContract):
    kind: str

    @pytest.fixture(params=[(848, 480), (640, 480)], ids=lambda size: f"{size[0]}x{size[1]}")
    def rig(self, request: pytest.FixtureRequest) -> Iterator[Rig]:
        made = HardwareRig(self.kind, DepthSettings(*request.param))
        yield made
        made.close()

    def test_two_hundred_frames_arrive_in_order(self, rig: Rig) -> None:
        rig.camera.open()
        numbers = [rig.camera.read(READ_S).number for _ in range(200)]
        assert np.all(np.diff(numbers) > 0)
        assert numbers[-1] - numbers[0] < 260, "more than a fifth of the frames were lost"


class TestRealSense(HardwareContract):
    kind = "realsense"


class TestOak(HardwareContract):
    kind = "oak"
