"""What every CCTV grabber must do, subclassed once for each driver. What passes on a twin is what the real one must pass."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from drivers.base import EndOfRecording, SensorLost, SensorMissing
from drivers.grabber.base import FrameGrabber, VideoFrame
from tests.unit.drivers.sensor_contract import READ_S, Plug, SensorContract, SensorRig, WakingContract


class Rig(SensorRig):
    """A grabber and the hand on its plug. ``width`` and ``height`` of its pictures."""

    grabber: FrameGrabber
    width: int
    height: int

    @property
    def sensor(self) -> FrameGrabber:
        return self.grabber


class LiveRig(Rig, Plug):
    """A grabber that may fall silent, go away and come back."""


class GrabberContract(SensorContract):
    """Subclass with a fixture ``rig`` that gives a Rig, its grabber not yet open, and closes it afterwards."""

    reads = VideoFrame
    clocks = ("number", "time_s", "monotonic_ns")

    def pictures(self, reading: VideoFrame) -> list[NDArray[Any]]:
        return [reading.image]

    def test_frames_are_pictures_of_the_stated_size(self, rig: Rig) -> None:
        rig.grabber.open()
        frame = rig.grabber.read(READ_S)
        assert frame.image.dtype == np.uint8
        assert frame.image.shape == (rig.height, rig.width, 3)
        assert frame.image.any()
        assert frame.number >= 1


class LiveGrabberContract(GrabberContract, WakingContract):
    """Also for live sources: ``rig`` is a LiveRig."""

    notices_s = 3.0
    gone = (SensorMissing, SensorLost)

    def test_a_late_reader_gets_new_pictures_and_sees_the_gap(self, rig: LiveRig) -> None:
        rig.grabber.open()
        first = rig.grabber.read(READ_S)
        time.sleep(1.0)
        later = [rig.grabber.read(READ_S) for _ in range(6)]
        assert time.monotonic_ns() - later[-1].monotonic_ns < 0.5e9
        assert later[-1].number - first.number > 6


class RecordingContract(GrabberContract):
    """Also for recordings: ``frames_in_recording`` frames, and then the end."""

    frames_in_recording: int

    def test_plays_every_frame_once_and_then_ends(self, rig: Rig) -> None:
        rig.grabber.open()
        frames = [rig.grabber.read(READ_S) for _ in range(self.frames_in_recording)]
        assert [frame.number for frame in frames] == list(range(1, self.frames_in_recording + 1))
        assert all(frame.media_s is not None for frame in frames)
        assert rig.grabber.frame_count == self.frames_in_recording
        for _ in range(2):
            started = time.monotonic()
            with pytest.raises(EndOfRecording):
                rig.grabber.read(READ_S)
            assert time.monotonic() - started < READ_S / 2

    def test_opened_again_it_begins_again(self, rig: Rig) -> None:
        rig.grabber.open()
        first = [rig.grabber.read(READ_S) for _ in range(3)]
        rig.grabber.close()
        rig.grabber.open()
        again = [rig.grabber.read(READ_S) for _ in range(3)]
        assert [(one.number, one.media_s) for one in first] == [(one.number, one.media_s) for one in again]
        assert all(np.array_equal(one.image, other.image) for one, other in zip(first, again, strict=True))
