"""``borescout map``: what it prints, and in what words it refuses."""

from __future__ import annotations

import csv
import json
import math
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from device.cli import main
from estimators.landmarks.projection import PipeCamera, View, clock_hour, project

RIG = {"fx": 460.0, "fy": 460.0, "cx": 359.5, "cy": 287.5, "radius_m": 0.15, "width": 720, "height": 576}
CAMERA = PipeCamera(RIG["fx"], RIG["fy"], RIG["radius_m"], 720, 576)
TRUTH = (("connection", 2.0, -2.4), ("connection", 3.6, 0.3), ("roots", 5.1, 2.5))


def run(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as left:
        main(["map", *arguments])
    told = capsys.readouterr()
    return int(left.value.code or 0), told.out, told.err


def refusal(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    """The one sentence with which it refuses."""
    status, out, err = run(capsys, *arguments)
    assert status == 2
    assert out == ""
    lines = [line for line in err.splitlines() if line]
    assert len(lines) == 1, err
    assert lines[0].startswith("borescout: ")
    assert lines[0].endswith("."), lines[0]
    return lines[0]


def write_detections(
    path: Path, noise_px: float = 3.0, seed: int = 2, step: float = 0.001, jump: tuple[int, float] = (999, 0.0), **extra: float
) -> None:
    """A drive of 6 m at 0.25 m/s, 10 frames a second, through ``TRUTH``, by a counter that shows each ``step`` (m); from frame
    ``jump[0]`` on it shows ``jump[1]`` (m) more."""
    rng = np.random.default_rng(seed)
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["frame", "time_s", "chainage_m", "u", "v", "class", "score", *extra])
        for frame in range(240):
            where = 0.025 * frame
            view = View(where, (RIG["cx"], RIG["cy"]))
            rows: list[list[Any]] = []
            for label, chainage, angle in TRUTH:
                if 0.15 < chainage - where < 1.6:
                    u, v = project(CAMERA, view, np.array([[chainage, angle]]))[0] + rng.normal(0, noise_px, 2)
                    if 0 < u < 720 and 0 < v < 576:
                        rows.append([f"{u:.1f}", f"{v:.1f}", label, 0.9])
            shown = round(where / step) * step + (jump[1] if frame >= jump[0] else 0.0)
            for row in rows or [["", "", "", ""]]:
                writer.writerow([frame, f"{frame / 10:.2f}", f"{shown:.3f}", *row, *extra.values()])


@pytest.fixture
def table(tmp_path: Path) -> tuple[Path, Path]:
    detections, rig = tmp_path / "seen.csv", tmp_path / "rig.json"
    write_detections(detections)
    rig.write_text(json.dumps(RIG))
    return detections, rig


@pytest.mark.parametrize(("step", "jump"), [(0.001, (160, -2.0)), (0.1, (60, 35.0))])
def test_a_counter_that_jumps_is_a_fault_and_the_map_goes_on(
    capsys: pytest.CaptureFixture[str], table: tuple[Path, Path], step: float, jump: tuple[int, float]
) -> None:
    write_detections(table[0], step=step, jump=jump)
    _, out, _ = run(capsys, "--detections", str(table[0]), "--rig", str(table[1]), "--json")
    found = json.loads(out)
    (fault,) = found["faults"]
    assert fault["what"] == "encoder_jump"
    assert fault["time_s"] == jump[0] / 10
    assert fault["chainage_m"] == pytest.approx(0.025 * jump[0], abs=0.06)
    assert f"jumped by {jump[1]:+.1f}" in fault["text"]
    assert [one["class"] for one in found["landmarks"]] == [label for label, _, _ in TRUTH]
    for ours, (_, chainage, _) in zip(found["landmarks"], TRUTH, strict=True):
        assert ours["chainage_m"] == pytest.approx(chainage, abs=0.03 + step / 2)
    assert (found["from_m"], found["to_m"]) == pytest.approx((0.0, 5.975), abs=0.03 + step)


def test_detections_become_one_json_object(capsys: pytest.CaptureFixture[str], table: tuple[Path, Path]) -> None:
    status, out, err = run(capsys, "--detections", str(table[0]), "--rig", str(table[1]), "--json")
    assert (status, err) == (0, "")
    found = json.loads(out)
    assert {"landmarks", "rings", "focal_radius", "frames", "seconds"} <= set(found)
    assert found["frames"] == 240
    assert found["focal_radius"]["value"] == pytest.approx(69.0)
    assert "sigma" in found["focal_radius"]
    assert [row["class"] for row in found["landmarks"]] == [label for label, _, _ in TRUTH]
    for row, (label, chainage, angle) in zip(found["landmarks"], TRUTH, strict=True):
        wanted = {"class", "chainage_m", "chainage_to_m", "clock", "clock_to", "sigma_chainage_m", "hits", "belief"}
        assert wanted <= set(row)
        assert row["chainage_m"] == pytest.approx(chainage, abs=0.05)
        assert abs((row["clock"] - clock_hour(angle) + 6) % 12 - 6) < 0.3
        assert row["belief"][label] > 0.5
        assert row["sigma_chainage_m"] > 0
        assert row["hits"] > 10


def test_for_people_there_is_a_table_and_a_picture(
    capsys: pytest.CaptureFixture[str], table: tuple[Path, Path], tmp_path: Path
) -> None:
    picture = tmp_path / "map.png"
    status, out, _ = run(capsys, "--detections", str(table[0]), "--rig", str(table[1]), "--picture", str(picture))
    assert status == 0
    assert "connection" in out
    assert "240 frames" in out
    assert cv2.imread(str(picture)) is not None


def test_a_principal_point_per_frame_is_used(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    detections, rig = tmp_path / "seen.csv", tmp_path / "rig.json"
    write_detections(detections, foe_u=RIG["cx"], foe_v=RIG["cy"])
    rig.write_text(json.dumps({**RIG, "cx": 250.0, "cy": 400.0}))  # far off, were it believed
    _, out, _ = run(capsys, "--detections", str(detections), "--rig", str(rig), "--json")
    assert [row["class"] for row in json.loads(out)["landmarks"]] == [label for label, _, _ in TRUTH]


@pytest.mark.parametrize(
    ("content", "word"),
    [
        ("", "is empty"),
        ("frame,time_s\n1,2\n", "lack the column chainage_m, u, v, class and score"),
        ("frame,time_s,chainage_m,u,v,class,score\n", "no row"),
        ("frame,time_s,chainage_m,u,v,class,score\n1,0.1,x,,,,\n", 'line 2: chainage_m is "x", which is no number'),
        ("frame,time_s,chainage_m,u,v,class,score\n1,0.1,,,,,\n", "line 2: chainage_m is empty"),
        ("frame,time_s,chainage_m,u,v,class,score\n1.5,0.1,1,,,,\n", "frame 1.5 is no whole number"),
        ("frame,time_s,chainage_m,u,v,class,score\n1e300,0.1,1,,,,\n", "there is no frame 1e+300"),
        ("frame,time_s,chainage_m,u,v,class,score\n1,0.1,1,,,,\n1,0.1,2,,,,\n", "Frame 1 has two chainages, 1 and 2"),
        ("frame,time_s,chainage_m,u,v,class,score\n1,0.1,1,5,,roots,1\n", "v is empty"),
        ("frame,time_s,chainage_m,u,v,class,score\n1,0.1,1,5,6,,1\n", "has no class"),
        ("frame,time_s,chainage_m,u,v,class,score\n1,0.1,inf,,,,\n", "chainage_m is"),
        ("frame,time_s,chainage_m,u,v,class,score,foe_u\n1,0.1,1,,,,,3\n", "foe_u and foe_v"),
        (b"\xff\xfe\x00\x01", "cannot be read as text"),
    ],
)
def test_a_bad_table_is_refused(
    capsys: pytest.CaptureFixture[str], table: tuple[Path, Path], content: str | bytes, word: str
) -> None:
    table[0].write_bytes(content if isinstance(content, bytes) else content.encode())
    assert word in refusal(capsys, "--detections", str(table[0]), "--rig", str(table[1]), "--json")


@pytest.mark.parametrize(
    ("content", "word"),
    [
        ("", "is empty"),
        ("{", "is no JSON"),
        ("[1]", "must be one JSON object"),
        (json.dumps({"fx": 1}), "lacks fy, cx, cy, radius_m, width and height"),
        (json.dumps({**RIG, "fx": "wide"}), "fx of the rig"),
        (json.dumps({**RIG, "radius_m": 0}), "must be a positive number"),
        (json.dumps({**RIG, "width": True}), "width of the rig"),
        (json.dumps({**RIG, "radius_m": 150}), "no pipe is that wide"),
        ('{"fx": NaN, "fy": 1, "cx": 1, "cy": 1, "radius_m": 1, "width": 1, "height": 1}', "fx of the rig"),
        (json.dumps({**RIG, "cy": 10**400}), "cy of the rig"),  # JSON may; a float does not hold it
    ],
)
def test_a_bad_rig_is_refused(capsys: pytest.CaptureFixture[str], table: tuple[Path, Path], content: str, word: str) -> None:
    table[1].write_text(content)
    assert word in refusal(capsys, "--detections", str(table[0]), "--rig", str(table[1]), "--json")


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        ((), "Say what to map"),
        (("--video", "a.mp4", "--stills", "b"), "Choose one of"),
        (("--video", "nowhere.mp4"), "There is no video"),
        (("--stills", "nowhere"), "There is no folder"),
        (("--detections", "a.csv"), "needs --rig"),
        (("--detections", "nowhere.csv", "--rig", "nowhere.json"), "There is no file"),
        (("--video", "a.mp4", "--rig", "b"), "--rig goes with --detections"),
        (("--video", "a.mp4", "--encoder", "qsb"), "--encoder goes with --grabber"),
        (("--grabber", "/dev/video9"), "Say what tells the distance"),
        (("--grabber", "/dev/video9", "--encoder", "qsb"), "Say with --port"),
        (("--virtual", "--osd"), "--osd goes with"),
        (("--video", "a.mp4", "--osd", "auto", "--distance-csv", "b"), "Choose one of --encoder"),
        (("--virtual", "--radius", "-1"), "--radius takes a positive number"),
        (("--virtual", "--length", "nan"), "--length takes a positive number"),
        (("--virtual", "--focal", "0", "5"), "--focal takes two positive numbers"),
    ],
)
def test_what_does_not_go_together_is_refused(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path, arguments: tuple[str, ...], word: str
) -> None:
    monkeypatch.chdir(tmp_path)
    assert word in refusal(capsys, *arguments)


