"""Training of the head from features of the trunk, which are computed once for every augmentation.

The trunk is left as ImageNet taught it, so what it makes of an augmented picture can be kept; that makes an epoch some hundred
times cheaper on a processor than training from pictures.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from estimators.fcdd_training.network import Fcdd, loss

Half = NDArray[np.float16]
Floats = NDArray[np.float32]


class Tap(Protocol):
    """Features of one tap, an array (augmentations, n, channels, h, w) or something that is read like one."""

    def __len__(self) -> int: ...

    def __getitem__(self, chosen: Any, /) -> Half:
        """``[k]`` is one augmentation of all pictures, ``[ks, rows]`` a batch of pictures, each of its own."""


@dataclass(frozen=True)
class TrainConfig:
    """``steps`` of ``batch`` pictures. ``rate`` is the highest learning rate, reached after a tenth of the steps and let down
    to nothing by a cosine. ``mixup`` is the parameter of the Beta distribution, 0 for none. ``decay`` is the weight decay,
    ``average`` the memory of the average over the weights of the last steps; ``hidden`` channels."""

    steps: int = 60
    batch: int = 32
    rate: float = 5e-3
    decay: float = 0.02
    dropout: float = 0.2
    mixup: float = 0.2
    average: float = 0.97
    hidden: int = 64


@dataclass(frozen=True)
class Material:
    """What is learnt from. ``features`` of each tap of the untouched trunk, ``labels``
    and ``weights`` (n, classes), ``share`` (n,) how often each picture is drawn (sums to 1). ``closer`` are the features of
    the same pictures without their border, plain and mirrored."""

    features: tuple[Tap, ...]
    labels: Floats
    weights: Floats
    share: NDArray[np.float64]
    closer: tuple[Tap, ...]


def fit(
    material: Material,
    rows: NDArray[np.int64],
    config: TrainConfig,
    seed: int,
    progress: Callable[[int, float], None] | None = None,
) -> Fcdd:
    """A network whose maps are trained on ``rows`` of the material; ``progress`` is told each step and its loss."""
    torch.manual_seed(seed)
    rng = np.random.default_rng([seed, 81])
    net = Fcdd(material.labels.shape[1], config.hidden, config.dropout)
    _measure_scales(net, material, rows)
    net.train()
    for scale in net.head.scales:
        scale.eval()
    optimizer = torch.optim.AdamW(net.head.parameters(), lr=config.rate, weight_decay=config.decay)
    schedule = torch.optim.lr_scheduler.LambdaLR(optimizer, lambda step: _rate(step / config.steps))
    averaged = {name: value.detach().clone() for name, value in net.state_dict().items()}
    share = material.share[rows] / material.share[rows].sum()
    for step in range(config.steps):
        x, y, w = _batch(material, rows[rng.choice(len(rows), config.batch, p=share)], config, rng)
        value = loss(net(x), y, w)
        optimizer.zero_grad()
        value.backward()  # type: ignore[no-untyped-call]
        nn.utils.clip_grad_norm_(net.parameters(), 5.0)
        optimizer.step()
        schedule.step()
        memory = min(config.average, (1 + step) / (10 + step))
        with torch.no_grad():
            for name, now in net.state_dict().items():
                if now.is_floating_point():
                    averaged[name].mul_(memory).add_(now, alpha=1 - memory)
        if progress is not None:
            progress(step, float(value.detach()))
    net.load_state_dict(averaged)
    net.eval()
    return net


def fair_share(labels: NDArray[np.bool_], groups: list[str]) -> NDArray[np.float64]:
    """How often each picture is drawn (n,): every class as often as every other, pictures without any label as one class, and
    within it every group of near-duplicates alike."""
    names = np.asarray(groups)
    columns = [*labels.T, ~labels.any(axis=1)]
    share = np.zeros(len(labels))
    for column in columns:
        chosen = np.flatnonzero(column)
        if len(chosen) == 0:
            continue
        _, member, times = np.unique(names[chosen], return_inverse=True, return_counts=True)
        each = 1 / times[member]
        share[chosen] += each / each.sum()
    return np.asarray(share / share.sum(), dtype=np.float64)


def _batch(
    material: Material, chosen: NDArray[np.int64], config: TrainConfig, rng: np.random.Generator
) -> tuple[tuple[Tensor, ...], Tensor, Tensor]:
    versions = rng.integers(0, len(material.features[0]), len(chosen))
    x = tuple(_tensor(tap[versions, chosen]) for tap in material.features)
    y, w = torch.from_numpy(material.labels[chosen]), torch.from_numpy(material.weights[chosen])
    if config.mixup > 0:
        part = torch.from_numpy(rng.beta(config.mixup, config.mixup, len(chosen)).astype(np.float32))
        part = torch.maximum(part, 1 - part)
        other = torch.from_numpy(rng.permutation(len(chosen)))
        wide = part[:, None, None, None]
        x = tuple(wide * tap + (1 - wide) * tap[other] for tap in x)
        y, w = part[:, None] * y + (1 - part[:, None]) * y[other], torch.minimum(w, w[other])
    return x, y, w


def _rate(share: float) -> float:
    return share / 0.1 if share < 0.1 else 0.5 * (1 + float(np.cos(np.pi * (share - 0.1) / 0.9)))


def _measure_scales(net: Fcdd, material: Material, rows: NDArray[np.int64]) -> None:
    """The head sees features of mean 0 and deviation 1, as the frozen trunk makes them."""
    for scale, tap in zip(net.head.scales, material.features, strict=True):
        some = tap[0][rows].astype(np.float32)
        scale.running_mean = torch.from_numpy(some.mean(axis=(0, 2, 3)))
        scale.running_var = torch.from_numpy(some.var(axis=(0, 2, 3)))


def _tensor(values: Half) -> Tensor:
    return torch.from_numpy(values.astype(np.float32))
