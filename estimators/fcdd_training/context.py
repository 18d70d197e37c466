"""The rule by which the whole picture tells whether it shows a class: a logistic regression on moments of features."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from estimators.fcdd_training.network import Context, moments
from estimators.fcdd_training.training import Floats, Material

DECAY = 0.2
"""Ridge on standardised moments; of 0.01 to 4 the best on unseen clusters and collections."""
LEAST = 12
"""A class with fewer pictures has no rule."""
VERSIONS = 4


def moments_of(material: Material, versions: int = VERSIONS, batch: int = 64) -> Floats:
    """Moments (versions, n, 2 channels) of all pictures, in the order in which ``Context`` takes them."""
    found = []
    with torch.no_grad():
        for version in range(versions):
            taps = [tap[version] for tap in material.features]
            rows = [
                torch.cat([moments(torch.from_numpy(tap[k : k + batch].astype(np.float32))) for tap in taps], dim=1).numpy()
                for k in range(0, len(taps[0]), batch)
            ]
            found.append(np.concatenate(rows))
    return np.stack(found)


def fit_context(context: Context, seen: Floats, material: Material, shares: Floats, rows: NDArray[np.int64]) -> None:
    """Fits ``context`` to the moments ``seen`` of ``rows``; ``shares`` (n,) is how much each picture counts. Every class weighs
    as much as all that is not of it."""
    x = torch.from_numpy(seen[:, rows].reshape(-1, seen.shape[2]))
    y = torch.from_numpy(material.labels[rows])
    weights = torch.from_numpy(material.weights[rows] * shares[rows, None])
    here = weights * y, weights * (1 - y)
    known = (here[0] > 0).sum(dim=0) >= LEAST
    with_it, without = (0.5 * side / side.sum(dim=0).clamp(min=1e-9) for side in here)
    versions = len(seen)
    mean, spread = x.mean(dim=0), x.std(dim=0) + 1e-3
    weight, bias = _logistic((x - mean) / spread, y.repeat(versions, 1), (with_it + without).repeat(versions, 1) / versions)
    with torch.no_grad():
        raw = weight / spread[:, None]
        context.rule.weight.copy_((raw * known).T)
        context.rule.bias.copy_((bias - mean @ raw) * known)
        context.known.copy_(known.float())


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
