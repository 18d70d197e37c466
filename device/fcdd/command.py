"""``borescout fcdd``: train, export and judge the detector of the landmarks survey."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import click
import numpy as np

from device.errors import Invalid
from device.fcdd.archive import SHIPPED_CLASSES, Still, read_archive, read_classes, read_picture
from device.fcdd.model import SHIPPED, load_model
from device.json_text import dumps
from device.landmarks.command import progress

FEW = 20
"""With fewer positives than this a figure says little."""
DECIMALS = 4


@click.group("fcdd")
def fcdd() -> None:
    """Train, export and judge the detector."""


@fcdd.command("evaluate")
@click.option(
    "--data", required=True, type=click.Path(path_type=Path), help="A folder with manifest.json, or one folder per class."
)
@click.option("--model", type=click.Path(path_type=Path), help="A model file; the shipped one if not given.")
@click.option("--scores", type=click.Path(path_type=Path, dir_okay=False), help="Write the scores of each picture here (.csv).")
@click.option("--single", is_flag=True, help="Look at each picture once, as the survey does, not at its mirror image too.")
@click.option("--threads", type=click.IntRange(1, 64), default=1, show_default=True, help="Threads of the network.")
@click.option("--json", "as_json", is_flag=True, help="One JSON object instead of a table.")
def evaluate(data: Path, model: Path | None, scores: Path | None, single: bool, threads: int, as_json: bool) -> int:
    """How well the detector tells the classes apart on labelled pictures."""
    stills = read_archive(data)
    network = load_model(model, threads)
    table = np.zeros((len(stills), len(network.card.classes)))
    with progress("Looking", len(stills)) as bar:
        for row, still in enumerate(stills):
            seen = network.see(read_picture(still), mirrored=not single)
            table[row] = [seen.scores[label] for label in network.card.classes]
            bar.update(1)
    if scores is not None:
        _write_scores(scores, stills, network.card.classes, table)
    found = {
        "model": str(SHIPPED.name if model is None else model),
        "n": len(stills),
        "classes": judged(stills, network.card.classes, table, network.card.thresholds),
    }
    if as_json:
        click.echo(dumps(found))
    else:
        _print(found)
    return 0


@fcdd.command("train")
@click.option(
    "--data", required=True, type=click.Path(path_type=Path), help="A folder with manifest.json, or one folder per class."
)
@click.option("--out", required=True, type=click.Path(path_type=Path, dir_okay=False), help="The model (.onnx).")
@click.option(
    "--work", required=True, type=click.Path(path_type=Path, file_okay=False), help="Where features and weights are kept."
)
@click.option("--boxes", type=click.Path(path_type=Path), help="Further pictures, with YOLO boxes (1: obstacle or deposit).")
@click.option("--classes", type=click.Path(path_type=Path), help="A class file; the five classes if not given.")
@click.option("--rendered", type=click.IntRange(0, 2000), default=70, show_default=True, help="Pipes of the virtual sewer.")
@click.option("--versions", type=click.IntRange(2, 200), default=18, show_default=True, help="Versions of each picture.")
@click.option("--rendered-versions", type=click.IntRange(2, 200), default=2, show_default=True, help="Of each rendered one.")
@click.option("--steps", type=click.IntRange(1, 100_000), default=60, show_default=True, help="Steps of each head.")
@click.option("--seeds", type=click.IntRange(1, 20), default=1, show_default=True, help="Heads that are merged into one.")
@click.option("--folds", type=click.IntRange(2, 20), default=5, show_default=True, help="Folds that the thresholds come from.")
@click.option(
    "--by", type=click.Choice(["cluster", "collection"]), default="cluster", show_default=True, help="What folds keep whole."
)
@click.option(
    "--precision", type=click.FloatRange(0.05, 0.99), default=0.7, show_default=True, help="What the thresholds aim at."
)
@click.option("--int8", "as_int8", is_flag=True, help="Write the model in int8.")
@click.option("--seed", type=click.IntRange(0), default=1, show_default=True)
def train(**options: Any) -> int:
    """Train the detector on labelled pictures; goes on where it was stopped."""
    from device.fcdd.train import Wanted, train_model

    file = options.pop("classes")
    classes = SHIPPED_CLASSES if file is None else read_classes(file)
    found = train_model(Wanted(classes=classes, **options), lambda line: click.echo(line, err=True))
    for label, value in found.items():
        click.echo(f"{label:<16} out-of-fold AUROC {'-' if value is None else f'{value:.3f}'}")
    return 0


@fcdd.command("export")
@click.option("--weights", required=True, type=click.Path(path_type=Path), help="weights.pt of a training's work folder.")
@click.option("--out", required=True, type=click.Path(path_type=Path, dir_okay=False), help="The model (.onnx).")
@click.option("--calibrate", type=click.Path(path_type=Path), help="With --int8: labelled pictures to calibrate on.")
@click.option("--int8", "as_int8", is_flag=True, help="Static int8 instead of float32.")
def export(weights: Path, out: Path, calibrate: Path | None, as_int8: bool) -> int:
    """Write trained weights as a model, checked against torch."""
    from device.fcdd.train import export_weights

    if as_int8 and calibrate is None:
        raise Invalid("Say with --calibrate which pictures int8 is to be calibrated on.")
    worst = export_weights(weights, out, calibrate if as_int8 else None)
    click.echo(f"{out}: {out.stat().st_size / 1e6:.1f} MB, largest difference of a score from torch {worst:.4f}")
    return 0


def judged(stills: list[Still], classes: tuple[str, ...], scores: Any, thresholds: Any) -> dict[str, dict[str, Any]]:
    """Per class its figures against all other pictures, null where there is no positive or nothing else."""
    from estimators.fcdd_training.folds import at_threshold, auroc

    found = {}
    for column, label in enumerate(classes):
        positive = np.array([label in still.labels for still in stills])
        count = int(positive.sum())
        threshold = float(thresholds[label])
        at = at_threshold(scores[:, column], positive, threshold)
        known = 0 < count < len(stills)
        found[label] = {
            "auroc": round(auroc(scores[:, column], positive), DECIMALS) if known else None,
            "precision": round(at.precision, DECIMALS) if known else None,
            "recall": round(at.recall, DECIMALS) if known else None,
            "f1": round(at.f1, DECIMALS) if known else None,
            "threshold": round(threshold, 6),
            "n_positive": count,
            "n": len(stills),
            "few_positives": count < FEW,
        }
    return found


def _write_scores(path: Path, stills: list[Still], classes: tuple[str, ...], table: Any) -> None:
    try:
        with path.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(["image", *classes])
            writer.writerows(
                [still.path.name, *(f"{value:.6f}" for value in row)] for still, row in zip(stills, table, strict=True)
            )
    except OSError as error:
        raise Invalid(f"The scores cannot be written to {path}: {error.strerror}.") from None


def _print(found: dict[str, Any]) -> None:
    click.echo(
        f"{'class':<16} {'AUROC':>6} {'precision':>9} {'recall':>7} {'F1':>6} {'threshold':>9} {'positive':>8} {'of':>6}"
    )
    for label, row in found["classes"].items():
        figures = [row[name] for name in ("auroc", "precision", "recall", "f1")]
        a, p, r, f = ("-" if value is None else f"{value:.3f}" for value in figures)
        few = "  few" if row["few_positives"] else ""
        click.echo(
            f"{label:<16} {a:>6} {p:>9} {r:>7} {f:>6} {row['threshold']:>9.3f} {row['n_positive']:>8} {row['n']:>6}{few}"
        )
