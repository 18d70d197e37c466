"""What every depth camera must do, subclassed once for each driver. What passes on a twin is what the real one must pass."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from drivers.base import EndOfRecording
from drivers.depth.base import DepthCamera, DepthFrame
from estimators.pinhole import Intrinsics
from tests.unit.drivers.sensor_contract import READ_S, LiveSensorContract, Plug, SensorContract, SensorRig


class Rig(SensorRig):
    """A camera and the hand that plugs and unplugs it."""

    camera: DepthCamera
    intrinsics: Intrinsics
    depth_unit_m: float = 0.001

    @property
    def sensor(self) -> DepthCamera:
        return self.camera


class LiveRig(Rig, Plug):
    """A camera that may fall silent, go away and come back."""


class DepthCameraContract(SensorContract):
    """Subclass with a fixture ``rig`` that gives a Rig, its camera not yet open, and closes it afterwards."""

    reads = DepthFrame

    def pictures(self, reading: DepthFrame) -> list[NDArray[Any]]:
        return [reading.depth]

    def test_frames_are_of_the_stated_size_and_unit(self, rig: Rig) -> None:
        rig.camera.open()
        frame = rig.camera.read(READ_S)
        assert frame.depth.dtype == np.uint16
        assert frame.depth.shape == (rig.intrinsics.height, rig.intrinsics.width)
        assert frame.depth.flags.writeable
        assert frame.depth_unit_m == rig.depth_unit_m
        assert frame.depth.any()

    def test_intrinsics_are_those_of_the_lens(self, rig: Rig) -> None:
        rig.camera.open()
        found = rig.camera.read(READ_S).intrinsics
        assert found.size == rig.intrinsics.size
        assert found.model == rig.intrinsics.model
        expected = [rig.intrinsics.fx, rig.intrinsics.fy, rig.intrinsics.ppx, rig.intrinsics.ppy, *rig.intrinsics.coeffs]
        assert [found.fx, found.fy, found.ppx, found.ppy, *found.coeffs] == pytest.approx(expected, abs=1e-4)


class LiveCameraContract(DepthCameraContract, LiveSensorContract):
    """Also for cameras: ``rig`` is a LiveRig."""


class RecordingContract(DepthCameraContract):
    """Also for recordings: ``rig`` plays one in a loop, ``once`` is a camera that plays the same one once."""

    frames_in_recording: int

    def test_plays_every_frame_once_and_then_ends(self, once: DepthCamera) -> None:
        once.open()
        numbers = [once.read(READ_S).number for _ in range(self.frames_in_recording)]
        assert numbers == list(range(1, self.frames_in_recording + 1))
        started = time.monotonic()
        with pytest.raises(EndOfRecording):
            once.read(READ_S)
        assert time.monotonic() - started < READ_S / 2
        with pytest.raises(EndOfRecording):
            once.read(READ_S)

    def test_loops_and_goes_on_counting(self, rig: Rig) -> None:
        rig.camera.open()
        rounds = [[rig.camera.read(READ_S) for _ in range(self.frames_in_recording)] for _ in range(2)]
        assert [frame.number for frame in rounds[1]] == [frame.number + self.frames_in_recording for frame in rounds[0]]
        assert all(np.array_equal(a.depth, b.depth) for a, b in zip(*rounds, strict=True))
