"""A survey is recorded while it goes on, and computed again from its recording it comes to the same, bit by bit."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from device.cli import _run
from device.recorder.policy import MB
from device.recorder.reader import open_recording
from device.recorder.recovery import check
from device.replay.survey import replay
from device.surveys.topics import FINDINGS, FRAMES, PROMPTED, STEPS
from tests.hil import crawler_rig, rig
from tests.hil.crawler_rig import Thing
from tests.hil.rig import PATIENCE_S

THINGS = (Thing("deposit", 0.9, 1.6), Thing("connection", 1.1, -0.4))
END_M = 1.5


def recordings(folder: Path) -> list[Path]:
    return sorted((folder / "recordings").glob("*.mcap"))


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The recording of a measurement with two cameras."""
    folder = tmp_path_factory.mktemp("measured")
    box = rig.Bench(folder, rig.PipeCamera("left", 0.1), rig.PipeCamera("right", 0.12, noise=0.05))
    try:
        box.up()
        survey = box.device.measure()["survey_id"]
        assert box.finish(survey)["state"] == "saved"
    finally:
        box.close()
    (path,) = recordings(folder)
    return path


@pytest.fixture(scope="module")
def driven(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, object]]:
    """The recording of a drive with a pause and a mark, and the map that was stored."""
    folder = tmp_path_factory.mktemp("driven")
    box = crawler_rig.Bench(folder, THINGS)
    try:
        box.up()
        survey = box.device.drive.begin()["survey_id"]
        box.drive_to(0.3)
        box.device.drive.pause()
        box.drive_to(0.4)
        box.device.drive.resume()
        box.device.drive.mark("roots", 4.0, "by hand")
        box.drive_to(END_M, PATIENCE_S)
        box.device.drive.end()
        box.finished(PATIENCE_S)
        stored = box.device.drive.map(survey)
    finally:
        box.close()
    (path,) = recordings(folder)
    return path, stored


def test_a_measurement_comes_out_the_same(measured: Path) -> None:
    assert check(measured).ok
    lines: list[str] = []
    outcome = replay(measured, after_step=lines.append)
    assert outcome.equal
    assert outcome.exact
    assert outcome.versions == {}
    assert outcome.frames == 24
    assert len(outcome.findings["results"]) == 2
    assert outcome.findings["conclusion"]["diameter_mm"] is not None
    assert lines


def test_a_drive_comes_out_the_same(driven: tuple[Path, dict[str, object]]) -> None:
    path, stored = driven
    outcome = replay(path)
    assert outcome.differences == []
    assert outcome.equal
    assert outcome.exact
    assert outcome.frames > 50
    found = outcome.findings
    rows = {row["id"]: row for row in found["landmarks"]}
    kept = {row["id"]: row for row in stored["landmarks"]}  # type: ignore[index,attr-defined]
    assert rows.keys() == kept.keys()
    assert {"deposit", "connection", "roots"} <= {row["class"] for row in rows.values()}
    for number, row in rows.items():
        assert kept[number].items() >= row.items()  # what is logged is what was stored
    assert stored["rings"] == found["rings"]


def test_what_was_consumed_is_noted(measured: Path, driven: tuple[Path, dict[str, object]]) -> None:
    topics = [entry.topic for entry in open_recording(measured).entries()]
    assert topics.count(FRAMES) == 24
    assert topics[-1] == FINDINGS
    assert {"/camera/left", "/camera/right"} <= set(topics)
    told = [entry.topic for entry in open_recording(driven[0]).entries()]
    assert told.count(STEPS) > 50
    head = open_recording(driven[0]).head
    assert head["detector"] == {"name": "truth", "model": None}
    assert head["versions"]["numpy"]
    assert head["seed"] == head["survey_id"]


def test_what_is_missing_is_told_and_nothing_is_called_equal(measured: Path, tmp_path: Path) -> None:
    data = bytearray(measured.read_bytes())
    at = -1
    for _ in range(3):  # the first frames of both cameras
        at = data.index(b"\x04\x00\x00\x00zstd", at + 1)
        data[at + 100] ^= 1
    path = tmp_path / measured.name
    path.write_bytes(data)
    outcome = replay(path)
    assert outcome.missing > 0
    assert not outcome.exact
    assert outcome.equal is False
    assert outcome.differences


def test_a_log_that_was_cut_off_is_computed_as_far_as_it_goes(driven: tuple[Path, dict[str, object]], tmp_path: Path) -> None:
    path = tmp_path / driven[0].name
    data = driven[0].read_bytes()
    path.write_bytes(data[: len(data) // 3])
    outcome = replay(path)
    assert outcome.logged is None
    assert outcome.equal is None
    assert 0 < outcome.frames < 60


def test_the_command(
    driven: tuple[Path, dict[str, object]], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    pressed: list[int] = []
    monkeypatch.setattr("builtins.input", lambda: pressed.append(1))
    assert _run(["replay", str(driven[0]), "--step", "--json"]) == 0
    out, err = capsys.readouterr()
    told = json.loads(out)
    assert told["equal"] is True
    assert told["findings"]["landmarks"]
    assert len(pressed) == told["frames"]
    assert err.startswith("frame ")


@pytest.mark.parametrize("what", ["none", "garbage"])
def test_bad_input_is_one_sentence(what: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "x.mcap"
    if what == "garbage":
        path.write_bytes(b"no recording")
    assert _run(["replay", str(path)]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_a_disk_that_fills_ends_the_recording_and_not_the_drive(tmp_path: Path) -> None:
    box = crawler_rig.Bench(tmp_path, THINGS)
    try:
        box.up()
        survey = box.device.drive.begin()["survey_id"]
        box.drive_to(0.4)
        box.device._shelf._free = lambda folder: 60 * MB
        box.wait(lambda: "not_recorded" in [prompt["code"] for prompt in box.device.drive.state()["prompts"]], PATIENCE_S)
        (now,) = box.device.status()["recording"]["now"]
        assert (now["state"], now["survey_id"]) == ("stopped", survey)
        assert "nearly full" in now["message"]
        box.drive_to(END_M, PATIENCE_S)
        box.device.drive.end()
        box.finished(PATIENCE_S)
        assert box.device.drive.map(survey)["state"] == "saved"
        assert len(box.device.drive.map(survey)["landmarks"]) >= 2
    finally:
        box.close()
    (path,) = recordings(tmp_path)
    assert check(path).ok
    assert PROMPTED not in [entry.topic for entry in open_recording(path).entries()]


def test_what_a_power_cut_left_is_recovered_when_the_box_starts(measured: Path, tmp_path: Path) -> None:
    (tmp_path / "recordings").mkdir()
    path = tmp_path / "recordings" / measured.name
    path.write_bytes(measured.read_bytes()[:-5000])
    box = crawler_rig.Bench(tmp_path, ())
    try:
        box.wait(lambda: box.device.status()["recording"]["recovered"] == 1, PATIENCE_S)
    finally:
        box.close()
    assert check(path).ok
    assert check(path).recovered
    assert check(path).lost_seconds < 1.0


def test_a_cancelled_survey_leaves_no_recording(tmp_path: Path) -> None:
    box = crawler_rig.Bench(tmp_path, ())
    try:
        box.up()
        box.device.drive.begin()
        box.drive_to(0.2)
        box.device.drive.cancel()
        box.finished(PATIENCE_S)
    finally:
        box.close()
    assert recordings(tmp_path) == []
