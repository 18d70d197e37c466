"""The command line as a stranger meets it: what goes wrong is one sentence on stderr and exit status 2."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import time
import urllib.request
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from tests.pairing import PIN, pair
from tests.unit.estimators.analytic_scenes import SMALL, cylinder, to_depth

ROOT = Path(__file__).resolve().parents[3]
PER_FRAME = {"depth", "verdict", "reasons", "diameter_mm", "interval_mm", "radius_std_mm", "seconds"}


def borescout(*arguments: str | Path, timeout_s: float = 120.0) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "device.cli", *map(str, arguments)]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=timeout_s, check=False)


def entry(depth: str, recording: str) -> dict[str, Any]:
    intrinsics = {name: getattr(SMALL, name) for name in ("width", "height", "fx", "fy", "ppx", "ppy")}
    return {
        "depth": depth,
        "recording": recording,
        "depth_unit_m": 0.001,
        "intrinsics": {**intrinsics, "model": "none", "coeffs": [0, 0, 0, 0, 0]},
    }


@pytest.fixture
def recorded(tmp_path: Path) -> Path:
    """Two pipes with a recording of the same name each, two pictures of the first and one of the second."""
    folder = tmp_path / "recorded"
    entries = []
    for pipe, radius, count in (("200", 0.1, 2), ("300", 0.15, 1)):
        (folder / pipe / "r1").mkdir(parents=True)
        for number in range(count):
            path = f"{pipe}/r1/depth_{number}.png"
            cv2.imwrite(str(folder / path), to_depth(cylinder(radius, SMALL, tilt=(0.05, 0.0)), 0.01, seed=number))
            entries.append(entry(path, "r1"))
    (folder / "manifest.json").write_text(json.dumps(entries))
    return folder


def refused(done: subprocess.CompletedProcess[str]) -> str:
    """The one sentence of a command that could not."""
    assert done.returncode == 2, (done.returncode, done.stdout, done.stderr)
    assert done.stdout == ""
    assert "Traceback" not in done.stderr
    lines = done.stderr.strip().splitlines()
    assert len(lines) == 1, done.stderr
    assert lines[0].startswith("borescout: ")
    return lines[0]


# --- refusals ---


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["dance"], "No such command 'dance'"),
        (["measure"], "Say what to measure with: --virtual, --replay or --camera."),
        (["measure", "--virtual", "--replay", "x"], "Choose one of --virtual, --replay and --camera."),
        (["measure", "--camera", "kinect"], "'kinect' is not one of"),
        (["measure", "--virtual", "--per-frame"], "--per-frame goes with --replay"),
        (["measure", "--replay", "/nowhere/at/all"], "There is no folder /nowhere/at/all"),
        (["measure", "--replay", "/nowhere/at/all", "--per-frame"], "There is no folder /nowhere/at/all"),
        (["measure", "--virtual", "--frames", "0"], "0 is not in the range"),
        (["measure", "--virtual", "--frames", "many"], "'many' is not a valid integer"),
        (["measure", "--camera", "oak", "--tof"], "--tof goes with --virtual"),
        (["measure", "--camera", "oak", "--camera", "oak"], "named twice"),
        (["serve", "--virtual", "--port", "99999"], "The setting port cannot be 99999"),
        (["serve", "--replay", "/nowhere/at/all"], "There is no folder /nowhere/at/all"),
        (["serve", "--virtual", "--data-dir", "/proc/no"], "The data folder /proc/no cannot be used"),
        (["serve", "--config", "/nowhere.toml"], "There is no settings file /nowhere.toml"),
        (["serve", "--what"], "No such option"),
        (["serve", "--virtual", "--description", "/nowhere.json"], "/nowhere.json"),
        (["measure", "--camera", "oak", "--description", "x.json"], "--description goes with --virtual"),
    ],
)
def test_bad_arguments(arguments: list[str], sentence: str) -> None:
    assert sentence in refused(borescout(*arguments))


@pytest.mark.parametrize(
    ("manifest", "sentence"),
    [
        (None, "has no manifest.json"),
        ("{", "cannot be read"),
        ("{}", "is not a list"),
        ("[]", "names no depth picture"),
        ('[{"depth": "../../etc/passwd"}]', "outside its folder"),
        ('[{"depth": "a.png", "recording": "r", "depth_unit_m": 0}]', "depth unit"),
    ],
)
@pytest.mark.parametrize("command", [["measure", "--per-frame"], ["measure"], ["serve"]])
def test_broken_manifests(tmp_path: Path, command: list[str], manifest: str | None, sentence: str) -> None:
    if manifest is not None:
        (tmp_path / "manifest.json").write_text(manifest)
    assert sentence in refused(borescout(*command, "--replay", tmp_path, *_data(command, tmp_path)))


def _data(command: list[str], folder: Path) -> list[str]:
    return ["--data-dir", str(folder / "data")] if command == ["serve"] else []


@pytest.mark.parametrize("command", ["measure", "serve"])
def test_an_absent_camera_package_is_told_with_its_remedy(tmp_path: Path, command: str) -> None:
    hidden = tmp_path / "hidden"
    hidden.mkdir()
    (hidden / "pyrealsense2.py").write_text("raise ImportError('hidden by a test')")
    done = subprocess.run(
        [sys.executable, "-m", "device.cli", command, "--camera", "realsense", "--data-dir", str(tmp_path / "data")],
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(hidden)},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert "pip install 'borescout[realsense]'" in refused(done)


def test_help_and_version_are_no_errors() -> None:
    done = borescout("--help")
    assert done.returncode == 0
    for command in ("serve", "measure", "doctor", "virtual-campaign"):
        assert command in done.stdout


# --- measure --replay ---


def test_per_frame_json_has_one_object_a_line_in_the_manifests_order(recorded: Path) -> None:
    done = borescout("measure", "--replay", recorded, "--per-frame", "--json")
    assert (done.returncode, done.stderr) == (0, "")
    lines = [json.loads(line) for line in done.stdout.splitlines()]
    assert [line["depth"] for line in lines] == ["200/r1/depth_0.png", "200/r1/depth_1.png", "300/r1/depth_0.png"]
    for line, diameter_mm in zip(lines, (200, 200, 300), strict=True):
        assert set(line) == PER_FRAME
        assert line["diameter_mm"] == pytest.approx(diameter_mm, abs=5)
        assert line["interval_mm"][0] < line["diameter_mm"] < line["interval_mm"][1]
        assert line["verdict"] in ("accept", "retry")
        assert line["seconds"] > 0


def test_an_unreadable_picture_has_its_line_and_the_rest_go_on(recorded: Path) -> None:
    (recorded / "200/r1/depth_1.png").write_bytes(b"not a picture")
    done = borescout("measure", "--replay", recorded, "--per-frame", "--json")
    assert done.returncode == 1
    lines = [json.loads(line) for line in done.stdout.splitlines()]
    assert len(lines) == 3
    assert (lines[1]["verdict"], lines[1]["reasons"], lines[1]["diameter_mm"]) == ("retry", ["camera_lost"], None)
    assert lines[2]["diameter_mm"] == pytest.approx(300, abs=5)
    assert "1 of 3 pictures could not be read." in done.stderr
    assert "Traceback" not in done.stderr


def test_nothing_in_view_is_refused_without_a_diameter(recorded: Path) -> None:
    cv2.imwrite(str(recorded / "300/r1/depth_0.png"), np.zeros((SMALL.height, SMALL.width), np.uint16))
    done = borescout("measure", "--replay", recorded, "--per-frame", "--json")
    last = json.loads(done.stdout.splitlines()[-1])
    assert (last["verdict"], last["diameter_mm"], last["interval_mm"]) == ("retry", None, None)
    assert last["reasons"]


def test_recordings_of_the_same_name_in_two_folders_are_two_results(recorded: Path) -> None:
    done = borescout("measure", "--replay", recorded, "--json")
    assert (done.returncode, done.stderr) == (0, "")
    results = [json.loads(line) for line in done.stdout.splitlines()]
    assert [(result["recording"], result["folder"]) for result in results] == [("r1", "200/r1"), ("r1", "300/r1")]
    assert [len(result["frames"]) for result in results] == [2, 1]
    assert results[0]["diameter_mm"] == pytest.approx(200, abs=5)
    assert {"profile", "proxies", "questions", "dn", "prompts"} <= set(results[0])


def test_the_table_is_for_people(recorded: Path) -> None:
    done = borescout("measure", "--replay", recorded)
    assert done.returncode == 0
    header, *rows = done.stdout.splitlines()
    assert header.split()[:1] == ["diameter"]
    assert len(rows) == 2
    assert re.search(r"\b(19[5-9]|20[0-5])\.\d mm\b", rows[0])


def test_a_reader_that_has_seen_enough_is_no_error(recorded: Path) -> None:
    command = f"{sys.executable} -m device.cli measure --replay {recorded} --per-frame --json | head -n 1"
    done = subprocess.run(["bash", "-c", f"set -o pipefail; {command}"], cwd=ROOT, capture_output=True, text=True, check=False)
    assert "Traceback" not in done.stderr
    assert len(done.stdout.splitlines()) == 1


def test_other_fields_of_the_manifest_are_never_read(recorded: Path, tmp_path: Path) -> None:
    plain = borescout("measure", "--replay", recorded, "--per-frame", "--json")
    entries = json.loads((recorded / "manifest.json").read_text())
    lie = {"wall_visible": False, "interior_diameter_mm": [999, 999], "emitter": "no", "position": 7, "cover": [], "lamp": {}}
    told = tmp_path / "told"
    shutil.copytree(recorded, told)
    (told / "manifest.json").write_text(json.dumps([{**one, **lie} for one in entries]))
    lied = borescout("measure", "--replay", told, "--per-frame", "--json")

    def timeless(done: subprocess.CompletedProcess[str]) -> list[dict[str, Any]]:
        return [{**json.loads(line), "seconds": 0} for line in done.stdout.splitlines()]

    assert timeless(plain) == timeless(lied)


# --- measure --virtual ---


def test_measure_in_the_virtual_sewer(tmp_path: Path) -> None:
    done = borescout("measure", "--virtual", "--json", "--frames", "8", "--data-dir", tmp_path)
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert result["diameter_mm"] == pytest.approx(300, abs=20)
    assert (result["survey"], result["frames_used"]) == (1, 8)
    assert (tmp_path / "borescout.db").is_file()


def test_ctrl_c_cancels_a_measurement_cleanly(tmp_path: Path) -> None:
    running = subprocess.Popen(
        [sys.executable, "-m", "device.cli", "-v", "measure", "--virtual", "--frames", "500", "--data-dir", str(tmp_path)],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        # a shell ignores SIGINT in what it starts in the background, and that is inherited
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    assert running.stderr is not None
    said = ""
    while "measuring 500 frames" not in said:
        line = running.stderr.readline()
        assert line, said
        said += line
    running.send_signal(signal.SIGINT)
    out, err = running.communicate(timeout=60)
    assert running.returncode == 130
    assert out == ""
    assert "Traceback" not in err
    assert "cancelled" in err
    assert err.splitlines()[-1] == "borescout: Interrupted."


# --- serve ---


def serve(*arguments: str | Path) -> tuple[subprocess.Popen[str], str]:
    """A running daemon and the address it printed."""
    daemon = subprocess.Popen(
        [sys.executable, "-m", "device.cli", "serve", "--port", "0", "--pin", PIN, *map(str, arguments)],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert daemon.stdout is not None
    line = daemon.stdout.readline()
    match = re.search(r"http://\S+", line)
    if match is None:
        daemon.kill()
        pytest.fail(f"no address was printed: {line!r} {daemon.communicate()}")
    return daemon, match[0]


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_serve_prints_its_address_answers_and_stops_cleanly(recorded: Path, tmp_path: Path, number: signal.Signals) -> None:
    daemon, address = serve("--replay", recorded, "--data-dir", tmp_path / "data")
    try:
        deadline = time.monotonic() + 60
        headers = pair(int(address.rsplit(":", 1)[1])).headers
        while time.monotonic() < deadline:
            asked = urllib.request.Request(f"{address}/api/v1/status", headers=headers)
            with urllib.request.urlopen(asked, timeout=30) as answer:
                status = json.load(answer)
            if status["cameras"][0]["state"] == "up":
                break
            time.sleep(0.1)
        assert status["cameras"][0]["state"] == "up"
        asked = urllib.request.Request(f"{address}/api/v1/events", headers=headers)
        stream = urllib.request.urlopen(asked, timeout=30)  # a page that is open must not hold it up
        assert stream.readline()
        begun = time.monotonic()
        daemon.send_signal(number)
        _, log = daemon.communicate(timeout=30)
    finally:
        daemon.kill()
    assert daemon.returncode == 0, log
    assert time.monotonic() - begun < 15
    assert "Traceback" not in log
    assert "stopped" in log.splitlines()[-1]


def test_a_port_in_use_and_a_folder_in_use_are_one_sentence(recorded: Path, tmp_path: Path) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = str(taken.getsockname()[1])
        done = borescout("serve", "--replay", recorded, "--data-dir", tmp_path / "data", "--port", port)
        assert f"cannot be served at 127.0.0.1:{port}" in done.stderr.splitlines()[-1]
        assert done.returncode == 2
        assert "Traceback" not in done.stderr
    daemon, _ = serve("--replay", recorded, "--data-dir", tmp_path / "data")
    try:
        done = borescout("serve", "--replay", recorded, "--data-dir", tmp_path / "data", "--port", "0")
        assert f"process {daemon.pid}) is using" in refused(done)
    finally:
        daemon.terminate()
        daemon.communicate(timeout=30)


# --- doctor ---


def test_doctor_finds_the_box_fit(tmp_path: Path) -> None:
    done = borescout("doctor", "--json", "--data-dir", tmp_path / "data", "--port", "0")
    report = json.loads(done.stdout.splitlines()[-1])
    found = {finding["what"]: finding for finding in report["findings"]}
    assert (done.returncode, report["healthy"]) == (0, True)
    assert found["data folder"]["state"] == "ok"
    assert found["numpy"]["found"] == np.__version__
    assert list((tmp_path / "data").iterdir()) == []


def test_doctor_says_what_is_wrong_and_what_to_do(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    done = borescout("doctor", "--data-dir", tmp_path / "file" / "data")
    assert done.returncode == 1
    assert re.search(r"!!  data folder .*file/data", done.stdout)
    assert "-> choose another --data-dir" in done.stdout
    assert "not fit to measure" in done.stdout
