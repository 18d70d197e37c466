"""From settings and options to a stereo camera: which there are, what they need, what is refused in one sentence."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from device.anomaly import looking as looking_module
from device.anomaly.calibration import BoardCalibration, RigSource, load_calibration, save_calibration
from device.anomaly.looking import looking
from device.anomaly.rig import make_stereo
from device.config import StereoSettings, load_settings
from device.doctor import examine
from device.errors import Invalid
from device.feeds.feed import StereoFeed
from drivers.base import RecordingBroken, SensorMissing
from drivers.stereo.base import StereoCamera, StereoFrame
from drivers.stereo.rectifier import Rectifier
from drivers.stereo.replay import pair_folder, read_pair
from drivers.stereo.two_cameras import TwoCameras
from drivers.virtual.profile import circular
from drivers.virtual.stereo_camera import StereoLens, StereoLook, StereoPainter, VirtualStereoCamera
from drivers.virtual.world import VirtualSewer
from estimators.pinhole import Intrinsics

LENS = {"fx": 100.0, "fy": 100.0, "ppx": 79.5, "ppy": 49.5, "coeffs": [-0.1, 0.0, 0.0, 0.0, 0.0]}
BOARD: dict[str, Any] = {
    "width": 160,
    "height": 100,
    "left": LENS,
    "right": LENS,
    "rotation": [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
    "translation_m": [-0.06, 0.0, 0.0],
    "reprojection_px": 0.1,
    "epipolar_px": 0.1,
    "offset_std_px": 0.05,
    "scale_std": 0.001,
    "views": 20,
    "board": "charuco 11 x 8, 30 mm",
}


def settings(**given: Any) -> StereoSettings:
    return StereoSettings.model_validate(given)


def made(**given: Any) -> Any:
    eye = make_stereo(settings(**given), 1, lambda: None)
    assert eye is not None
    return eye


@pytest.fixture
def board(tmp_path: Path) -> Path:
    path = tmp_path / "board.json"
    save_calibration(path, BoardCalibration.model_validate(BOARD))
    return path


def test_a_calibration_of_two_lenses_is_written_and_read_like_that_of_a_pipe(board: Path) -> None:
    found = load_calibration(board)
    assert isinstance(found, BoardCalibration)
    assert found.lenses().left.coeffs[0] == -0.1
    assert found.calibrated().offset_std_px == 0.05


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"rotation": [1.0] * 9}, "rotation"),
        ({"translation_m": [0.06, 0.0, 0.0]}, "right of the left"),
        ({"width": 0}, "width"),
        ({"left": {**LENS, "coeffs": [0.0]}}, "left.coeffs"),
        ({"left": {**LENS, "ppx": float("nan")}}, "left.ppx"),
        ({"left": {**LENS, "coeffs": [0.0, 0.0, 0.0, 0.0, 1e18]}}, "file"),  # no picture can be rectified with it
        ({"more": 1}, "more"),
    ],
)
def test_a_broken_calibration_of_two_lenses_is_refused_in_one_sentence(board: Path, change: dict[str, Any], says: str) -> None:
    board.write_text(json.dumps({**BOARD, "kind": "board", **change}))
    with pytest.raises(Invalid, match=f"is not one of two lenses: .*{says}"):
        load_calibration(board)


def test_two_plain_cameras_are_made_of_their_devices_and_their_calibration(board: Path) -> None:
    eye = made(driver="pair", left="/dev/video0", right="/dev/video2", calibration=board, options={"fps": 10, "codec": "MJPG"})
    assert isinstance(eye.feed._make(), TwoCameras)
    frame = Rectifier(eye.source.lenses).frame(*[np.zeros((100, 160, 3), np.uint8)] * 2, 1, 1, "")
    assert eye.lenses is not None
    sizes = [grabber._size for pair in (eye.lenses(), eye.feed._make()._grabbers) for grabber in pair._both]
    assert sizes == [frame.intrinsics.size] * 4, "a new calibration is of pictures as large as those that are rectified"
    rig = eye.source.rig(frame)
    assert (rig.offset_px, rig.offset_std_px, rig.scale_std) == (0.0, 0.05, 0.001)
    assert rig.baseline_m == pytest.approx(0.06)


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"driver": "pair", "left": "/dev/video0"}, "which two cameras"),
        ({"driver": "pair", "left": "/dev/video0", "right": "/dev/video0"}, "which two cameras"),
        ({"driver": "pair", "left": "/dev/video0", "right": "/dev/video1"}, "need a calibration by a board"),
        ({"driver": "realsense", "options": {"laser_power": 2}}, "Laser power must be between 0 and 1"),
        ({"driver": "oak", "options": {"colour": 1}}, "does not know all of its options: colour"),
        ({"driver": "replay"}, "which folder"),
    ],
)
def test_settings_that_cannot_be_are_told_at_once(given: dict[str, Any], says: str) -> None:
    with pytest.raises(Invalid, match=says) as caught:
        made(**given)
    assert str(caught.value).endswith(".")


def test_a_camera_that_rectifies_by_itself_takes_no_calibration_of_lenses(board: Path) -> None:
    with pytest.raises(Invalid, match="rectifies by itself"):
        made(driver="oak", calibration=board)


def test_one_camera_is_not_both_depth_and_stereo_camera(tmp_path: Path) -> None:
    file = tmp_path / "borescout.toml"
    for driver, serial, cameras, refused in (
        ("oak", "", '["oak"]', True),
        ("oak", 'options = {serial = "2"}', '["oak"]', False),
        ("oak", "", '["realsense"]', False),
        ("oak", "", "[]", False),
    ):
        file.write_text(f'cameras = {cameras}\n[stereo]\ndriver = "{driver}"\n{serial}\n')
        if refused:
            with pytest.raises(Invalid, match="cannot give depth and stereo pairs at once"):
                load_settings(file)
        else:
            assert load_settings(file).stereo.driver == driver


def test_pairs_as_the_lenses_threw_them_are_replayed_rectified(tmp_path: Path, board: Path) -> None:
    ramp = np.broadcast_to(np.arange(160, dtype=np.uint8)[None, :, None], (100, 160, 3))
    for side in "LR":
        cv2.imwrite(str(tmp_path / f"{side}.png"), ramp)
    pairs = [{"left": "L.png", "right": "R.png"}]
    (tmp_path / "manifest.json").write_text(json.dumps({"rectified": False, "width": 160, "height": 100, "pairs": pairs}))
    with pytest.raises(RecordingBroken, match="need a calibration of their two lenses"):
        pair_folder(tmp_path)
    source = RigSource(load_calibration(board))
    folder = pair_folder(tmp_path, source.lenses)
    frame = read_pair(folder, folder.pairs[0])
    assert frame.offset_px == 0.0
    assert source.rig(frame).offset_std_px == 0.05
    assert not np.array_equal(frame.left, ramp), "the lens bends, so its pictures are turned"
    eye = made(driver="replay", source=tmp_path, calibration=board)
    assert eye.feed.name == f"recording {tmp_path.name}"
    rectified = {"width": 160, "height": 100, "focal_px": 100.0, "baseline_mm": 60.0, "pairs": pairs}
    (tmp_path / "manifest.json").write_text(json.dumps(rectified))
    with pytest.raises(RecordingBroken, match="rectified already"):
        pair_folder(tmp_path, source.lenses)


def test_doctor_says_whether_the_stereo_camera_can_be(tmp_path: Path, board: Path) -> None:
    def told(text: str) -> Any:
        file = tmp_path / "borescout.toml"
        file.write_text(text)
        given = load_settings(file, data_dir=tmp_path / "data", port=0)
        return [finding for finding in examine(given) if finding.what == "stereo camera"]

    assert told("") == []
    pair = f'[stereo]\ndriver = "pair"\nleft = "{board}"\nright = "/nowhere/video2"\n'
    (missing,) = told(pair)
    assert (missing.state, "by a board" in missing.found) == ("fault", True)
    (gone,) = told(pair + f'calibration = "{board}"\n')
    assert (gone.state, gone.found) == ("fault", "/nowhere/video2 not there")
    (there,) = told(pair.replace("/nowhere/video2", str(tmp_path)) + f'calibration = "{board}"\n')
    assert (there.state, there.found) == ("ok", "pair, calibrated")
    (unknown,) = told(pair.replace("/nowhere/video2", str(tmp_path)) + f'calibration = "{tmp_path / "none.json"}"\n')
    assert (unknown.state, "/anomaly/calibrate" in unknown.remedy) == ("fault", True)


class Missing(StereoCamera):
    """A camera that is not plugged in."""

    def _open(self) -> None:
        raise SensorMissing("No stereo camera is plugged in.")

    def _read(self, timeout_s: float) -> StereoFrame:
        raise AssertionError("it was never opened")

    def close(self) -> None: ...


def small_camera() -> VirtualStereoCamera:
    lens = StereoLens(Intrinsics(64, 40, 37.0, 37.0, 31.5, 19.5), 0.06)
    painter = StereoPainter(VirtualSewer(circular(0.4), 4.0), lens, StereoLook(), 3)
    return VirtualStereoCamera(painter, dwell=1000, rate_hz=30.0)


def test_a_live_camera_is_looked_at_as_often_as_was_asked(capsys: pytest.CaptureFixture[str]) -> None:
    camera = small_camera()
    feed = StereoFeed("twin", "virtual", lambda: camera)
    try:
        found = [frame for _, frame in looking(feed, 3)]
    finally:
        feed.close()
    numbers = [frame.number for frame in found if isinstance(frame, StereoFrame)]
    assert numbers == sorted(set(numbers))
    assert len(numbers) == 3
    assert "Ctrl-C" in capsys.readouterr().err


def test_without_a_camera_it_says_so_and_ends() -> None:
    feed = StereoFeed("stereo camera", "oak", Missing)
    try:
        with pytest.raises(Invalid, match="No stereo camera is plugged in"):
            list(looking(feed, 1))
    finally:
        feed.close()


def test_one_that_falls_silent_for_good_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(looking_module, "SILENCE_S", 0.5)
    camera = small_camera()
    feed = StereoFeed("twin", "virtual", lambda: camera)
    try:
        pairs = looking(feed, None)
        next(pairs)
        camera.faults.trigger("disconnect")
        with pytest.raises(Invalid, match="Nothing comes from the twin"):
            list(pairs)
    finally:
        feed.close()
