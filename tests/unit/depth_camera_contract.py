"""What every depth camera must do, subclassed once for each driver. What passes on a twin is what the real one must pass."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from itertools import pairwise

import numpy as np
import pytest

from drivers.base import EndOfRecording, FrameTimeout, SensorLost, SensorMissing
from drivers.depth.base import DepthCamera, DepthFrame
from estimators.pinhole import Intrinsics

READ_S = 5.0
"""Enough for a frame on a busy machine. A test that waits for it has failed."""


class Rig(ABC):
    """A camera and the hand that plugs and unplugs it."""

    camera: DepthCamera
    intrinsics: Intrinsics
    depth_unit_m: float = 0.001

    @abstractmethod
    def close(self) -> None: ...


class LiveRig(Rig):
    """A camera that may fall silent, go away and come back."""

    @abstractmethod
    def fall_silent(self) -> None:
        """Send nothing more, while still plugged in."""

    @abstractmethod
    def unplug(self) -> None: ...

    @abstractmethod
    def plug_in(self) -> None: ...


class DepthCameraContract:
    """Subclass with a fixture ``rig`` that gives a Rig, its camera not yet open, and closes it afterwards."""

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

    def test_numbers_and_times_grow(self, rig: Rig) -> None:
        rig.camera.open()
        frames = [rig.camera.read(READ_S) for _ in range(4)]
        assert all(later.number > earlier.number for earlier, later in pairwise(frames))
        assert all(later.monotonic_ns > earlier.monotonic_ns for earlier, later in pairwise(frames))
        assert abs(time.monotonic_ns() - frames[-1].monotonic_ns) < READ_S * 1e9

    def test_frames_do_not_share_memory(self, rig: Rig) -> None:
        rig.camera.open()
        first = rig.camera.read(READ_S)
        before = first.depth.copy()
        others = [rig.camera.read(READ_S) for _ in range(3)]
        assert np.array_equal(first.depth, before)
        assert not any(np.shares_memory(first.depth, other.depth) for other in others)

    def test_every_frame_says_where_it_came_from(self, rig: Rig) -> None:
        rig.camera.open()
        assert rig.camera.read(READ_S).source
        assert rig.camera.name

    def test_reading_a_closed_camera_says_so(self, rig: Rig) -> None:
        with pytest.raises(SensorLost, match="not open"):
            rig.camera.read(0.1)
        rig.camera.open()
        rig.camera.close()
        with pytest.raises(SensorLost, match="not open"):
            rig.camera.read(0.1)

    def test_closes_twice_and_opens_again(self, rig: Rig) -> None:
        rig.camera.close()
        for _ in range(3):
            rig.camera.open()
            assert isinstance(rig.camera.read(READ_S), DepthFrame)
            rig.camera.close()
            rig.camera.close()

    def test_opening_an_open_camera_starts_it_anew(self, rig: Rig) -> None:
        rig.camera.open()
        rig.camera.read(READ_S)
        rig.camera.open()
        assert rig.camera.read(READ_S).depth.any()

    def test_a_reset_leaves_it_closed_and_fit_to_open(self, rig: Rig) -> None:
        rig.camera.open()
        rig.camera.read(READ_S)
        rig.camera.reset()
        with pytest.raises(SensorLost):
            rig.camera.read(0.1)
        rig.camera.open()
        assert rig.camera.read(READ_S).depth.any()


class LiveCameraContract(DepthCameraContract):
    """Also for cameras: ``rig`` is a LiveRig."""

    def test_silence_is_a_timeout_within_its_bound(self, rig: LiveRig) -> None:
        rig.camera.open()
        rig.camera.read(READ_S)
        rig.fall_silent()
        with pytest.raises(FrameTimeout, match="no picture"):
            _drain(rig.camera, 0.3)
        started = time.monotonic()
        with pytest.raises(FrameTimeout):
            rig.camera.read(0.3)
        assert 0.2 < time.monotonic() - started < 2.0

    def test_unplugging_is_noticed_and_survived(self, rig: LiveRig) -> None:
        rig.camera.open()
        rig.camera.read(READ_S)
        rig.unplug()
        with pytest.raises(SensorLost):
            _drain(rig.camera, 0.3)
        started = time.monotonic()
        rig.camera.close()
        with pytest.raises(SensorMissing):
            rig.camera.open()
        assert time.monotonic() - started < 10.0
        rig.plug_in()
        rig.camera.open()
        assert rig.camera.read(READ_S).depth.any()

    def test_a_camera_that_never_came_is_missing(self, rig: LiveRig) -> None:
        rig.unplug()
        with pytest.raises(SensorMissing) as caught:
            rig.camera.open()
        assert str(caught.value).endswith(".")


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


def _drain(camera: DepthCamera, timeout_s: float) -> None:
    """Read until something is raised: pictures that were under way may still come."""
    for _ in range(100):
        camera.read(timeout_s)
    pytest.fail("the camera goes on sending pictures")
