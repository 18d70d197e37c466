"""What every stereo camera must do, subclassed once for each driver. What passes on a twin is what the real one must pass."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from itertools import pairwise

import numpy as np
import pytest

from drivers.base import FrameTimeout, SensorLost, SensorMissing
from drivers.stereo.base import StereoCamera, StereoFrame
from estimators.pinhole import Intrinsics

READ_S = 5.0
"""Enough for a pair on a busy machine. A test that waits for it has failed."""


class Rig(ABC):
    """A camera, what is known of it, and the hand that plugs and unplugs it."""

    camera: StereoCamera
    intrinsics: Intrinsics
    baseline_m: float
    offset_px: float | None = 0.0

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


class StereoCameraContract:
    """Subclass with a fixture ``rig`` that gives a Rig, its camera not yet open, and closes it afterwards."""

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

    def test_numbers_and_times_grow(self, rig: Rig) -> None:
        rig.camera.open()
        frames = [rig.camera.read(READ_S) for _ in range(3)]
        assert all(later.number > earlier.number for earlier, later in pairwise(frames))
        assert all(later.monotonic_ns > earlier.monotonic_ns for earlier, later in pairwise(frames))
        assert abs(time.monotonic_ns() - frames[-1].monotonic_ns) < READ_S * 1e9

    def test_pairs_do_not_share_memory(self, rig: Rig) -> None:
        rig.camera.open()
        first = rig.camera.read(READ_S)
        before = first.left.copy(), first.right.copy()
        others = [rig.camera.read(READ_S) for _ in range(2)]
        assert np.array_equal(first.left, before[0])
        assert np.array_equal(first.right, before[1])
        assert not any(np.shares_memory(first.left, other.left) for other in others)
        assert not np.shares_memory(first.left, first.right)

    def test_every_pair_says_where_it_came_from(self, rig: Rig) -> None:
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
        for _ in range(2):
            rig.camera.open()
            assert isinstance(rig.camera.read(READ_S), StereoFrame)
            rig.camera.close()
            rig.camera.close()

    def test_a_reset_leaves_it_closed_and_fit_to_open(self, rig: Rig) -> None:
        rig.camera.open()
        rig.camera.read(READ_S)
        rig.camera.reset()
        with pytest.raises(SensorLost):
            rig.camera.read(0.1)
        rig.camera.open()
        assert rig.camera.read(READ_S).left.any()


class LiveStereoContract(StereoCameraContract):
    """Also for cameras: ``rig`` is a LiveRig."""

    def test_silence_is_a_timeout_within_its_bound(self, rig: LiveRig) -> None:
        rig.camera.open()
        rig.camera.read(READ_S)
        rig.fall_silent()
        with pytest.raises(FrameTimeout):
            _drain(rig.camera, 0.2)
        started = time.monotonic()
        with pytest.raises(FrameTimeout) as caught:
            rig.camera.read(0.2)
        assert 0.1 < time.monotonic() - started < 2.0
        assert str(caught.value).endswith(".")

    def test_unplugging_is_noticed_and_survived(self, rig: LiveRig) -> None:
        rig.camera.open()
        rig.camera.read(READ_S)
        rig.unplug()
        with pytest.raises(SensorLost) as caught:
            _drain(rig.camera, 0.3)
        assert str(caught.value).endswith(".")
        rig.camera.close()
        with pytest.raises((SensorMissing, SensorLost)):
            rig.camera.open()
        rig.plug_in()
        rig.camera.open()
        assert rig.camera.read(READ_S).left.any()

    def test_a_camera_that_never_came_is_missing(self, rig: LiveRig) -> None:
        rig.unplug()
        with pytest.raises((SensorMissing, SensorLost)) as caught:
            rig.camera.open()
        assert str(caught.value).endswith(".")


def _drain(camera: StereoCamera, timeout_s: float) -> None:
    """Read until something is raised: pairs that were under way may still come."""
    for _ in range(100):
        camera.read(timeout_s)
    pytest.fail("the camera goes on sending pairs")
