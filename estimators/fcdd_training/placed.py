"""A class learnt from where it is: cells of rendered pictures, in which the place of everything is known.

Image-level labels teach such a class little but that the picture is rendered (its score rose with every rendered picture,
whatever it showed); a cell with the thing against all cells around it cannot be told so.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch.nn import functional

from estimators.fcdd_training.network import Head

Floats = NDArray[np.float32]

GAIN = 3.5
"""The map's slope over the unit: a sure cell (the unit at its end, 6) has an anomaly of 20."""
MARGIN = 1.0
"""The unit begins to rise so far (in units of logit) before the cell is more likely than not."""


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


def grafted(head: Head, column: int, rule: CellRule) -> Head:
    """``head`` whose map of class ``column`` is that of the rule: one more hidden channel, ReLU6(logit + MARGIN), and nothing
    else, goes to that map. ``rule`` is on all taps' features side by side, the coarse one enlarged."""
    hidden = head.maps.in_channels
    found = Head(head.maps.out_channels, hidden + 1)
    found.scales, found.context = head.scales, copy.deepcopy(head.context)
    start = 0
    bias = rule.bias + MARGIN
    with torch.no_grad():
        for k, (old, new) in enumerate(zip(head.taps, found.taps, strict=True)):
            part = torch.from_numpy(rule.weight[start : start + new.in_channels])
            start += new.in_channels
            scale = head.scales[k]
            spread = torch.sqrt(scale.running_var + scale.eps)
            # the head sees (x - mean) / spread, the rule x
            new.weight.copy_(torch.cat([old.weight, (part * spread)[None, :, None, None]]))
            bias += float(part @ scale.running_mean)
            if new.bias is not None:
                new.bias[:hidden] = old.bias
        found.taps[0].bias[hidden] = bias
        assert found.maps.bias is not None  # a Conv2d of the head has one
        assert head.maps.bias is not None
        found.maps.weight.zero_()
        found.maps.weight[:, :hidden] = head.maps.weight
        found.maps.weight[column] = 0
        found.maps.weight[column, hidden] = GAIN
        found.maps.bias.copy_(head.maps.bias)
        found.maps.bias[column] = 0
        # and whether it is there, from its cells alone
        found.context.rule.weight[column] = 0
        found.context.rule.bias[column] = 0
        found.context.known[column] = 0
    found.eval()
    return found


def cell_of(u: float, v: float, size: tuple[int, int]) -> tuple[int, int]:
    """Row and column of the cell of a grid of ``size`` (rows, columns) at a share ``u``, ``v`` of width and height."""
    rows, columns = size
    return min(max(int(v * rows), 0), rows - 1), min(max(int(u * columns), 0), columns - 1)


def around(row: int, column: int, size: tuple[int, int]) -> NDArray[np.bool_]:
    """The cell and its neighbours, which may show a part of the thing: neither with it nor without."""
    found = np.zeros(size, bool)
    found[max(row - 1, 0) : row + 2, max(column - 1, 0) : column + 2] = True
    return found
