"""``borescout structure`` as it is called from outside."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from device.cli import _run
from drivers.virtual.chamber.structure import load_structure


@pytest.mark.parametrize(
    ("arguments", "why"),
    [
        ([], "Say what to map"),
        (["--scans", "x"], "--navigation"),
        (["--virtual", "--navigation", "x"], "--scans"),
        (["--virtual", "nothing.json"], "nothing.json"),
        (["--scans", "nowhere", "--navigation", "nothing.csv"], "nothing.csv"),
        (["--virtual", "--export", "map.step"], ".step"),
        (["--virtual", "--export", "nowhere/map.ply"], "nowhere"),
    ],
)
def test_what_cannot_be_is_one_sentence(arguments: list[str], why: str, capfd: pytest.CaptureFixture[str]) -> None:
    assert _run(["structure", *arguments]) == 2
    said = capfd.readouterr().err.strip()
    assert why in said
    assert said.count("\n") == 0


def test_two_scans_make_a_map_its_truth_its_scores_and_its_files(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    files = [tmp_path / f"map.{kind}" for kind in ("json", "ply", "glb")]
    exports = [part for file in files for part in ("--export", str(file))]
    assert _run(["structure", "--virtual", "--seed", "3", "--first", "2", "--json", *exports]) == 0
    told = json.loads(capfd.readouterr().out)
    truth = load_structure()
    assert len(told["truth"]["pipes"]) == len(truth.runs)
    assert len(told["truth"]["objects"]) == len(truth.objects)
    assert told["scans"] == 2
    assert told["seconds_per_scan"] > 0
    assert len(told["pipes"]) >= 5
    for pipe in told["pipes"]:
        assert np.linalg.norm(np.subtract(pipe["to"], pipe["from"])) == pytest.approx(pipe["length_m"], abs=1e-3)
    for thing in told["objects"]:
        assert sum(thing["beliefs"].values()) == pytest.approx(1.0, abs=1e-3)
        assert thing["class"] == max(thing["beliefs"], key=thing["beliefs"].get)
    numbers = {thing["number"] for thing in told["objects"]}, {pipe["number"] for pipe in told["pipes"]}
    assert all(edge["object"] in numbers[0] and edge["pipe"] in numbers[1] for edge in told["edges"])
    scores = told["scores"]
    assert 0 < scores["recognition"]["descriptor"]["accuracy"] < 1
    assert scores["position_rms_m"] < 0.05
    assert scores["pipes_false"] == 0
    graph = json.loads(files[0].read_text())
    ids = {node["id"] for node in graph["nodes"]}
    assert all(link["source"] in ids and link["target"] in ids for link in graph["links"])
    assert files[1].read_bytes().startswith(b"ply")
    assert files[2].read_bytes().startswith(b"glTF")
