"""The shipped model, the command that judges it, and what is said of files that are none."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from click.testing import CliRunner

from device.cli import cli
from device.errors import Invalid
from device.fcdd.detector import FcddDetector
from device.fcdd.model import SHIPPED, SHIPPED_INT8, fastest_model, load_model
from drivers.grabber.base import VideoFrame
from estimators.detections import CLASSES
from estimators.fcdd import Fcdd, ModelBroken, ModelCard, card_of


@pytest.fixture(scope="module")
def network() -> Fcdd:
    return load_model()


def _picture(seed: int, size: tuple[int, int] = (720, 576)) -> np.ndarray:
    rng = np.random.default_rng(seed)
    small = rng.integers(0, 255, (9, 12, 3)).astype(np.uint8)
    return np.asarray(cv2.resize(small, size, interpolation=cv2.INTER_CUBIC), np.uint8)


def test_the_shipped_model_is_small_and_knows_the_classes(network: Fcdd) -> None:
    assert SHIPPED.stat().st_size <= 8_000_000
    assert network.card.classes == CLASSES
    assert all(0 < network.card.thresholds[label] < 1 for label in CLASSES)
    assert all(network.card.map_thresholds[label] > 0 for label in CLASSES)


def test_maps_and_scores_are_those_of_eqs_8_and_9(network: Fcdd) -> None:
    seen = network.see(_picture(1))
    assert seen.maps.shape == (5, 15, 20)
    assert float(seen.maps.min()) >= 0
    assert all(0 <= seen.scores[label] <= 1 for label in CLASSES)
    # no still shows a connection: it is told by its map alone
    assert seen.scores["connection"] == pytest.approx(1 - np.exp(-float(seen.heatmap("connection").mean())), abs=1e-6)


def test_a_mirrored_look_does_not_care_for_left_and_right(network: Fcdd) -> None:
    picture = _picture(2, (640, 480))
    found, other = (network.see(one, mirrored=True) for one in (picture, np.ascontiguousarray(picture[:, ::-1])))
    assert found.scores == pytest.approx(other.scores, abs=1e-4)
    assert np.allclose(found.maps, other.maps[:, :, ::-1], atol=1e-3)


@pytest.mark.parametrize("size", [(32, 24), (320, 240), (1920, 1080), (101, 333)])
def test_any_size_of_picture(network: Fcdd, size: tuple[int, int]) -> None:
    assert network.see(_picture(3, size)).maps.shape == (5, 15, 20)


def test_a_grey_picture_is_told(network: Fcdd) -> None:
    with pytest.raises(ValueError, match="three colours"):
        network.see(np.zeros((10, 10), np.uint8))


def test_detections_lie_in_the_picture(network: Fcdd) -> None:
    picture = _picture(4)
    everything = dict.fromkeys(CLASSES, 0.0)
    eager = ModelCard(CLASSES, network.card.size, everything, dict.fromkeys(CLASSES, 0.05), {})
    kept, network.card = network.card, eager
    try:
        found = network.detect(picture)
    finally:
        network.card = kept
    assert found
    assert all(0 <= one.u < 720 and 0 <= one.v < 576 and 0 <= one.score <= 1 for one in found)


def test_the_detector_looks_at_every_second_picture(network: Fcdd) -> None:
    detector = FcddDetector(network, every=2)
    frame = VideoFrame(_picture(5), 0, 1, 0.0, "test")
    looked = [detector.detect(frame) is not None for _ in range(5)]
    assert looked == [True, False, True, False, True]


@pytest.mark.parametrize("content", [b"", b"no model", b"\x08\x07" * 50])
def test_a_file_that_is_no_model_is_one_sentence(tmp_path: Path, content: bytes) -> None:
    file = tmp_path / "bad.onnx"
    file.write_bytes(content)
    with pytest.raises(Invalid) as told:
        load_model(file)
    assert str(told.value) == f"The file {file} is not a whole ONNX model."


def test_half_a_model_and_a_missing_one_are_told(tmp_path: Path) -> None:
    file = tmp_path / "half.onnx"
    whole = SHIPPED.read_bytes()
    file.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(Invalid, match="not a whole ONNX model"):
        load_model(file)
    with pytest.raises(Invalid, match="There is no model"):
        load_model(tmp_path / "none.onnx")
    with pytest.raises(Invalid, match="cannot be read"):
        load_model(tmp_path)


def test_metadata_of_something_else_are_told() -> None:
    with pytest.raises(ModelBroken, match="none that says"):
        card_of({})
    good = ModelCard(("roots",), (32, 24), {"roots": 0.5}, {"roots": 1.0}, {"made": "here"}).metadata()
    assert card_of(good).classes == ("roots",)
    with pytest.raises(ModelBroken, match="damaged metadata"):
        card_of(good | {"thresholds": "{}"})


def _archive(folder: Path, count: int = 6) -> None:
    rows = []
    for k in range(count):
        cv2.imwrite(str(folder / f"{k}.png"), _picture(10 + k, (64, 48)))
        rows.append({"image": f"{k}.png", "labels": ["roots"] if k % 2 else ["normal"], "source": f"s{k}"})
    (folder / "manifest.json").write_text(json.dumps(rows), encoding="utf-8")


def test_evaluate_says_its_figures_as_json_and_writes_scores(tmp_path: Path) -> None:
    _archive(tmp_path)
    scores = tmp_path / "scores.csv"
    found = CliRunner().invoke(cli, ["fcdd", "evaluate", "--data", str(tmp_path), "--json", "--scores", str(scores)])
    assert found.exit_code == 0, found.output
    told = json.loads(found.stdout)
    assert set(told["classes"]) == set(CLASSES)
    roots = told["classes"]["roots"]
    assert {"auroc", "precision", "recall", "f1", "threshold", "n_positive", "n"} <= set(roots)
    assert (roots["n_positive"], roots["n"]) == (3, 6)
    assert told["classes"]["fracture"]["auroc"] is None
    with scores.open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [row["image"] for row in rows] == [f"{k}.png" for k in range(6)]
    values = np.array([float(row["roots"]) for row in rows])
    pairs = [(values[p] > values[n]) + 0.5 * (values[p] == values[n]) for p in (1, 3, 5) for n in (0, 2, 4)]
    assert roots["auroc"] == pytest.approx(float(np.mean(pairs)), abs=1e-3)


def test_evaluate_prints_a_table(tmp_path: Path) -> None:
    _archive(tmp_path)
    found = CliRunner().invoke(cli, ["fcdd", "evaluate", "--data", str(tmp_path), "--single"])
    assert found.exit_code == 0
    assert "displaced joint" in found.stdout
    assert "few" in found.stdout


def test_int8_says_nearly_what_float32_says(network: Fcdd) -> None:
    small = load_model(SHIPPED_INT8)
    assert SHIPPED_INT8.stat().st_size < SHIPPED.stat().st_size
    assert small.card.classes == network.card.classes
    assert small.card.thresholds == network.card.thresholds
    for seed in range(6):
        scores, other = network.see(_picture(seed)).scores, small.see(_picture(seed)).scores
        assert scores == pytest.approx(other, abs=0.08)


def test_the_faster_of_both_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    assert fastest_model().card.classes == CLASSES
    plain, now = Fcdd.run, [0.0]
    for slow in (SHIPPED, SHIPPED_INT8):
        held: list[Fcdd] = []

        def run(self: Fcdd, x: np.ndarray, held: list[Fcdd] = held) -> tuple[np.ndarray, np.ndarray]:
            now[0] += 2.0 if self in held else 1.0
            return plain(self, x)

        def load(path: Path, threads: int, slow: Path = slow, held: list[Fcdd] = held) -> Fcdd:
            found = load_model(path, threads)
            if path == slow:
                held.append(found)
            return found

        monkeypatch.setattr(Fcdd, "run", run)
        monkeypatch.setattr("device.fcdd.model.load_model", load)
        monkeypatch.setattr("device.fcdd.model.time.perf_counter", lambda: now[0])
        assert fastest_model() not in held
        monkeypatch.undo()
