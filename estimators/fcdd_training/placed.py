"""A class learnt from where it is: cells of rendered pictures, in which the place of everything is known.

Image-level labels teach such a class little but that the picture is rendered (its score rose with every rendered picture,
whatever it showed); a cell with the thing against all cells around it cannot be told so.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch.nn import functional

from estimators.fcdd_training.network import GAIN, Places

Floats = NDArray[np.float32]

FINE = 16
"""Pixels to a side of a cell where it is counted how much of it is covered."""
MARGIN = 1.0
"""A map begins to rise so far (in units of logit) before the cell is more likely than not."""


@dataclass(frozen=True)
class CellRule:
    """A logistic rule on the features of one cell: logit = weight . x + bias."""

    weight: Floats
    bias: float

    def logits(self, features: Floats) -> Floats:
        """(n, h, w) of features (n, channels, h, w)."""
        return np.asarray(np.einsum("c,nchw->nhw", self.weight, features) + np.float32(self.bias), dtype=np.float32)


def fit_cells(cells: Floats, labels: Floats, decay: float = 3e-3, balance: float = 20.0) -> CellRule:
    """Logistic regression on ``cells`` (n, channels) with ``labels`` (n,); positives weigh ``balance`` times as much, ``decay``
    is the ridge on standardised features."""
    mean, std = cells.mean(axis=0), cells.std(axis=0) + np.float32(1e-3)
    x, y = torch.from_numpy((cells - mean) / std), torch.from_numpy(labels)
    weight = torch.zeros(cells.shape[1], requires_grad=True)
    bias = torch.zeros(1, requires_grad=True)
    optimizer = torch.optim.LBFGS([weight, bias], max_iter=80, line_search_fn="strong_wolfe")
    heavier = torch.tensor(balance)

    def closure() -> torch.Tensor:
        optimizer.zero_grad()
        value = functional.binary_cross_entropy_with_logits(x @ weight + bias, y, pos_weight=heavier)
        value = value + decay * (weight**2).sum()
        value.backward()  # type: ignore[no-untyped-call]
        return value

    optimizer.step(closure)  # type: ignore[no-untyped-call]
    raw = weight.detach().numpy() / std
    return CellRule(np.asarray(raw, np.float32), float(bias.detach()[0]) - float(raw @ mean))


def grafted(places: Places, column: int, rule: CellRule, strength: float, alone: bool) -> None:
    """Gives ``places`` the map of class ``column``. ``rule`` is on all taps' features side by side, the coarse one enlarged;
    ``strength`` is what a mean anomaly of 1 counts as a witness. ``alone``: the class has no other map."""
    start = 0
    with torch.no_grad():
        for tap in places.taps:
            tap.weight[column] = torch.from_numpy(rule.weight[start : start + tap.in_channels])[:, None, None]
            start += tap.in_channels
        places.taps[0].bias[column] = rule.bias + MARGIN
        places.strength[column], places.alone[column] = strength, float(alone)


def witness(logits: Floats) -> float:
    """The mean anomaly of a map whose cells have ``logits`` (h, w)."""
    return float((np.sqrt((GAIN * np.clip(logits + MARGIN, 0, 6)) ** 2 + 1) - 1).mean())


def covered(outline: Sequence[tuple[float, float]], size: tuple[int, int]) -> NDArray[np.bool_]:
    """Which cells of a grid of ``size`` (rows, columns) are covered by half; ``outline`` in shares of width and height."""
    rows, columns = size
    fine = np.zeros((rows * FINE, columns * FINE), np.uint8)
    corners = np.round(np.asarray(outline) * (columns * FINE, rows * FINE)).astype(np.int32)
    cv2.fillPoly(fine, [corners], (1,))
    return np.asarray(fine.reshape(rows, FINE, columns, FINE).mean(axis=(1, 3)) >= 0.5)


def cell_of(u: float, v: float, size: tuple[int, int]) -> tuple[int, int]:
    """Row and column of the cell of a grid of ``size`` (rows, columns) at a share ``u``, ``v`` of width and height."""
    rows, columns = size
    return min(max(int(v * rows), 0), rows - 1), min(max(int(u * columns), 0), columns - 1)


def around(cells: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """``cells`` (rows, columns) and their neighbours, which may show a part of the thing: neither with it nor without."""
    return np.asarray(cv2.dilate(cells.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0)
