"""The stereo contract on two plain cameras, on the virtual camera and on recorded pairs; and what is special to two cameras."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from drivers.base import BadFrame, FrameTimeout, SensorLost, SensorMissing
from drivers.grabber.base import FrameGrabber, VideoFrame
from drivers.stereo.rectifier import Calibrated
from drivers.stereo.replay import PairReplay
from drivers.stereo.two_cameras import GrabberPair, TwoCameras
from drivers.virtual.profile import circular
from drivers.virtual.stereo_camera import StereoLens, StereoLook, StereoPainter, VirtualStereoCamera
from drivers.virtual.world import VirtualSewer
from estimators.pinhole import Intrinsics, LensPair, project_rays, rectified
from tests.unit.drivers.sensor_contract import TwinPlug
from tests.unit.drivers.stereo_camera_contract import READ_S, LiveRig, LiveStereoContract, Rig, StereoCameraContract

SIZE = (160, 100)
STRAIGHT = Intrinsics(*SIZE, 100.0, 100.0, 79.5, 49.5)
SIDE_BY_SIDE = LensPair(STRAIGHT, STRAIGHT, (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0), (-0.06, 0.0, 0.0))


class FakeGrabber(FrameGrabber):
    """A camera with a picture every ``period`` s from ``phase`` on; each shows its number."""

    def __init__(self, name: str, phase: float = 0.0, period: float = 1 / 50) -> None:
        self.name = name
        self.frame_rate = 1 / period
        self.size = SIZE
        self.plugged, self.silent, self.opened, self.resets = True, False, False, 0
        self._phase, self._period = phase, period
        self._last = 0

    def _open(self) -> None:
        if not self.plugged:
            raise SensorMissing(f"There is no {self.name}.")
        self.opened = True

    def _read(self, timeout_s: float) -> VideoFrame:
        if not self.opened or not self.plugged:
            raise SensorLost(f"The {self.name} is gone.")
        number = max(self._last + 1, int((time.monotonic() - self._phase) / self._period))
        due = number * self._period + self._phase
        if self.silent or due - time.monotonic() > timeout_s:
            time.sleep(timeout_s)
            raise FrameTimeout(f"The {self.name} sent no picture for {timeout_s:g} s.")
        time.sleep(max(0.0, due - time.monotonic()))
        self._last = number
        image = np.full((self.size[1], self.size[0], 3), 1 + number % 250, np.uint8)
        return VideoFrame(image, int(due * 1e9), number, source=self.name)

    def reset(self) -> None:
        self.resets += 1
        self.close()

    def close(self) -> None:
        self.opened = False


class TwoCamerasRig(LiveRig):
    def __init__(self, right: FakeGrabber | None = None, lenses: LensPair = SIDE_BY_SIDE) -> None:
        self.left, self.right = FakeGrabber("left camera"), right or FakeGrabber("right camera", phase=0.006)
        self.camera = TwoCameras(GrabberPair(self.left, self.right), lambda: Calibrated(lenses, 0.1, 0.002))
        found = rectified(lenses)
        self.intrinsics, self.baseline_m = found.intrinsics, found.baseline_m

    def fall_silent(self) -> None:
        self.right.silent = True

    def unplug(self) -> None:
        self.right.plugged = False

    def plug_in(self) -> None:
        self.right.plugged = True

    def close(self) -> None:
        self.camera.close()


class TestTwoCameras(LiveStereoContract):
    @pytest.fixture
    def rig(self) -> Iterator[TwoCamerasRig]:
        made = TwoCamerasRig()
        yield made
        made.close()


class VirtualRig(TwinPlug, LiveRig):
    def __init__(self) -> None:
        lens = StereoLens(Intrinsics(64, 40, 37.0, 37.0, 31.5, 19.5), 0.06, 3.0)
        painter = StereoPainter(VirtualSewer(circular(0.4), 4.0), lens, StereoLook(), 3)
        self.twin = VirtualStereoCamera(painter, dwell=1000, rate_hz=30.0)
        self.camera = self.twin
        self.intrinsics, self.baseline_m, self.offset_px = lens.intrinsics, lens.baseline_m, lens.offset_px

    def close(self) -> None:
        self.twin.close()


class TestVirtual(LiveStereoContract):
    @pytest.fixture
    def rig(self) -> Iterator[VirtualRig]:
        made = VirtualRig()
        yield made
        made.close()


class ReplayRig(Rig):
    def __init__(self, folder: Path) -> None:
        pairs = []
        for number in range(3):
            names = [f"{number}_{side}.png" for side in "LR"]
            for name in names:
                cv2.imwrite(str(folder / name), np.full((20, 32), 50 + number, np.uint8))
            pairs.append({"left": names[0], "right": names[1]})
        manifest = {
            "width": 32,
            "height": 20,
            "focal_px": 30.0,
            "baseline_mm": 29.0,
            "disparity_offset_px": 2.0,
            "pairs": pairs,
        }
        (folder / "manifest.json").write_text(json.dumps(manifest))
        self.camera = PairReplay(folder, loop=True)
        self.intrinsics, self.baseline_m, self.offset_px = Intrinsics(32, 20, 30.0, 30.0, 15.5, 9.5), 0.029, 2.0

    def close(self) -> None:
        self.camera.close()


class TestReplay(StereoCameraContract):
    @pytest.fixture
    def rig(self, tmp_path: Path) -> Iterator[ReplayRig]:
        made = ReplayRig(tmp_path)
        yield made
        made.close()


@pytest.fixture
def two() -> Iterator[TwoCamerasRig]:
    made = TwoCamerasRig()
    yield made
    made.close()


def test_pictures_of_one_moment_are_joined(two: TwoCamerasRig) -> None:
    grabbers = GrabberPair(two.left, two.right)
    grabbers.open()
    two.left.read(1.0)  # one of them is ahead
    for _ in range(4):
        left, right = grabbers.read(1.0)
        assert abs(left.monotonic_ns - right.monotonic_ns) < 0.6 * 20e6


def test_a_camera_that_is_too_slow_is_no_pair() -> None:
    half_way = time.monotonic() - 7.5  # its last picture came 2.5 s ago, its next comes in 2.5 s
    rig = TwoCamerasRig(right=FakeGrabber("right camera", phase=half_way, period=5.0))
    rig.right.frame_rate = 50.0  # it says so, and does not keep it
    rig.camera.open()
    with pytest.raises(FrameTimeout):
        rig.camera.read(0.2)
    rig.close()


def test_both_are_closed_where_one_is_missing_and_both_are_reset(two: TwoCamerasRig) -> None:
    two.unplug()
    with pytest.raises(SensorMissing, match="right camera"):
        two.camera.open()
    assert not two.left.opened
    two.plug_in()
    two.camera.open()
    two.camera.reset()
    assert (two.left.resets, two.right.resets, two.left.opened, two.right.opened) == (1, 1, False, False)


def test_pictures_of_another_size_than_was_calibrated_are_refused(two: TwoCamerasRig) -> None:
    two.camera.open()
    two.right.size = (80, 50)
    with pytest.raises(BadFrame, match="right camera sends pictures of 80 x 50, the calibration is for 160 x 100"):
        two.camera.read(READ_S)


def test_what_is_known_of_the_calibration_goes_with_each_pair(two: TwoCamerasRig) -> None:
    two.camera.open()
    frame = two.camera.read(READ_S)
    assert (frame.offset_px, frame.offset_std_px, frame.scale_std) == (0.0, 0.1, 0.002)
    assert "hold still" in two.camera.notice


def test_a_point_lies_on_one_row_of_both_rectified_pictures_and_its_disparity_tells_its_depth() -> None:
    """Points in space through two bent lenses that squint: where the rectified pictures show them depth is read from."""
    bent = replace(STRAIGHT, model="brown_conrady", coeffs=(-0.2, 0.05, 0.001, -0.001, 0.0))
    other = replace(bent, fx=103.0, fy=103.0, ppx=82.0)
    turn = cv2.Rodrigues(np.array([0.01, -0.03, 0.02]))[0]
    step = -turn @ np.array([0.06, 0.001, 0.0])
    lenses = LensPair(bent, other, tuple(turn.ravel()), tuple(step))
    found = rectified(lenses)
    assert found.baseline_m == pytest.approx(np.linalg.norm(step), rel=1e-6)
    for point in (np.array([0.0, 0.0, 0.5]), np.array([0.1, -0.05, 0.8]), np.array([-0.15, 0.1, 1.2])):
        rows = []
        for lens, seen, rotation in zip((bent, other), (point, turn @ point + step), found.turns, strict=True):
            # the same point as the maps of TwoCameras take it: turned, and seen by the new pin-hole
            new = rotation @ seen
            u, v = found.intrinsics.fx * new[:2] / new[2] + [found.intrinsics.ppx, found.intrinsics.ppy]
            # and the way back: the pixel that the map takes it from is where the lens throws it
            back = rotation.T @ np.array(
                [(u - found.intrinsics.ppx) / found.intrinsics.fx, (v - found.intrinsics.ppy) / found.intrinsics.fy, 1.0]
            )
            assert project_rays((back[:2] / back[2])[None], lens) == pytest.approx(
                project_rays((seen[:2] / seen[2])[None], lens)
            )
            rows.append((u, v, new[2]))
        (left_u, left_v, depth), (right_u, right_v, _) = rows
        assert left_v == pytest.approx(right_v, abs=1e-6)
        assert left_u - right_u == pytest.approx(found.intrinsics.fx * found.baseline_m / depth, rel=1e-6)


def test_the_maps_take_each_pixel_from_where_the_lens_throws_it() -> None:
    bent = replace(STRAIGHT, fx=110.0, fy=110.0, model="brown_conrady", coeffs=(-0.35, 0.1, 0.0, 0.0, 0.0))
    lenses = replace(SIDE_BY_SIDE, left=bent, right=bent)
    rig = TwoCamerasRig(lenses=lenses)
    ramp = np.broadcast_to(np.arange(SIZE[0], dtype=np.uint8)[None, :, None], (SIZE[1], SIZE[0], 3)).copy()
    rig.camera.open()
    rig.left._read = lambda timeout_s: VideoFrame(ramp, time.monotonic_ns(), 1, source="ramp")  # type: ignore[method-assign]
    rig.right._read = lambda timeout_s: VideoFrame(ramp, time.monotonic_ns(), 1, source="ramp")  # type: ignore[method-assign]
    frame = rig.camera.read(READ_S)
    new = frame.intrinsics
    u, v = 12, 90
    ray = np.array([[(u - new.ppx) / new.fx, (v - new.ppy) / new.fy]])
    assert float(frame.left[v, u, 0]) == pytest.approx(project_rays(ray, bent)[0, 0], abs=1.0)
    assert float(frame.left[v, u, 0]) != pytest.approx(u, abs=1.0), "a lens that bends nothing would prove nothing"


@pytest.mark.parametrize(
    "wrong",
    [
        {"translation": (0.06, 0.0, 0.0)},
        {"translation": (0.0, 0.06, 0.0)},
        {"rotation": (2.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)},
        {"rotation": (1.0, 0.0)},
        {"right": replace(STRAIGHT, width=100)},
    ],
    ids=["swapped", "above", "no rotation", "too short", "sizes"],
)
def test_cameras_that_cannot_be_a_pair_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(ValueError, match=r"camera|rotation|size"):
        replace(SIDE_BY_SIDE, **wrong)  # type: ignore[arg-type]
