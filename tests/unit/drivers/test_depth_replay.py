"""Recordings in place of a camera: folders with a manifest, .db3 and .bag files."""

from __future__ import annotations

import json
import shutil
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from drivers.base import EndOfRecording, FrameTimeout, RecordingBroken, SensorLost
from drivers.depth.base import DepthCamera
from drivers.depth.replay import ReplayCamera, manifest_entries, manifest_recordings, read_entry
from estimators.pinhole import Intrinsics
from tests.unit.drivers.depth_camera_contract import READ_S, RecordingContract, Rig

LENS = Intrinsics(64, 48, 60.0, 61.0, 31.5, 23.5, "brown_conrady", (0.1, -0.05, 0.001, 0.002, 0.01))
BAG = Path(__file__).parents[2] / "data" / "software_device.bag"
"""Four frames of a software device, written by pyrealsense2 2.55 (later ones write .db3 alone): frame n is n mm everywhere."""


def entry(depth: str = "a/depth_emitter_on.png", **changes: Any) -> dict[str, Any]:
    intrinsics = {"width": 64, "height": 48, "fx": 60.0, "fy": 61.0, "ppx": 31.5, "ppy": 23.5, "model": "brown_conrady"}
    intrinsics["coeffs"] = list(LENS.coeffs)
    intrinsics.update(changes.pop("intrinsics", {}))
    found = {
        "depth": depth,
        "recording": "run 1",
        "depth_unit_m": 0.001,
        "intrinsics": intrinsics,
        "wall_visible": "not for us",
    }
    return {**found, **changes}


def write_depth(path: Path, value: int = 700, size: tuple[int, int] = (64, 48), dtype: Any = np.uint16) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), np.full((size[1], size[0]), value, dtype))


def make_folder(folder: Path, frames: int = 3) -> Path:
    """A folder of ``frames`` depth pictures, the n-th of them n everywhere."""
    entries = []
    for number in range(1, frames + 1):
        name = f"a/depth_{number}.png"
        write_depth(folder / name, number)
        entries.append(entry(name))
    (folder / "manifest.json").write_text(json.dumps(entries))
    return folder


class ReplayRig(Rig):
    def __init__(self, source: Path) -> None:
        self.camera = ReplayCamera(source, loop=True)
        self.intrinsics = LENS

    def close(self) -> None:
        self.camera.close()


