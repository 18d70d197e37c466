"""What ``borescout recordings`` prints, changes and leaves alone."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from device.cli import _run
from device.recorder import Recorder
from device.recorder.names import Name
from drivers.depth.replay import manifest_entries, read_entry
from tests.unit.device.recorder_samples import cctv, depth_frame, reading, recording


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A data folder with a whole recording and a torn one."""
    inside = tmp_path / "recordings"
    recording(inside, 3, survey=1)
    torn = recording(inside, 3, survey=2)
    torn.write_bytes(torn.read_bytes()[:-2000])
    return tmp_path


def test_check_says_of_each_file_whether_it_is_whole(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for where in (folder, folder / "recordings"):
        assert _run(["recordings", "check", str(where), "--json"]) == 1
        whole, torn = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
        assert (whole["ok"], whole["recovered"], whole["lost_seconds"], whole["state"]) == (True, False, 0, "whole")
        assert (torn["ok"], torn["recovered"], torn["state"]) == (False, True, "torn")
        assert 0 <= torn["lost_seconds"] < 1
        assert torn["file"] == "survey-000002-01-001.mcap"
    assert _run(["recordings", "check", str(folder)]) == 1
    assert "can be recovered" in capsys.readouterr().out.splitlines()[1]


def test_recover_makes_them_whole(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert _run(["recordings", "recover", str(folder), "--json"]) == 0
    assert [json.loads(line)["ok"] for line in capsys.readouterr().out.splitlines()] == [True, True]
    assert _run(["recordings", "check", str(folder), "--json"]) == 0
    again = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [one["recovered"] for one in again] == [False, True]


def test_garbage_is_told_and_left(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    garbage = folder / "recordings" / "survey-000003-01-001.mcap"
    garbage.write_bytes(bytes(100_000))
    assert _run(["recordings", "recover", str(folder), "--json"]) == 1
    out, err = capsys.readouterr()
    assert json.loads(out.splitlines()[-1])["ok"] is False
    assert err.count("\n") == 1
    assert garbage.read_bytes() == bytes(100_000)


def test_list_and_prune(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert _run(["recordings", "list", str(folder), "--json"]) == 0
    files = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [one["file"] for one in files] == ["survey-000001-01-001.mcap", "survey-000002-01-001.mcap"]
    assert all(one["bytes"] > 0 for one in files)
    assert _run(["recordings", "prune", str(folder), "--most", "0"]) == 0
    assert capsys.readouterr().out.splitlines() == [f"removed {one['file']}" for one in files]
    assert list((folder / "recordings").iterdir()) == []


@pytest.mark.parametrize(
    "arguments",
    [
        ["check", "nowhere"],
        ["prune", "."],
        ["prune", ".", "--most", "-1"],
        ["export", "nowhere.mcap"],
        ["export", "."],
    ],
)
def test_bad_input_is_one_sentence(
    arguments: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert _run(["recordings", *arguments]) == 2
    assert capsys.readouterr().err.startswith("borescout: ")


def test_export_is_read_by_the_replay_camera(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    recorder = Recorder(tmp_path, Name(5, 1, 1), {"kind": "diameter"}).open()
    frames = [depth_frame(1), depth_frame(2)]
    for frame in frames:
        recorder.write("/camera/a", frame)
    recorder.write("/grabber/b", cctv(7))
    recorder.write("/tether", reading(3))
    recorder.write("/survey/steps", {"frame": 7})
    recorder.close()
    out = tmp_path / "out"
    assert _run(["recordings", "export", str(tmp_path / "survey-000005-01-001.mcap"), "--to", str(out), "--clouds"]) == 0
    assert "2 depth pictures" in capsys.readouterr().out
    entries = manifest_entries(out)
    for frame, entry in zip(frames, entries, strict=True):
        back = read_entry(out, entry)
        assert np.array_equal(back.depth, frame.depth)
        assert back.intrinsics == frame.intrinsics
        assert back.depth_unit_m == frame.depth_unit_m
    assert (out / "grabber-b" / "00000007.jpg").read_bytes() == cctv(7).jpeg
    with (out / "tether.csv").open() as table:
        (row,) = list(csv.DictReader(table))
    assert (float(row["value"]), row["unit"], row["media_s"]) == (pytest.approx(0.3), "m", "")
    assert json.loads((out / "notes.jsonl").read_text().splitlines()[-1])["told"] == {"frame": 7}
    assert cv2.imread(str(out / json.loads((out / "manifest.json").read_text())[0]["color"])) is not None
    with (out / "clouds.mcap").open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        clouds: list[PointCloud] = [message for *_, message in reader.iter_decoded_messages(topics=["/camera/a/points"])]
    points = np.frombuffer(clouds[0].data, "<f4").reshape(-1, 3)
    seen = frames[0].depth[::2, ::2]
    assert len(clouds) == 2
    assert len(points) == np.count_nonzero(seen)
    assert points[0, 2] == pytest.approx(seen[seen > 0][0] * 0.001)
    assert _run(["recordings", "export", str(tmp_path / "survey-000005-01-001.mcap"), "--to", str(out)]) == 2
