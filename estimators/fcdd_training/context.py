"""The rule by which the whole picture raises or lowers the map of a class: a logistic regression on moments of features.

It is fitted on what the trunk makes of pictures before it is tuned to them: a tuned trunk tells the pictures that it was
tuned on apart too well for another rule to be learnt from it.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from estimators.fcdd_training.network import Head, moments
from estimators.fcdd_training.training import Half, Material

DECAY = 0.2
"""Ridge on standardised moments; of 0.01 to 4 the best on unseen clusters and collections."""
GAIN = 0.6
"""Of the logit, which varies over pictures some 2.5 times as much as the logarithm of the mean of a map: the context counts
somewhat more than the map."""
LEAST = 12
"""A class with fewer pictures has no context."""
VERSIONS = 4


def fit_context(head: Head, material: Material, rows: NDArray[np.int64], versions: int = VERSIONS) -> None:
    """Gives ``head`` a context from ``rows`` of the material, each as often as it is drawn for training. Every class weighs as
    much as all that is not of it."""
    parts = [_moments(head, tuple(tap[version] for tap in material.features), rows) for version in range(versions)]
    x, y = torch.cat(parts), torch.from_numpy(material.labels[rows])
    weights = torch.from_numpy(material.weights[rows] * material.share[rows, None].astype(np.float32))
    here = weights * y, weights * (1 - y)
    known = (here[0] > 0).sum(dim=0) >= LEAST
    balanced = sum(0.5 * side / side.sum(dim=0).clamp(min=1e-9) for side in here)
    assert isinstance(balanced, Tensor)
    mean, spread = x.mean(dim=0), x.std(dim=0) + 1e-3
    weight, bias = _logistic((x - mean) / spread, y.repeat(versions, 1), balanced.repeat(versions, 1) / versions)
    rule = head.context.rule
    with torch.no_grad():
        raw = GAIN * weight / spread[:, None]
        rule.weight.copy_((raw * known).T)
        rule.bias.copy_((GAIN * bias - mean @ raw) * known)


def _moments(head: Head, features: tuple[Half, ...], rows: NDArray[np.int64], batch: int = 64) -> Tensor:
    found = []
    with torch.no_grad():
        for k in range(0, len(rows), batch):
            chosen = tuple(torch.from_numpy(tap[rows[k : k + batch]].astype(np.float32)) for tap in features)
            found.append(torch.cat([moments(tap) for tap in head.scaled(chosen)], dim=1))
    return torch.cat(found)


def _logistic(x: Tensor, y: Tensor, weights: Tensor) -> tuple[Tensor, Tensor]:
    """Weights (channels, classes) and biases (classes,) of one logistic rule per class."""
    weight = torch.zeros(x.shape[1], y.shape[1], requires_grad=True)
    bias = torch.zeros(y.shape[1], requires_grad=True)
    optimizer = torch.optim.LBFGS([weight, bias], max_iter=50, line_search_fn="strong_wolfe")

    def closure() -> Tensor:
        optimizer.zero_grad()
        each = functional.binary_cross_entropy_with_logits(x @ weight + bias, y, reduction="none")
        value = (weights * each).sum() + DECAY * (weight**2).sum()
        value.backward()  # type: ignore[no-untyped-call]
        return value

    optimizer.step(closure)  # type: ignore[no-untyped-call]
    return weight.detach(), bias.detach()
