"""The rule by which the whole picture tells whether it shows a class: ridge regression on traits of its features."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from estimators.fcdd_training.network import MOMENTS, TAPS, Context
from estimators.fcdd_training.training import Floats, Material, Tap

RIDGE = 1.5e-3
"""On traits of which each kind has a mean square of its weight over the number of weights; pictures weigh 1 in all."""
LEAST = 12
"""A class with fewer pictures has no rule."""
VERSIONS = 2
"""Of each picture: plain and mirrored. Augmented ones made unseen archives no easier."""
SLOPE = 2.0
"""Of the logit over the rule's output, which is +-1 for what it is sure of: sigmoid(2 x) has the slope of (1 + x) / 2 at 0."""


@dataclass(frozen=True)
class Telling:
    """By what a class is told. ``counts`` says how much each kind of traits counts, ``taps`` of which depths of the trunk,
    ``inside`` that the border of the picture is not looked at; such a class is learnt from closer pictures as well. ``ridge``
    is how stiff the rule is."""

    counts: Mapping[str, float]
    inside: bool = False
    taps: tuple[int, ...] = TAPS
    ridge: float = RIDGE


USUAL = Telling({"mean": 1.0, "deviation": 1.0, "own root": 2.0})
TOLD_BY: Mapping[str, Telling] = {
    # what lies at the invert has another colour than the wall, and is large; how coarse it is tells less
    "deposit": Telling(dict.fromkeys(MOMENTS, 1.0), ridge=RIDGE / 3),
    # an edge and its shadow, sharp and as a whole: neither colour nor light of the pipe nor what kind of thing it is, which the
    # last depth knows; the near joint lies along the border
    "displaced joint": Telling({"own root": 1.0, "broad own moments": 1.0}, taps=TAPS[:2]),
    "fracture": Telling(USUAL.counts, inside=True),
    "roots": Telling({"own moments": 1.0}, inside=True),
}
"""Classes that are told otherwise than usual."""


def traits_of(context: Context, features: Sequence[Tap], rows: NDArray[np.int64], batch: int = 64) -> Floats:
    """Traits (VERSIONS, rows, traits) of pictures, whose ``features`` are of each tap."""
    found = []
    with torch.no_grad():
        for version in range(VERSIONS):
            taps = [tap[version][rows] for tap in features]
            parts = [
                context.traits(tuple(torch.from_numpy(tap[k : k + batch].astype(np.float32)) for tap in taps)).numpy()
                for k in range(0, len(rows), batch)
            ]
            found.append(np.concatenate(parts))
    return np.stack(found)


def measure_textures(context: Context, material: Material, rows: NDArray[np.int64]) -> None:
    """Sets what the textures of ``context`` project on, from the plain pictures of ``rows``; no label counts."""
    for texture, tap in zip(context.textures, material.features, strict=True):
        texture.measure(torch.from_numpy(tap[0][rows].astype(np.float32)))


def fit_context(
    context: Context,
    material: Material,
    shares: Floats,
    rows: NDArray[np.int64],
    names: tuple[str, ...],
    told_by: Telling | None = None,
) -> None:
    """Fits ``context``, whose textures are measured, to the pictures ``rows``; ``shares`` (n,) is how much each picture counts.
    ``names`` are the classes of the first columns, which alone get a rule; ``told_by`` is for all of them alike, None for each
    its own. Every class weighs as much as all that is not it."""
    seen, closer = (
        torch.from_numpy(traits_of(context, features, rows)).flatten(0, 1) for features in (material.features, material.closer)
    )
    share = torch.from_numpy(np.tile(shares[rows], VERSIONS)).float()
    share = share / share.sum()
    mean = share @ seen
    spread = torch.sqrt(share @ (seen - mean) ** 2) + 1e-3
    x = (torch.cat([seen, closer]) - mean) / spread
    labels = np.tile(material.labels[rows], (VERSIONS, 1))
    weights = np.tile(material.weights[rows], (VERSIONS, 1)) * share.numpy()[:, None]
    for column, name in enumerate(names):
        if (material.labels[rows, column] * material.weights[rows, column] > 0).sum() < LEAST:
            continue
        telling = told_by or TOLD_BY.get(name, USUAL)
        scale = _scale(context, telling)
        times = 2 if telling.inside else 1
        y, w = np.tile(labels[:, column], times), np.tile(weights[:, column], times)
        weight, bias = _ridge(x[: len(y)] * scale, y, w, telling.ridge)
        with torch.no_grad():
            raw = SLOPE * weight * scale / spread
            context.rule.weight[column] = raw
            context.rule.bias[column] = SLOPE * bias - float(raw @ mean)
            context.known[column] = 1.0


def _scale(context: Context, telling: Telling) -> Tensor:
    """Of each trait (traits,): its kind counts as said, whatever the number of its traits."""
    counts = [
        telling.counts.get(group.kind, 0.0) if group.inside == telling.inside and group.tap in telling.taps else 0.0
        for group in context.groups
    ]
    sizes = [group.size for group in context.groups]
    parts = [torch.full((size,), (count / size) ** 0.5) for count, size in zip(counts, sizes, strict=True)]
    return torch.cat(parts) / sum(counts) ** 0.5


def _ridge(x: Tensor, labels: Floats, weights: Floats, ridge: float) -> tuple[Tensor, float]:
    """Weights (traits,) and bias of the rule w . x + b nearest to +-1; solved for the pictures, which are fewer than traits."""
    known = np.flatnonzero(weights > 0)
    signs = np.where(labels[known] > 0, 1.0, -1.0)
    share = weights[known].astype(np.float64)
    for side in (-1.0, 1.0):
        share[signs == side] *= 0.5 / share[signs == side].sum()
    chosen = x[torch.from_numpy(known)][:, (x != 0).any(dim=0)]
    alike = (chosen @ chosen.T).double().numpy()
    solved = np.linalg.solve(alike + ridge * np.diag(1 / share), np.column_stack([np.ones(len(known)), signs]))
    bias = float(solved[:, 1].sum() / solved[:, 0].sum())
    part = torch.from_numpy((solved[:, 1] - bias * solved[:, 0]).astype(np.float32))
    return x[torch.from_numpy(known)].T @ part, bias
