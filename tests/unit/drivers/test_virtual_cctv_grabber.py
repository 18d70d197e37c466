"""The CCTV grabber's twin: a grabber like any other, with faults, and a recording that is the same to the bit."""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache

import numpy as np
import pytest

from drivers.base import BadFrame, EndOfRecording, SensorLost
from drivers.virtual.camera import CctvCamera
from drivers.virtual.crawler import DriveClock
from drivers.virtual.drive import Drive, Go
from drivers.virtual.faults import CCTV_FAULTS, Fault, FaultScript
from drivers.virtual.grabber import Footage, VirtualGrabber, VirtualVideo
from drivers.virtual.profile import circular
from drivers.virtual.world import VirtualSewer
from tests.unit.drivers.grabber_contract import LiveGrabberContract, LiveRig, RecordingContract, Rig
from tests.unit.drivers.sensor_contract import TwinPlug

SMALL = CctvCamera(96.0, 102.0, 79.5, 63.5, 160, 128)


@lru_cache(maxsize=1)
def footage() -> Footage:
    """One for all tests, its wall painted once."""
    found = Footage(Drive(VirtualSewer(circular(0.3), 8.0), (Go(0.2, 0.3),), camera=SMALL, seed=3))
    found.picture(0.0, 0)
    return found


class Live(TwinPlug, LiveRig):
    width, height = 160, 128

    def __init__(self) -> None:
        self.footage = footage()
        self.clock = DriveClock(self.footage.drive.length_s, loop=True)
        self.clock.begin()
        self.grabber = self.twin = VirtualGrabber(self.footage, self.clock)

    def close(self) -> None:
        self.grabber.close()


class TestLive(LiveGrabberContract):
    @pytest.fixture
    def rig(self) -> Iterator[Live]:
        rig = Live()
        yield rig
        rig.close()


class Recorded(Rig):
    width, height = 160, 128

    def __init__(self) -> None:
        self.grabber = VirtualVideo(footage())

    def close(self) -> None:
        self.grabber.close()


class TestRecording(RecordingContract):
    frames_in_recording = 46  # 0.2 m with ramps to 0.22 m/s take 1.789 s but for the last part of a frame, at 25 a second

    @pytest.fixture
    def rig(self) -> Iterator[Recorded]:
        self.frames_in_recording = int(footage().drive.length_s * 25)
        rig = Recorded()
        yield rig
        rig.close()


# --- faults, live ---


@pytest.fixture
def live() -> Iterator[Live]:
    rig = Live()
    rig.grabber.open()
    yield rig
    rig.close()


def test_a_frozen_grabber_sends_one_picture_again_and_again(live: Live) -> None:
    live.twin.faults.trigger("freeze")
    first, second = live.grabber.read(), live.grabber.read()
    assert second.number > first.number
    assert np.array_equal(first.image, second.image)
    live.twin.faults.end()
    assert not np.array_equal(live.grabber.read().image, second.image)


def test_without_the_lamp_it_is_dark(live: Live) -> None:
    bright = live.grabber.read().image.mean()
    live.twin.faults.trigger("dark")
    assert live.grabber.read().image.mean() < 0.15 * bright


def test_garbage_and_half_pictures(live: Live) -> None:
    live.twin.faults.trigger("garbage")
    assert live.grabber.read().image.std() == pytest.approx(74, abs=2), "even random bytes"
    live.twin.faults.trigger("wrong size")
    assert live.grabber.read().image.shape == (64, 160, 3)


def test_a_stalled_picture_comes_late_once_a_second(live: Live) -> None:
    live.twin.faults.trigger("stall")
    frames = [live.grabber.read() for _ in range(40)]
    gaps = np.diff([frame.monotonic_ns for frame in frames]) / 1e9
    assert 1 <= (gaps > 0.1).sum() <= 6


def test_every_fault_can_be_triggered_and_ends(live: Live) -> None:
    for name in CCTV_FAULTS:
        live.twin.faults.trigger(name, for_s=0.01)
    live.twin.faults.end()
    live.grabber.open()
    assert live.grabber.read().image.any()


def test_what_is_held_stands(live: Live) -> None:
    live.clock.hold(True)
    t = live.clock.now_s()
    live.grabber.read()
    assert live.clock.now_s() == t
    live.clock.hold(False)
    live.grabber.read()
    live.grabber.read()
    assert live.clock.now_s() != t


# --- the recording ---


def read_all(video: VirtualVideo) -> list[tuple[int, float | None, bytes]]:
    found = []
    video.open()
    while True:
        try:
            frame = video.read()
        except EndOfRecording:
            return found
        except BadFrame:
            continue
        found.append((frame.number, frame.media_s, frame.image.tobytes()))


def test_two_recordings_of_one_seed_are_the_same_with_all_their_faults() -> None:
    faults = (Fault("freeze", 0.2, 0.2), Fault("dark", 0.5, 0.2), Fault("stall", 0.7, 0.4), Fault("garbage", 1.2, 0.1))
    one, other = (read_all(VirtualVideo(footage(), FaultScript(faults))) for _ in range(2))
    assert one == other
    assert one != read_all(VirtualVideo(footage()))


def test_a_lost_stream_leaves_a_gap_in_the_recording() -> None:
    frames = read_all(VirtualVideo(footage(), FaultScript([Fault("disconnect", 0.4, 0.4)])))
    numbers = [number for number, _, _ in frames]
    assert set(range(1, 11)) < set(numbers)
    assert not set(range(12, 20)) & set(numbers)
    assert all(media_s == pytest.approx((number - 1) / 25) for number, media_s, _ in frames)


def test_a_stalled_picture_of_a_recording_shows_what_was_before() -> None:
    plain = {number: image for number, _, image in read_all(VirtualVideo(footage()))}
    stalled = read_all(VirtualVideo(footage(), FaultScript([Fault("stall")])))
    numbers = [number for number, _, _ in stalled]
    assert sorted(set(numbers)) == numbers
    late = [(number, image) for number, _, image in stalled if image != plain[number]]
    assert len(late) == 1
    assert late[0][0] == 27, "the 25th, 100 ms or two frames late"


def test_a_closed_recording_is_not_read() -> None:
    with pytest.raises(SensorLost):
        VirtualVideo(footage()).read()