def stills(folder: Path, count: int = 30, readable: bool = True) -> Path:
    """A drive along a striped pipe, a picture a second, at 0.1 m/s."""
    folder.mkdir()
    v, u = np.mgrid[0:288, 0:360].astype(np.float32)
    x, y = u - 179.5, v - 143.5
    depth = 50.0 / np.maximum(np.hypot(x, y), 8)
    rng = np.random.default_rng(1)
    wall = rng.uniform(60, 200, (400, 64)).astype(np.float32)
    column = ((np.arctan2(y, x) + math.pi) / (2 * math.pi) * 64).astype(int) % 64
    for k in range(count):
        picture = wall[((0.1 * k + depth) * 40).astype(int) % 400, column]
        file = folder / f"{1000 * k}.png"
        cv2.imwrite(str(file), np.repeat(picture.astype(np.uint8)[..., None], 3, axis=2))
        if not readable and k % 5 == 0:
            file.write_bytes(b"no picture")
    return folder


def distances(path: Path, count: int = 30, column: str = "time_s") -> Path:
    path.write_text(f"{column},distance_m\n" + "".join(f"{k},{0.1 * k:.1f}\n" for k in range(count)))
    return path


@pytest.mark.parametrize("column", ["time_s", "frame"])
def test_stills_with_their_distances_are_mapped(capsys: pytest.CaptureFixture[str], tmp_path: Path, column: str) -> None:
    folder, distance = stills(tmp_path / "stills"), distances(tmp_path / "d.csv", column=column)
    status, out, err = run(capsys, "--stills", str(folder), "--distance-csv", str(distance), "--json")
    assert (status, err) == (0, "")
    found = json.loads(out)
    assert (found["frames"], found["placed"]) == (30, 30)
    assert found["to_m"] == pytest.approx(2.9, abs=0.1)
    assert found["landmarks"] == []  # nobody looks for them before there is a detector


