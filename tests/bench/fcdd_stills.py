"""Figure 1 of the detector: how well it tells the classes apart on stills that it has not seen.

    python -m tests.bench.fcdd_stills --work DIR              five folds by cluster and by collection
    python -m tests.bench.fcdd_stills --work DIR --ablation   what each source of data and each part of the network brings

Needs torch (dependency group train), and some minutes of a core for each split; each fold is kept in the work folder, so that a
run that was stopped goes on. A fold's network saw none of its clusters (or collections), nor a near-duplicate of any of its
stills in another collection. Scores of all folds are pooled; each class is told from all other stills. Thresholds of a fold
come from the scores of the other folds. Intervals are 95 % bootstrap over clusters, or over collections.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from device.fcdd.train import Wanted, train_scores
from estimators.detections import CLASSES
from estimators.fcdd_training.context import RIDGE, TOLD_BY, USUAL, Telling
from estimators.fcdd_training.folds import auroc, auroc_interval, grouped_folds, threshold_for
from estimators.fcdd_training.network import TAPS
from tests.bench.real_data import data_folder
from tests.bench.table import print_table

LEAST = 20
"""No figure is given for a class with fewer positives."""
PRECISION = 0.7
WANTED = {
    "cluster": {"roots": 0.98, "fracture": 0.94, "deposit": 0.92, "displaced joint": 0.88},
    "collection": {"roots": 0.95, "fracture": 0.91, "deposit": 0.88, "displaced joint": 0.82},
}


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.bench.fcdd_stills", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--work", type=Path, required=True, help="where features and folds are kept between runs")
    parser.add_argument("--by", choices=["cluster", "collection"], help="one split only")
    parser.add_argument("--ablation", action="store_true", help="by sources of data, and by parts of the context")
    parser.add_argument("--rendered", type=int, default=Wanted.rendered)
    chosen = vars(parser.parse_args())
    only, ablation = chosen.pop("by"), chosen.pop("ablation")
    data = data_folder().parent / "cctv_stills"
    for by in ("cluster", "collection") if only is None else (only,):
        wanted = Wanted(data=data, out=Path("unused.onnx"), by=by, **chosen)
        if ablation:
            _ablation(wanted)
        else:
            show(by, *train_scores(wanted, _note))


def show(by: str, lessons: list[Any], scores: Any) -> None:
    """One split as a table."""
    stills = [k for k, lesson in enumerate(lessons) if lesson.kind == "stills"]
    groups = [lessons[k].group if by == "cluster" else lessons[k].source for k in stills]
    rows = []
    for k, name in enumerate(CLASSES):
        positive = np.array([lessons[row].labels[k] > 0 for row in stills])
        count = int(positive.sum())
        if count < LEAST:
            rows.append((name, count, "-", "-", "-", "-", "-", "-"))
            continue
        values = scores[stills, k]
        low, high = auroc_interval(values, positive, groups, np.random.default_rng(0))
        said = _said(values, positive, groups)
        precision = (said & positive).sum() / max(said.sum(), 1)
        recall = (said & positive).sum() / count
        f1 = 2 * precision * recall / max(precision + recall, 1e-9)
        figures = (auroc(values, positive), precision, recall, f1)
        a, p, r, f = (f"{value:.3f}" for value in figures)
        rows.append((name, count, a, f"{low:.3f} to {high:.3f}", f"{WANTED[by][name]:.2f}", p, r, f))
    title = f"{len(stills)} stills, five folds by {by}, out-of-fold scores pooled"
    print_table(title, ("class", "positive", "AUROC", "95 % interval", "wanted", "precision", "recall", "F1"), rows)


def _ablation(wanted: Wanted) -> None:
    boxes = wanted.data.parent / "cctv_boxes"
    sources = {
        "stills alone": replace(wanted, rendered=0),
        "stills, boxes": replace(wanted, rendered=0, boxes=boxes),
        "stills, rendered": wanted,
        "stills, boxes, rendered": replace(wanted, boxes=boxes),
        **{f"stills, rendered; by {name}": replace(wanted, told_by=telling) for name, telling in _tellings().items()},
    }
    rows = []
    for name, one in sources.items():
        lessons, scores = train_scores(one, _note)
        stills = [k for k, lesson in enumerate(lessons) if lesson.kind == "stills"]
        values = [
            auroc(scores[stills, k], np.array([lessons[row].labels[k] > 0 for row in stills])) for k in range(len(CLASSES))
        ]
        rows.append((name, len(lessons), *("-" if np.isnan(value) else f"{value:.3f}" for value in values)))
    print_table(f"AUROC on the stills, five folds by {wanted.by}", ("learnt from", "pictures", *CLASSES), rows)


def _tellings() -> dict[str, Telling]:
    """What tells every class in the ablation, instead of what each class has."""
    return {
        "mean and deviation": Telling({"mean": 1.0, "deviation": 1.0}),
        "own moments": Telling({"own moments": 1.0}),
        "own moments, inside": Telling({"own moments": 1.0}, inside=True),
        "own root": Telling({"own root": 1.0}),
        "own root, finer two depths": Telling({"own root": 1.0}, taps=TAPS[:2]),
        "own root, broad own moments, finer two depths": TOLD_BY["displaced joint"],
        "mean, deviation, own root": USUAL,
        "mean, deviation, own root, inside": replace(USUAL, inside=True),
        "both moments": Telling({"own moments": 1.0, "moments": 1.0}),
        "both moments, broad too": replace(TOLD_BY["deposit"], ridge=RIDGE),
        "both moments, broad too, less stiff": TOLD_BY["deposit"],
    }


def _said(values: Any, positive: Any, groups: list[str]) -> Any:
    """Which pictures are said to have the class, at thresholds for PRECISION that come from other groups."""
    fold = grouped_folds(groups, positive[:, None].astype(np.float32), 5, np.random.default_rng(1))
    said = np.zeros(len(values), bool)
    for k in range(5):
        held = fold == k
        said[held] = values[held] >= threshold_for(values[~held], positive[~held], PRECISION)
    return said


def _note(line: str) -> None:
    print(line, file=sys.stderr, flush=True)


if __name__ == "__main__":
    main()
