"""The rectified pair of RealSense and OAK cameras, over their makers' own software without a camera."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("pyrealsense2", reason="pyrealsense2 is not installed")
pytest.importorskip("depthai", reason="depthai is not installed")

import depthai as dai
import pyrealsense2 as rs

import drivers.depth.depthai_rs as oak
from drivers.base import BadFrame, FrameTimeout, SensorLost, SensorMissing
from drivers.depth.depthai_rs.configs import StreamRequest
from drivers.depth.depthai_rs.graph import plan_streams
from drivers.stereo.base import PairSettings
from drivers.stereo.live import LivePair
from tests.unit.drivers.fake_oak import stereo_features, stereo_pair
from tests.unit.drivers.live_pairs import LENS, SMALL, OakPairRig, RealSenseRig, SoftwarePair
from tests.unit.drivers.stereo_camera_contract import READ_S, LiveStereoContract


@pytest.fixture(autouse=True)
def quick_reboot(monkeypatch: pytest.MonkeyPatch) -> None:
    """The fake device is back on the bus at once."""
    monkeypatch.setattr(sys.modules["drivers.depth.depthai_rs.devices"], "REBOOT_SECONDS", 0.3)


class TestRealSense(LiveStereoContract):
    @pytest.fixture
    def rig(self) -> Iterator[RealSenseRig]:
        made = RealSenseRig()
        yield made
        made.close()


class TestOak(LiveStereoContract):
    @pytest.fixture
    def rig(self) -> Iterator[OakPairRig]:
        made = OakPairRig()
        yield made
        made.close()


@pytest.fixture
def realsense() -> Iterator[RealSenseRig]:
    made = RealSenseRig()
    yield made
    made.close()


@pytest.fixture
def luxonis() -> Iterator[OakPairRig]:
    made = OakPairRig()
    yield made
    made.close()


def test_the_projector_is_on_and_the_calibration_is_not_taken_for_perfect(realsense: RealSenseRig) -> None:
    realsense.camera.open()
    assert realsense.source.sensor.get_option(rs.option.emitter_enabled) == 1
    frame = realsense.camera.read(READ_S)
    assert frame.offset_std_px > 0
    assert frame.scale_std > 0
    assert frame.left.ndim == 2


def test_a_moment_of_which_one_picture_was_lost_is_no_pair(realsense: RealSenseRig) -> None:
    realsense.fall_silent()
    realsense.camera.open()
    realsense.source.send(sides=(0,))
    with pytest.raises(FrameTimeout):
        realsense.camera.read(0.3)
    realsense.source.send()
    frame = realsense.camera.read(READ_S)
    assert np.array_equal(frame.left, frame.right), "each picture shows its number"


@pytest.mark.parametrize("lost", ["rectifiedLeft", "rectifiedRight"])
def test_pictures_of_an_oak_are_joined_by_their_moment(luxonis: OakPairRig, lost: str) -> None:
    luxonis.skip = lambda number, port: port == lost and number % 3 == 0
    luxonis.camera.open()
    frames = [luxonis.camera.read(READ_S) for _ in range(6)]
    assert all(np.array_equal(frame.left, frame.right) for frame in frames)
    assert not any(frame.number % 3 == 0 for frame in frames)


def test_half_of_an_oak_is_no_pair(luxonis: OakPairRig) -> None:
    luxonis.skip = lambda number, port: port == "rectifiedRight"
    luxonis.camera.open()
    with pytest.raises(FrameTimeout, match="no picture"):
        luxonis.camera.read(0.4)


def test_an_oak_rectifies_its_pair_and_matches_nothing(luxonis: OakPairRig) -> None:
    luxonis.camera.open()
    device = luxonis.bus.device
    assert device is not None
    assert device.pipeline is not None
    assert set(device.pipeline.queues) == {("StereoDepth AUTO", "rectifiedLeft"), ("StereoDepth AUTO", "rectifiedRight")}
    assert {target.name for _, target in device.pipeline.links} == {"left", "right"}
    assert device.intensity == 1.0, "the dot projector is on"
    assert len(device.pipeline.sent) == 0, "exposure is the camera's own"


def test_an_oak_of_which_only_one_eye_is_asked_is_not_rectified() -> None:
    both = [StreamRequest(oak.stream.infrared, index, 640, 400, oak.format.y8, 30) for index in (1, 2)]
    assert all(one.rectified for one in plan_streams(dai, stereo_features(), [stereo_pair()], both).streams)
    assert not plan_streams(dai, stereo_features(), [stereo_pair()], both[:1]).streams[0].rectified
    with pytest.raises(RuntimeError, match="resolve"):  # the two of a pair are of one size
        plan_streams(dai, stereo_features(), [stereo_pair()], [both[0], replace(both[1], width=320)])


def test_a_camera_that_does_less_is_asked_for_less_and_says_so(luxonis: OakPairRig) -> None:
    camera = LivePair(luxonis.bus.surface(), PairSettings(1600, 1000, fps=30))  # more than its sensors have
    camera.open()
    assert "848 x 480" in camera.notice
    camera.close()


@pytest.mark.parametrize(
    "step", [(0.05, 0.0, 0.0), (0.0, 0.0, 0.0), (-0.05, 0.01, 0.0), (-5.0, 0.0, 0.0)], ids=["swapped", "none", "askew", "cm"]
)
def test_a_pair_that_does_not_stand_side_by_side_is_not_believed(step: tuple[float, float, float]) -> None:
    rig = RealSenseRig(source=SoftwarePair(step=step))
    try:
        with pytest.raises(SensorLost, match="stand to each other"):
            rig.camera.open()
    finally:
        rig.close()


@pytest.mark.parametrize(
    "right",
    [replace(LENS, ppy=LENS.ppy + 3), replace(LENS, fx=380.0), replace(LENS, model="brown_conrady", coeffs=(0.1, 0, 0, 0, 0))],
    ids=["lower", "longer", "bent"],
)
def test_a_pair_that_is_not_rectified_is_refused(right: object) -> None:
    rig = RealSenseRig(source=SoftwarePair(lenses=(LENS, right)))  # type: ignore[arg-type]
    try:
        rig.camera.open()
        with pytest.raises(BadFrame, match="not rectified"):
            rig.camera.read(READ_S)
    finally:
        rig.close()


def test_principal_points_apart_are_an_offset_of_the_disparity() -> None:
    rig = RealSenseRig(source=SoftwarePair(lenses=(LENS, replace(LENS, ppx=LENS.ppx - 4))))
    try:
        rig.camera.open()
        # u_left - u_right = f b / Z + (c_left - c_right)
        assert rig.camera.read(READ_S).offset_px == pytest.approx(4.0, abs=1e-3)
    finally:
        rig.close()


def test_the_serial_number_picks_the_camera(realsense: RealSenseRig) -> None:
    with pytest.raises(SensorMissing, match="12345"):
        LivePair(realsense.module, replace(SMALL, serial="12345")).open()


@pytest.mark.parametrize("wrong", [{"width": 0}, {"fps": 0}, {"exposure_us": 0}, {"laser_power": 1.5}])
def test_impossible_settings_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=r"camera|exposure|laser"):
        PairSettings(**wrong)  # type: ignore[arg-type]
