"""Paints the landmarks of a virtual pipe onto its unrolled wall."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.virtual.landmarks import Thing
from drivers.virtual.look import Look

Array = NDArray[np.float32]


@dataclass(frozen=True)
class Brush:
    """A ``tile`` (n, m, 3) of the wall under the brush, its chainages ``z`` (n,) and angles (m,), painted in place."""

    tile: Array
    z: Array
    angle: Array
    radius: float
    look: Look
    seed: int

    def rows(self, begin: float, end: float) -> slice:
        """The rows of the tile from chainage ``begin`` to ``end``; empty where it does not reach so far."""
        first, last = np.searchsorted(self.z, (begin, end))
        return slice(int(first), int(last))

    def around(self, angle: float) -> Array:
        """Angle (m,) from ``angle`` to every column, in (-pi, pi]."""
        return np.asarray(np.angle(np.exp(1j * (self.angle - angle))), np.float32)


def paint_thing(brush: Brush, thing: Thing, index: int) -> None:
    """Paint one landmark where it lies on the tile."""