def test_a_recording_whose_counter_was_set_says_so_in_the_map(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    folder, distance = stills(tmp_path / "stills"), tmp_path / "d.csv"
    distance.write_text("time_s,distance_m\n" + "".join(f"{k},{0.1 * k - (9 if k >= 8 else 0):.1f}\n" for k in range(30)))
    status, out, err = run(capsys, "--stills", str(folder), "--distance-csv", str(distance), "--json")
    assert (status, err) == (0, "")
    found = json.loads(out)
    assert found["placed"] == 22
    (fault,) = [one for one in found["faults"] if one["what"] == "encoder_jump"]
    assert (fault["time_s"], fault["chainage_m"]) == (8.0, 0.7)
    assert "from 0.70 m to -8.20 m" in fault["text"]


def test_a_still_that_cannot_be_read_is_passed_over_with_a_sentence(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    folder = stills(tmp_path / "stills", readable=False)
    status, out, err = run(capsys, "--stills", str(folder), "--distance-csv", str(distances(tmp_path / "d.csv")), "--json")
    assert status == 0
    assert json.loads(out)["frames"] == 24
    assert err.count("is not a picture that can be read") == 6


def test_recordings_that_are_none_are_refused(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    empty = tmp_path / "empty"
    empty.mkdir()
    assert "no picture whose name" in refusal(capsys, "--stills", str(empty))
    text = tmp_path / "text.mp4"
    text.write_text("this is no video")
    assert "not a video that can be read" in refusal(capsys, "--video", str(text))
    folder = stills(tmp_path / "stills", count=3)
    bad = tmp_path / "bad.csv"
    bad.write_text("time_s,metres\n1,2\n")
    assert "distance_m" in refusal(capsys, "--stills", str(folder), "--distance-csv", str(bad))
    far = tmp_path / "far.csv"
    far.write_text("frame,distance_m\n500,2\n501,3\n")
    assert "of frames that the recording does not have" in refusal(capsys, "--stills", str(folder), "--distance-csv", str(far))


def test_ctrl_c_is_said_and_leaves_nothing(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from device.landmarks.pipeline import LandmarkPipeline

    def interrupted(*arguments: Any) -> Any:
        raise KeyboardInterrupt

    monkeypatch.setattr(LandmarkPipeline, "step", interrupted)
    picture = tmp_path / "map.png"
    folder, distance = stills(tmp_path / "stills", count=4), distances(tmp_path / "d.csv", count=4)
    status, out, err = run(
        capsys, "--stills", str(folder), "--distance-csv", str(distance), "--picture", str(picture), "--json"
    )
    assert (status, out) == (130, "")
    assert "no map was made and nothing was kept" in err
    assert not picture.exists()


def test_without_readable_distance_it_says_what_is_missing(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    pytest.importorskip("rapidocr")
    sentence = refusal(capsys, "--stills", str(stills(tmp_path / "stills", count=14)))
    assert "No distance can be read" in sentence
    assert "--distance-csv" in sentence