class TestFolder(RecordingContract):
    frames_in_recording = 3

    @pytest.fixture
    def rig(self, tmp_path: Path) -> Iterator[Rig]:
        made = ReplayRig(make_folder(tmp_path))
        yield made
        made.close()

    @pytest.fixture
    def once(self, tmp_path: Path) -> DepthCamera:
        return ReplayCamera(make_folder(tmp_path))


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A .db3 of five frames, written here by pyrealsense2 from its software device."""
    pytest.importorskip("pyrealsense2", reason="pyrealsense2 is not installed")
    from tests.unit.drivers.software_camera import record

    path = tmp_path_factory.mktemp("db3") / "run.db3"
    record(path, 5, LENS)
    return path


class TestDb3(RecordingContract):
    frames_in_recording = 5

    @pytest.fixture
    def rig(self, recorded: Path) -> Iterator[Rig]:
        made = ReplayRig(recorded)
        yield made
        made.close()

    @pytest.fixture
    def once(self, recorded: Path) -> Iterator[DepthCamera]:
        camera = ReplayCamera(recorded)
        yield camera
        camera.close()


class TestOldBag(RecordingContract):
    frames_in_recording = 4

    @pytest.fixture
    def rig(self) -> Iterator[Rig]:
        pytest.importorskip("pyrealsense2", reason="pyrealsense2 is not installed")
        made = ReplayRig(BAG)
        yield made
        made.close()

    @pytest.fixture
    def once(self) -> Iterator[DepthCamera]:
        pytest.importorskip("pyrealsense2", reason="pyrealsense2 is not installed")
        camera = ReplayCamera(BAG)
        yield camera
        camera.close()

    def test_every_picture_is_the_one_that_was_recorded(self, once: DepthCamera) -> None:
        once.open()
        assert [np.unique(once.read(READ_S).depth).tolist() for _ in range(4)] == [[1], [2], [3], [4]]


@pytest.mark.parametrize("pixels", ["bgr8", "rgb8"])
def test_colour_of_a_recording_is_blue_first_however_it_was_recorded(tmp_path: Path, pixels: str) -> None:
    rs = pytest.importorskip("pyrealsense2", reason="pyrealsense2 is not installed")
    from tests.unit.drivers.software_camera import record

    path = tmp_path / "run.db3"
    record(path, 6, LENS, getattr(rs.format, pixels))
    camera = ReplayCamera(path)
    camera.open()
    try:
        colors = [color for color in (camera.read(READ_S).color for _ in range(4)) if color is not None]
    finally:
        camera.close()
    assert colors
    assert colors[-1][0, 0].tolist() == ([255, 0, 0] if pixels == "bgr8" else [0, 0, 255])


def test_frames_name_their_picture(tmp_path: Path) -> None:
    camera = ReplayCamera(make_folder(tmp_path))
    camera.open()
    assert [camera.read().source for _ in range(3)] == ["a/depth_1.png", "a/depth_2.png", "a/depth_3.png"]


def test_colour_lies_beside_its_depth(tmp_path: Path) -> None:
    write_depth(tmp_path / "a/depth_emitter_on.png")
    (tmp_path / "manifest.json").write_text(json.dumps([entry()]))
    chosen = manifest_entries(tmp_path)[0]
    assert read_entry(tmp_path, chosen).color is None
    blue = np.zeros((30, 40, 3), np.uint8)
    blue[..., 0] = 255
    cv2.imwrite(str(tmp_path / "a/color_emitter_on.png"), blue)
    color = read_entry(tmp_path, chosen).color
    assert color is not None
    assert np.array_equal(color, blue)
    (tmp_path / "a/color_emitter_on.png").write_bytes(b"no picture")
    assert read_entry(tmp_path, chosen).color is None


def test_recordings_keep_the_order_of_the_manifest(tmp_path: Path) -> None:
    entries = [
        entry("b/depth.png", recording="two"),
        entry("a/depth.png", recording="one"),
        entry("c/depth.png", recording="two"),
    ]
    (tmp_path / "manifest.json").write_text(json.dumps(entries))
    found = manifest_recordings(tmp_path)
    assert [(name, [item.depth for item in items]) for name, items in found.items()] == [
        ("two", ["b/depth.png", "c/depth.png"]),
        ("one", ["a/depth.png"]),
    ]


def test_without_a_name_a_recording_is_its_folder(tmp_path: Path) -> None:
    nameless = entry("pipe/run/depth.png")
    del nameless["recording"]
    (tmp_path / "manifest.json").write_text(json.dumps([nameless]))
    assert list(manifest_recordings(tmp_path)) == ["pipe/run"]


def test_one_recording_can_be_chosen(tmp_path: Path) -> None:
    for name in "abc":
        write_depth(tmp_path / f"{name}/depth.png")
    entries = [entry(f"{name}/depth.png", recording=name) for name in "abc"]
    (tmp_path / "manifest.json").write_text(json.dumps(entries))
    camera = ReplayCamera(tmp_path, recording="b")
    camera.open()
    assert camera.read().source == "b/depth.png"
    with pytest.raises(EndOfRecording):
        camera.read()
    with pytest.raises(RecordingBroken, match="no recording x"):
        ReplayCamera(tmp_path, recording="x").open()


def test_the_rate_is_kept(tmp_path: Path) -> None:
    camera = ReplayCamera(make_folder(tmp_path), rate_hz=20, loop=True)
    camera.open()
    camera.read()
    started = time.monotonic()
    for _ in range(6):
        camera.read()
    assert 0.29 < time.monotonic() - started < 1.5


def test_a_late_reader_gets_no_burst(tmp_path: Path) -> None:
    camera = ReplayCamera(make_folder(tmp_path), rate_hz=10, loop=True)
    camera.open()
    camera.read()
    time.sleep(0.5)
    camera.read()
    started = time.monotonic()
    camera.read()
    camera.read()
    assert time.monotonic() - started > 0.1


def test_a_slow_recording_times_out_and_goes_on(tmp_path: Path) -> None:
    camera = ReplayCamera(make_folder(tmp_path), rate_hz=2)
    camera.open()
    assert camera.read().source == "a/depth_1.png"
    started = time.monotonic()
    with pytest.raises(FrameTimeout):
        camera.read(0.1)
    assert time.monotonic() - started < 0.4
    assert camera.read(2.0).source == "a/depth_2.png"


def test_closing_wakes_a_waiting_reader(tmp_path: Path) -> None:
    camera = ReplayCamera(make_folder(tmp_path), rate_hz=0.1)
    camera.open()
    camera.read()
    threading.Timer(0.1, camera.close).start()
    started = time.monotonic()
    with pytest.raises(SensorLost):
        camera.read(20.0)
    assert time.monotonic() - started < 5.0


@pytest.mark.parametrize("rate", [0, -1, float("nan"), float("inf")])
def test_an_impossible_rate_is_refused(tmp_path: Path, rate: float) -> None:
    with pytest.raises(ValueError, match="rate"):
        ReplayCamera(tmp_path, rate_hz=rate)


BROKEN_MANIFESTS = {
    "no JSON": "[{",
    "not a list": '{"depth": "a.png"}',
    "empty": "[]",
    "entry is no object": "[1]",
    "nested beyond reason": "[" * 100_000,
    "no depth": json.dumps([{**entry(), "depth": None}]),
    "climbs out": json.dumps([entry("../../etc/depth.png")]),
    "climbs out the Windows way": json.dumps([entry("..\\depth.png")]),
    "absolute": json.dumps([entry("/etc/depth.png")]),
    "another drive": json.dumps([entry("C:\\depth.png")]),
    "a null byte": json.dumps([entry("a\0.png")]),
    "no unit": json.dumps([{**entry(), "depth_unit_m": None}]),
    "no positive unit": json.dumps([entry(depth_unit_m=0)]),
    "a unit of NaN": json.dumps([entry(depth_unit_m=float("nan"))]),
    "a unit that is true": json.dumps([entry(depth_unit_m=True)]),
    "no intrinsics": json.dumps([{**entry(), "intrinsics": None}]),
    "fx of NaN": json.dumps([entry(intrinsics={"fx": float("nan")})]),
    "ppx of NaN": json.dumps([entry(intrinsics={"ppx": float("nan")})]),
    "fy of infinity": json.dumps([entry(intrinsics={"fy": float("inf")})]),
    "fx of zero": json.dumps([entry(intrinsics={"fx": 0})]),
    "fx that is text": json.dumps([entry(intrinsics={"fx": "60"})]),
    "fx beyond a float": json.dumps([entry(intrinsics={"fx": 10**400})]),
    "no width": json.dumps([entry(intrinsics={"width": None})]),
    "half a pixel of height": json.dumps([entry(intrinsics={"height": 47.5})]),
    "no width at all": json.dumps([entry(intrinsics={"width": 0})]),
    "unknown model": json.dumps([entry(intrinsics={"model": "crystal ball"})]),
    "model that is a list": json.dumps([entry(intrinsics={"model": []})]),
    "too many coefficients": json.dumps([entry(intrinsics={"coeffs": [0.0] * 14})]),
    "coefficients of NaN": json.dumps([entry(intrinsics={"coeffs": [float("nan")]})]),
    "recording that is a number": json.dumps([entry(recording=5)]),
}


@pytest.mark.parametrize("text", BROKEN_MANIFESTS.values(), ids=BROKEN_MANIFESTS.keys())
def test_a_broken_manifest_is_one_sentence(tmp_path: Path, text: str) -> None:
    (tmp_path / "manifest.json").write_text(text)
    with pytest.raises(RecordingBroken, match=r"manifest\.json") as caught:
        ReplayCamera(tmp_path).open()
    assert str(caught.value).endswith(".")
    assert "\n" not in str(caught.value)


def test_a_manifest_that_is_no_text_is_broken(tmp_path: Path) -> None:
    (tmp_path / "manifest.json").write_bytes(b"\xff\xfe\x00[")
    with pytest.raises(RecordingBroken, match=r"manifest\.json"):
        ReplayCamera(tmp_path).open()


def test_missing_folders_manifests_and_files_are_named(tmp_path: Path) -> None:
    for source, named in ((tmp_path / "gone", "gone"), (tmp_path, "manifest"), (tmp_path / "gone.db3", "gone.db3")):
        with pytest.raises(RecordingBroken, match=named):
            ReplayCamera(source).open()


def test_a_damaged_db3_is_broken(tmp_path: Path) -> None:
    pytest.importorskip("pyrealsense2", reason="pyrealsense2 is not installed")
    for name in ("run.db3", "run.bag"):
        path = tmp_path / name
        path.write_text("not a recording")
        with pytest.raises(RecordingBroken, match=name):
            ReplayCamera(path).open()


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda path: path.unlink(), "missing"),
        (lambda path: path.write_bytes(b""), "not a picture"),
        (lambda path: path.write_bytes(path.read_bytes()[:60]), "not a picture"),
        (lambda path: write_depth(path, 7, dtype=np.uint8), "8 bits"),
        (lambda path: cv2.imwrite(str(path), np.zeros((48, 64, 3), np.uint16)), "3 channel"),
        (lambda path: write_depth(path, size=(48, 64)), "48 x 64"),
        (lambda path: (path.unlink(), path.mkdir()), "missing"),
    ],
    ids=["missing", "empty", "cut off", "8 bits", "three channels", "wrong size", "a folder"],
)
def test_a_broken_picture_is_named_and_then_left_behind(tmp_path: Path, spoil: Any, said: str) -> None:
    make_folder(tmp_path)
    spoil(tmp_path / "a/depth_2.png")
    camera = ReplayCamera(tmp_path)
    camera.open()
    camera.read()
    with pytest.raises(RecordingBroken, match=r"depth_2\.png") as caught:
        camera.read()
    assert said in str(caught.value)
    assert camera.read().source == "a/depth_3.png"


def test_real_recordings_play(data_dir: Path) -> None:
    folder = data_dir / "realsense_pipes"
    camera = ReplayCamera(folder)
    camera.open()
    entries = manifest_entries(folder)
    frames = [camera.read() for _ in entries]
    assert [frame.source for frame in frames] == [item.depth for item in entries]
    assert sum(frame.depth.any() for frame in frames) > len(frames) // 2
    assert any(frame.color is not None for frame in frames)
    with pytest.raises(EndOfRecording):
        camera.read()


def test_replay_reads_nothing_it_is_not_told_to(data_dir: Path, tmp_path: Path) -> None:
    """The same frames come out where the manifest has lost everything but its four fields."""
    folder = data_dir / "realsense_pipes"
    full = json.loads((folder / "manifest.json").read_text())[:2]
    for item in full:
        (tmp_path / item["depth"]).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(folder / item["depth"], tmp_path / item["depth"])
    kept = ("depth", "recording", "depth_unit_m", "intrinsics")
    (tmp_path / "manifest.json").write_text(json.dumps([{key: item[key] for key in kept} for item in full]))
    for bare, whole in zip(manifest_entries(tmp_path), manifest_entries(folder), strict=False):
        assert bare == whole
        assert np.array_equal(read_entry(tmp_path, bare).depth, read_entry(folder, whole).depth)
