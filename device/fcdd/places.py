"""Classes that are learnt from places: cells of rendered pictures with them against all cells around them."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from device.fcdd.lessons import Lesson
from estimators.fcdd_training.folds import auroc, grouped_folds, threshold_for

if TYPE_CHECKING:
    from estimators.fcdd_training.network import Fcdd
    from estimators.fcdd_training.training import Material

LEAST = 20
"""With fewer pictures that show it, a class is left as image-level labels made it."""
OTHERS = {"rendered": 60, "stills": 40, "boxes": 40}
"""Cells without it that are taken from one picture."""
PRECISION = 0.8
Note = Callable[[str], None]


def learn_places(
    net: Fcdd, lessons: list[Lesson], material: Material, column: int, label: str, threshold: float | None, note: Note
) -> tuple[float, float] | None:
    """Gives ``net`` a map of the class ``label``, which is ``column``, learnt from cells. ``threshold`` is that of the score
    that the class has without places, None where it is known from these alone; what is seen in places reaches it where it has
    PRECISION on unseen pipes. Returns this threshold and that of the map; None where too few pictures show the class."""
    from estimators.fcdd_training.network import GAIN
    from estimators.fcdd_training.placed import fit_cells, grafted, witness

    sure = [k for k, lesson in enumerate(lessons) if lesson.kind == "rendered" and lesson.weights[column] > 0]
    real = [k for k, lesson in enumerate(lessons) if lesson.kind != "rendered" and lesson.labels[column] == 0][::4]
    positive = np.array([any(place.label == label for place in lessons[k].places) for k in sure])
    if positive.sum() < LEAST:
        return None
    rng = np.random.default_rng(3)
    maps = _side_by_side(material, [*sure, *real])
    taken = [_cells(cells, lessons[k], label, rng) for cells, k in zip(maps, [*sure, *real], strict=True)]
    x = np.concatenate([cells for cells, _ in taken])
    y = np.concatenate([labels for _, labels in taken])
    member = np.concatenate([[lessons[k].group] * len(labels) for k, (_, labels) in zip([*sure, *real], taken, strict=True)])
    pipes = np.array([lessons[k].group for k in sure])
    fold = grouped_folds(list(pipes), positive[:, None].astype(np.float32), 4, np.random.default_rng(0))
    scores = np.zeros(len(sure))
    for number in range(4):
        held = np.flatnonzero(fold == number)
        rule = fit_cells(x[~np.isin(member, pipes[held])], y[~np.isin(member, pipes[held])])
        scores[held] = [witness(rule.logits(maps[row][None])[0]) for row in held]
    told = f"{int(positive.sum())} of {len(sure)} rendered pictures, AUROC {auroc(scores, positive):.3f} on unseen pipes"
    note(f"{label}: {told}")
    sure_of = threshold_for(scores, positive, PRECISION)
    strength = 1.0 if threshold is None else -np.log1p(-threshold) / sure_of
    grafted(net.head.places, column, fit_cells(x, y), float(strength), threshold is None)
    return float(-np.expm1(-strength * sure_of)), float(np.sqrt((2 * GAIN) ** 2 + 1) - 1)


def _side_by_side(material: Material, rows: list[int], batch: int = 32) -> list[NDArray[np.float32]]:
    """Of each row all taps side by side (channels, h, w), the coarse one enlarged, as the head sees them."""
    import torch
    from torch.nn import functional

    found: list[NDArray[np.float32]] = []
    plain = [tap[0] for tap in material.features]
    with torch.no_grad():
        for k in range(0, len(rows), batch):
            taps = [torch.from_numpy(tap[rows[k : k + batch]].astype(np.float32)) for tap in plain]
            size = taps[0].shape[2:]
            same = [tap if tap.shape[2:] == size else functional.interpolate(tap, size=size, mode="bilinear") for tap in taps]
            found.extend(torch.cat(same, dim=1).numpy())
    return found


def _cells(
    features: NDArray[np.float32], lesson: Lesson, label: str, rng: np.random.Generator
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Cells (n, channels) of one picture with their labels (n,); what borders on the thing is left out."""
    from estimators.fcdd_training.placed import around, cell_of, covered

    size = (int(features.shape[1]), int(features.shape[2]))
    here = np.zeros(size, bool)
    for place in lesson.places:
        if place.label == label:
            inside = covered(place.outline, size) if len(place.outline) > 2 else np.zeros(size, bool)
            inside[cell_of(place.u, place.v, size)] = True
            here |= inside
    without = np.argwhere(~around(here))
    cells = np.concatenate([np.argwhere(here), rng.permutation(without)[: OTHERS[lesson.kind]]])
    labels = np.concatenate([np.ones(int(here.sum())), np.zeros(len(cells) - int(here.sum()))]).astype(np.float32)
    return features[:, cells[:, 0], cells[:, 1]].T, labels
