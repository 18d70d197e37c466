"""The stereo contract on real cameras: run with ``pytest --hardware`` and the camera on the USB bus."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from drivers.base import SensorMissing
from drivers.registry import open_stereo_camera
from tests.unit.drivers.stereo_camera_contract import READ_S, Rig, StereoCameraContract

pytestmark = [pytest.mark.hardware, pytest.mark.timeout(180)]


class HardwareRig(Rig):
    """The camera of a kind. What it states of itself at first is what it must go on stating."""

    def __init__(self, kind: str) -> None:
        try:
            self.camera = open_stereo_camera(kind)
            self.camera.open()
        except SensorMissing as error:
            pytest.skip(str(error))
        frame = self.camera.read(READ_S)
        self.intrinsics, self.baseline_m, self.offset_px = frame.intrinsics, frame.baseline_m, frame.offset_px
        self.camera.close()

    def close(self) -> None:
        self.camera.close()


class HardwareContract(StereoCameraContract):
    kind: str

    @pytest.fixture
    def rig(self) -> Iterator[Rig]:
        made = HardwareRig(self.kind)
        yield made
        made.close()

    def test_the_pair_is_one_of_a_camera_that_is_made(self, rig: Rig) -> None:
        """Baselines of the makers' cameras lie between 18 mm (D405) and 150 mm (OAK-D LR)."""
        assert 0.015 < rig.baseline_m < 0.16
        assert rig.offset_px is not None
        assert abs(rig.offset_px) < 2.0


class TestRealSense(HardwareContract):
    kind = "realsense"


class TestOak(HardwareContract):
    kind = "oak"
