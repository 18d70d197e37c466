"""The left picture of the stereo camera keeps the contract of grabbers, lets the camera rest, and tells what ails it."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from device.feeds.feed import StereoFeed
from device.feeds.reader import FeedTiming
from device.landmarks.crawler import Optics
from device.landmarks.left_picture import LeftPicture, optics_of
from drivers.base import DriverError, FrameTimeout, SensorLost
from drivers.virtual.profile import circular
from drivers.virtual.stereo_camera import StereoLens, StereoLook, StereoPainter, VirtualStereoCamera
from drivers.virtual.world import VirtualSewer
from estimators.pinhole import Intrinsics
from tests.unit.drivers.grabber_contract import GrabberContract, Rig
from tests.unit.drivers.sensor_contract import READ_S, TwinPlug, drain
from tests.waiting import wait_until

SMALL = StereoLens(Intrinsics(160, 100, 93.0, 94.0, 78.5, 50.5), 0.06)
TIMING = FeedTiming(read_s=0.3, back_off_s=(0.05, 0.1), faults_before_reopen=1)


class LeftRig(TwinPlug, Rig):
    width, height = 160, 100

    def __init__(self) -> None:
        painter = StereoPainter(VirtualSewer(circular(0.4), 6.0), SMALL, StereoLook(), 3)
        self.twin = VirtualStereoCamera(painter, seed=3, dwell=10_000, rate_hz=50.0)
        self.feed = StereoFeed(self.twin.name, "virtual", lambda: self.twin, timing=TIMING)
        self.feed.start()
        self.grabber = LeftPicture(self.feed)

    def close(self) -> None:
        self.grabber.close()
        self.feed.close()


@pytest.fixture
def rig() -> Iterator[LeftRig]:
    rig = LeftRig()
    yield rig
    rig.close()


class TestLeftPicture(GrabberContract):
    """Grey pictures, as of an infrared pair, come as colour."""


def test_the_camera_is_awake_only_while_somebody_reads(rig: LeftRig) -> None:
    wait_until(lambda: rig.feed.status().state == "resting")
    rig.grabber.open()
    rig.grabber.read(READ_S)
    assert rig.feed.status().state == "up"
    rig.grabber.close()
    wait_until(lambda: rig.feed.status().state == "resting")


def test_a_silent_camera_is_a_timeout_and_a_lost_one_says_in_its_own_words_why(rig: LeftRig) -> None:
    rig.grabber.open()
    rig.grabber.read(READ_S)
    rig.fall_silent()
    with pytest.raises(FrameTimeout, match="no picture"):
        drain(rig.grabber, 0.1)
    rig.unplug()
    wait_until(lambda: rig.feed.status().state == "lost")
    with pytest.raises(SensorLost) as caught:
        drain(rig.grabber, 2.0)
    assert str(caught.value) == rig.feed.status().message
    rig.plug_in()
    rig.twin.faults.end("never comes")

    def sees() -> bool:
        try:
            return rig.grabber.read(0.5).image.any()
        except DriverError:
            return False

    wait_until(sees)


def test_cameras_that_are_lent_for_a_calibration_say_so(rig: LeftRig) -> None:
    rig.grabber.open()
    rig.grabber.read(READ_S)
    assert rig.feed.tapped
    rig.feed.lend(True)
    assert rig.feed.at_rest(READ_S)
    with pytest.raises(FrameTimeout, match="calibrated"):
        drain(rig.grabber, 0.1)
    rig.feed.lend(False)
    assert rig.grabber.read(READ_S).image.any()


def test_its_optics_are_those_that_the_pairs_state(rig: LeftRig) -> None:
    assert optics_of(rig.feed) == Optics((93.0, 94.0), (78.5, 50.5))
