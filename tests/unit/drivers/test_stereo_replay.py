"""Recorded stereo pairs: the manifest, what is wrong with it, and the pairs in their order."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from drivers.base import EndOfRecording, RecordingBroken, SensorLost
from drivers.stereo.replay import PairReplay, pair_folder, read_pair

MANIFEST: dict[str, Any] = {
    "width": 32,
    "height": 20,
    "focal_px": 100.0,
    "baseline_mm": 29.0,
    "pairs": [{"left": "a_L.png", "right": "a_R.png", "pipe": "A", "end": "Front"}, {"left": "b_L.png", "right": "b_R.png"}],
}


def write(folder: Path, manifest: Any, size: tuple[int, int] = (20, 32)) -> Path:
    (folder / "manifest.json").write_text(json.dumps(manifest))
    for name, value in (("a_L", 10), ("a_R", 20), ("b_L", 30), ("b_R", 40)):
        cv2.imwrite(str(folder / f"{name}.png"), np.full((*size, 3), value, np.uint8))
    return folder


def test_a_pair_is_read_with_its_rig(tmp_path: Path) -> None:
    folder = pair_folder(write(tmp_path, MANIFEST))
    frame = read_pair(folder, folder.pairs[0])
    assert (frame.left[0, 0, 0], frame.right[0, 0, 0]) == (10, 20)
    assert frame.intrinsics.fx == 100.0
    assert frame.baseline_m == pytest.approx(0.029)
    assert (frame.intrinsics.ppx, frame.intrinsics.ppy) == (15.5, 9.5)  # the middle, counting pixels from their centres
    assert frame.offset_px is None  # nobody has said that there is none
    assert (folder.pairs[0].pipe, folder.pairs[0].end, folder.pairs[1].pipe) == ("A", "Front", "")


def test_what_the_manifest_knows_more_is_used(tmp_path: Path) -> None:
    known = {"disparity_offset_px": 3, "disparity_offset_std_px": 0.2, "scale_std": 0.004}
    folder = pair_folder(write(tmp_path, MANIFEST | {"principal_px": [12, 8.5]} | known))
    assert (folder.intrinsics.ppx, folder.intrinsics.ppy, folder.offset_px) == (12.0, 8.5, 3.0)
    frame = read_pair(folder, folder.pairs[0])
    assert (frame.offset_px, frame.offset_std_px, frame.scale_std) == (3.0, 0.2, 0.004)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"pairs": []}, "names no pair"),
        ({"pairs": "all"}, "no list of pairs"),
        ({"pairs": [{"left": "a_L.png"}]}, "pair 0 names no right picture"),
        ({"pairs": [{"left": "../a_L.png", "right": "a_R.png"}]}, "outside its folder"),
        ({"pairs": [{"left": "/etc/passwd", "right": "a_R.png"}]}, "outside its folder"),
        ({"pairs": [7]}, "pair 0 is not an object"),
        ({"width": 32.5}, "no sound width"),
        ({"height": True}, "no sound height"),
        ({"focal_px": -1}, "no sound focal_px"),
        ({"focal_px": 10**400}, "no sound focal_px"),  # JSON may; a float does not hold it
        ({"baseline_mm": "29"}, "no sound baseline_mm"),
        ({"principal_px": [1]}, "principal_px"),
        ({"disparity_offset_px": "x"}, "disparity_offset_px"),
        ({"disparity_offset_px": 10**400}, "disparity_offset_px"),
        ({"disparity_offset_px": 3, "scale_std": -1}, "no sound scale_std"),
    ],
)
def test_a_broken_manifest_is_refused_in_one_sentence(tmp_path: Path, change: dict[str, Any], says: str) -> None:
    write(tmp_path, MANIFEST | change)
    with pytest.raises(RecordingBroken, match=says):
        pair_folder(tmp_path)


def test_folders_that_are_none(tmp_path: Path) -> None:
    with pytest.raises(RecordingBroken, match="There is no folder"):
        pair_folder(tmp_path / "nowhere")
    with pytest.raises(RecordingBroken, match=r"has no manifest\.json"):
        pair_folder(tmp_path)
    (tmp_path / "manifest.json").write_text("{")
    with pytest.raises(RecordingBroken, match="cannot be read"):
        pair_folder(tmp_path)


def test_pictures_of_another_size_are_refused(tmp_path: Path) -> None:
    folder = pair_folder(write(tmp_path, MANIFEST, size=(10, 16)))
    with pytest.raises(RecordingBroken, match="16 x 10, its manifest says 32 x 20"):
        read_pair(folder, folder.pairs[0])


def test_pairs_come_in_order_a_broken_one_is_passed_and_the_end_is_told(tmp_path: Path) -> None:
    write(tmp_path, MANIFEST)
    (tmp_path / "a_R.png").write_bytes(b"no picture")
    camera = PairReplay(tmp_path)
    with pytest.raises(SensorLost):
        camera.read()
    camera.open()
    with pytest.raises(RecordingBroken, match=r"a_R\.png"):
        camera.read()
    assert (camera.read().source, camera.name) == ("b_L.png", f"recording {tmp_path.name}")
    with pytest.raises(EndOfRecording):
        camera.read()
    camera.close()
    camera.close()
