"""What every CCTV grabber must do, subclassed once for each driver. What passes on a twin is what the real one must pass."""

from __future__ import annotations

import threading
import time
from abc import ABC, abstractmethod
from itertools import pairwise

import numpy as np
import pytest

from drivers.base import DriverError, EndOfRecording, FrameTimeout, SensorLost, SensorMissing
from drivers.grabber.base import FrameGrabber, VideoFrame

READ_S = 8.0
"""Enough for a picture on a busy machine. A test that waits for it has failed."""


class Rig(ABC):
    """A grabber and the hand on its plug. ``width`` and ``height`` of its pictures."""

    grabber: FrameGrabber
    width: int
    height: int

    @abstractmethod
    def close(self) -> None: ...


class LiveRig(Rig):
    """A grabber that may fall silent, go away and come back."""

    @abstractmethod
    def fall_silent(self) -> None:
        """Send nothing more, while still plugged in."""

    @abstractmethod
    def unplug(self) -> None: ...

    @abstractmethod
    def plug_in(self) -> None: ...


class GrabberContract:
    """Subclass with a fixture ``rig`` that gives a Rig, its grabber not yet open, and closes it afterwards."""

    def test_frames_are_pictures_of_the_stated_size(self, rig: Rig) -> None:
        rig.grabber.open()
        frame = rig.grabber.read(READ_S)
        assert frame.image.dtype == np.uint8
        assert frame.image.shape == (rig.height, rig.width, 3)
        assert frame.image.any()

    def test_numbers_and_times_grow(self, rig: Rig) -> None:
        rig.grabber.open()
        frames = [rig.grabber.read(READ_S) for _ in range(4)]
        assert frames[0].number >= 1
        assert all(later.number > earlier.number for earlier, later in pairwise(frames))
        assert all(later.time_s > earlier.time_s for earlier, later in pairwise(frames))
        assert all(later.monotonic_ns > earlier.monotonic_ns for earlier, later in pairwise(frames))
        assert abs(time.monotonic_ns() - frames[-1].monotonic_ns) < READ_S * 1e9

    def test_frames_do_not_share_memory(self, rig: Rig) -> None:
        rig.grabber.open()
        first = rig.grabber.read(READ_S)
        before = first.image.copy()
        others = [rig.grabber.read(READ_S) for _ in range(3)]
        assert np.array_equal(first.image, before)
        assert not any(np.shares_memory(first.image, other.image) for other in others)

    def test_every_frame_says_where_it_came_from(self, rig: Rig) -> None:
        rig.grabber.open()
        assert rig.grabber.read(READ_S).source
        assert rig.grabber.name

    def test_reading_a_closed_grabber_says_so(self, rig: Rig) -> None:
        with pytest.raises(SensorLost, match="not open"):
            rig.grabber.read(0.1)
        rig.grabber.open()
        rig.grabber.close()
        with pytest.raises(SensorLost, match="not open"):
            rig.grabber.read(0.1)

    def test_closes_twice_and_opens_again(self, rig: Rig) -> None:
        rig.grabber.close()
        for _ in range(3):
            rig.grabber.open()
            assert isinstance(rig.grabber.read(READ_S), VideoFrame)
            rig.grabber.close()
            rig.grabber.close()

    def test_opening_an_open_grabber_starts_it_anew(self, rig: Rig) -> None:
        rig.grabber.open()
        rig.grabber.read(READ_S)
        rig.grabber.open()
        assert rig.grabber.read(READ_S).image.any()

    def test_a_reset_leaves_it_closed_and_fit_to_open(self, rig: Rig) -> None:
        rig.grabber.open()
        rig.grabber.read(READ_S)
        rig.grabber.reset()
        with pytest.raises(SensorLost):
            rig.grabber.read(0.1)
        rig.grabber.open()
        assert rig.grabber.read(READ_S).image.any()


class LiveGrabberContract(GrabberContract):
    """Also for live sources: ``rig`` is a LiveRig."""

    def test_a_late_reader_gets_new_pictures_and_sees_the_gap(self, rig: LiveRig) -> None:
        rig.grabber.open()
        first = rig.grabber.read(READ_S)
        time.sleep(1.0)
        later = [rig.grabber.read(READ_S) for _ in range(6)]
        assert time.monotonic_ns() - later[-1].monotonic_ns < 0.5e9
        assert later[-1].number - first.number > 6

    def test_silence_is_a_timeout_within_its_bound(self, rig: LiveRig) -> None:
        rig.grabber.open()
        rig.grabber.read(READ_S)
        rig.fall_silent()
        with pytest.raises(FrameTimeout):
            _drain(rig.grabber, 0.3)
        started = time.monotonic()
        with pytest.raises(FrameTimeout):
            rig.grabber.read(0.3)
        assert 0.2 < time.monotonic() - started < 1.5

    def test_unplugging_is_noticed_and_survived(self, rig: LiveRig) -> None:
        rig.grabber.open()
        rig.grabber.read(READ_S)
        rig.unplug()
        with pytest.raises(SensorLost) as caught:
            _drain(rig.grabber, 3.0)
        assert str(caught.value).endswith(".")
        with pytest.raises(SensorLost):  # and stays so until it is opened again
            rig.grabber.read(0.1)
        started = time.monotonic()
        rig.grabber.close()
        with pytest.raises((SensorMissing, SensorLost)):
            rig.grabber.open()
        assert time.monotonic() - started < 10.0
        rig.plug_in()
        rig.grabber.open()
        assert rig.grabber.read(READ_S).image.any()

    def test_a_source_that_never_came_is_missing(self, rig: LiveRig) -> None:
        rig.unplug()
        with pytest.raises(SensorMissing) as caught:
            rig.grabber.open()
        assert str(caught.value).endswith(".")

    def test_closing_wakes_a_reader_that_waits(self, rig: LiveRig) -> None:
        rig.grabber.open()
        rig.grabber.read(READ_S)
        rig.fall_silent()
        found: list[Exception] = []

        def read() -> None:
            try:
                while True:
                    rig.grabber.read(20.0)
            except Exception as error:  # noqa: BLE001 - whatever it is, the test looks at it
                found.append(error)

        thread = threading.Thread(target=read)
        thread.start()
        time.sleep(0.3)
        rig.grabber.close()
        thread.join(5.0)
        assert not thread.is_alive()
        assert isinstance(found[0], DriverError)


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


def _drain(grabber: FrameGrabber, timeout_s: float) -> None:
    """Read until something is raised: pictures that were under way may still come."""
    for _ in range(300):
        grabber.read(timeout_s)
    pytest.fail("the grabber goes on sending pictures")
