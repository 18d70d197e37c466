"""What every stereo camera must do, subclassed once for each driver. What passes on a twin is what the real one must pass."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from drivers.stereo.base import StereoCamera, StereoFrame
from estimators.pinhole import Intrinsics
from tests.unit.drivers.sensor_contract import READ_S, LiveSensorContract, Plug, SensorContract, SensorRig


class Rig(SensorRig):
    """A camera, what is known of it, and the hand that plugs and unplugs it."""

    camera: StereoCamera
    intrinsics: Intrinsics
    baseline_m: float
    offset_px: float | None = 0.0

    @property
    def sensor(self) -> StereoCamera:
        return self.camera


class LiveRig(Rig, Plug):
    """A camera that may fall silent, go away and come back."""


class StereoCameraContract(SensorContract):
    """Subclass with a fixture ``rig`` that gives a Rig, its camera not yet open, and closes it afterwards."""

    reads = StereoFrame
    silence = "no (pair|picture)"

    def pictures(self, reading: StereoFrame) -> list[NDArray[Any]]:
        return [reading.left, reading.right]

    def test_pairs_are_of_the_stated_size_and_rig(self, rig: Rig) -> None:
        rig.camera.open()
        frame = rig.camera.read(READ_S)
        for picture in (frame.left, frame.right):
            assert picture.dtype == np.uint8
            assert picture.shape[:2] == (rig.intrinsics.height, rig.intrinsics.width)
            assert picture.any()
        found = frame.intrinsics
        assert found.size == rig.intrinsics.size
        assert not any(found.coeffs), "a rectified pair has no distortion left"
        expected = [rig.intrinsics.fx, rig.intrinsics.fy, rig.intrinsics.ppx, rig.intrinsics.ppy]
        assert [found.fx, found.fy, found.ppx, found.ppy] == pytest.approx(expected, abs=1e-3)
        assert frame.baseline_m == pytest.approx(rig.baseline_m, rel=1e-4)
        assert frame.offset_px == pytest.approx(rig.offset_px, abs=1e-3)


class LiveStereoContract(StereoCameraContract, LiveSensorContract):
    """Also for cameras: ``rig`` is a LiveRig."""
