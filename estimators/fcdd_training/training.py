"""Training of the late trunk and the head from features of the early trunk, which are computed once for every augmentation.

The early trunk is not trained (417 pictures would spoil it), so what it makes of an augmented picture can be kept; that makes
an epoch some fifty times cheaper on a processor than training from pictures.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from estimators.fcdd_training.network import Fcdd, loss, score

Half = NDArray[np.float16]
Floats = NDArray[np.float32]


class Tap(Protocol):
    """Features of one tap, an array (augmentations, n, channels, h, w) or something that is read like one."""

    def __len__(self) -> int: ...

    def __getitem__(self, chosen: Any, /) -> Half:
        """``[k]`` is one augmentation of all pictures, ``[ks, rows]`` a batch of pictures, each of its own."""


@dataclass(frozen=True)
class TrainConfig:
    """``steps`` of ``batch`` pictures. ``rate`` and ``head_rate`` are the highest learning rates, reached after a tenth of the
    steps and let down to nothing by a cosine. ``mixup`` is the parameter of the Beta distribution, 0 for none. ``decay`` is
    the weight decay, ``average`` the memory of the average over the weights of the last steps. Blocks from ``first`` on are
    trained, and a head of ``hidden`` channels. ``keep`` of the weights stay as they were before: half-way between what
    ImageNet taught and what few pictures teach, pictures of cameras that were not seen are told apart best
    (Wortsman et al. 2022, Robust fine-tuning of zero-shot models)."""

    steps: int = 160
    batch: int = 32
    rate: float = 4e-4
    head_rate: float = 4e-3
    decay: float = 0.02
    dropout: float = 0.1
    mixup: float = 0.2
    average: float = 0.97
    first: int = 16
    hidden: int = 96
    keep: float = 0.0


@dataclass(frozen=True)
class Material:
    """What is learnt from. ``features`` of each tap of the untouched trunk, ``labels``
    and ``weights`` (n, classes), ``share`` (n,) how often each picture is drawn (sums to 1). ``features`` of all taps train a
    head; of them only those before the trained blocks train these."""

    features: tuple[Tap, ...]
    labels: Floats
    weights: Floats
    share: NDArray[np.float64]


def fit(
    material: Material,
    rows: NDArray[np.int64],
    config: TrainConfig,
    pretrained: Mapping[str, Tensor],
    seed: int,
    head: Mapping[str, Tensor] | None = None,
    progress: Callable[[int, float], None] | None = None,
) -> Fcdd:
    """A network whose maps without context are trained on ``rows`` of the material; ``head`` is one to go on with;
    ``progress`` is told each step and its loss."""
    torch.manual_seed(seed)
    rng = np.random.default_rng([seed, 81])
    net = Fcdd(material.labels.shape[1], config.first, config.hidden, config.dropout)
    if net.trunk is not None:
        net.trunk.load(pretrained)
    if head is not None:
        net.head.load_state_dict(head)
    else:
        _measure_scales(net, material, rows)
    net = net.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
    _train_mode(net)
    optimizer = torch.optim.AdamW(
        [
            {
                "params": [] if net.trunk is None else list(net.trunk.parameters()),
                "lr": config.rate,
                "weight_decay": config.decay,
            },
            {"params": list(net.head.parameters()), "lr": config.head_rate, "weight_decay": config.decay},
        ]
    )
    schedule = torch.optim.lr_scheduler.LambdaLR(optimizer, lambda step: _rate(step / config.steps))
    begun = {name: value.detach().clone() for name, value in net.state_dict().items()}
    averaged = {name: value.clone() for name, value in begun.items()}
    share = material.share[rows] / material.share[rows].sum()
    for step in range(config.steps):
        x, y, w = _batch(material, net.given, rows[rng.choice(len(rows), config.batch, p=share)], config, rng)
        value = loss(net.head.local(net.taps(x)), y, w)
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
    for name, value in averaged.items():
        if value.is_floating_point():
            value.lerp_(begun[name], config.keep)
    net.load_state_dict(averaged)
    net.eval()
    return net


def predict(net: Fcdd, features: tuple[Half, ...], batch: int = 64) -> Floats:
    """The score z_ik (n, classes) of the taps' features (n, channels, h, w), eq. 9."""
    found = []
    with torch.no_grad():
        for k in range(0, len(features[0]), batch):
            x = tuple(_tensor(tap[k : k + batch]) for tap in features[: net.given])
            found.append(score(net(x)).numpy())
    return np.concatenate(found)


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
    material: Material, taps: int, chosen: NDArray[np.int64], config: TrainConfig, rng: np.random.Generator
) -> tuple[tuple[Tensor, ...], Tensor, Tensor]:
    versions = rng.integers(0, len(material.features[0]), len(chosen))
    x = tuple(_tensor(tap[versions, chosen]) for tap in material.features[:taps])
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


def _train_mode(net: Fcdd) -> None:
    """Batch norm keeps the statistics of ImageNet: those of a few hundred pictures are worse."""
    net.train()
    for module in net.modules():
        if isinstance(module, nn.BatchNorm2d):
            module.eval()


def _measure_scales(net: Fcdd, material: Material, rows: NDArray[np.int64]) -> None:
    """The head sees features of mean 0 and deviation 1, as the frozen trunk makes them."""
    for scale, tap in zip(net.head.scales, material.features, strict=True):
        some = tap[0][rows].astype(np.float32)
        scale.running_mean = torch.from_numpy(some.mean(axis=(0, 2, 3)))
        scale.running_var = torch.from_numpy(some.var(axis=(0, 2, 3)))


def _tensor(values: Half) -> Tensor:
    return torch.from_numpy(values.astype(np.float32)).contiguous(memory_format=torch.channels_last)
