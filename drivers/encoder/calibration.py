"""From a counter's readings to chainage: units a metre, direction, and where zero is."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

from drivers.encoder.base import Reading

Direction = Literal[1, -1]

FEWEST_STEPS = 20
"""Steps of the counter between the two points of a calibration: with fewer its own resolution spoils the scale by 2 %."""


@dataclass(frozen=True)
class Calibration:
    """chainage = direction * (value - zero) / counts_per_metre.

    ``counts_per_metre`` are units of the reading a metre: 1 for a counter that shows metres and shows them right. ``zero`` is
    the reading at chainage 0, in its own unit, so that it stays where it is when the scale or the direction is set anew.
    ``scale_std`` is the standard deviation of the scale as a share of it, where it was measured.
    """

    counts_per_metre: float = 1.0
    direction: Direction = 1
    zero: float = 0.0
    scale_std: float | None = None

    def __post_init__(self) -> None:
        if not (math.isfinite(self.counts_per_metre) and self.counts_per_metre > 0):
            raise ValueError(f"The counts per metre must be a positive number, got {self.counts_per_metre}.")
        if self.direction not in (1, -1):
            raise ValueError(f"The direction is 1 or -1, got {self.direction}.")
        if not math.isfinite(self.zero):
            raise ValueError(f"The reading at zero must be a number, got {self.zero}.")

    def metres(self, reading: Reading) -> float:
        """Chainage (m) of a reading."""
        return self.direction * (reading.value - self.zero) / self.counts_per_metre

    def quantum(self, reading: Reading) -> float:
        """The step (m) that the counter resolves."""
        return reading.quantum / self.counts_per_metre

    def zeroed_at(self, reading: Reading, chainage: float = 0.0) -> Calibration:
        """The same scale and direction, with ``reading`` at ``chainage`` (m)."""
        if not math.isfinite(chainage):
            raise ValueError(f"The chainage must be a number, got {chainage}.")
        return replace(self, zero=reading.value - self.direction * chainage * self.counts_per_metre)


def two_point(first: Reading, second: Reading, length_m: float) -> Calibration:
    """The calibration after a drive of a known length, from ``first`` (chainage 0) to ``second`` (chainage ``length_m``).

    Its ``scale_std`` is that of two readings rounded to the counter's step; what the tether stretches comes on top. Raises
    ValueError with a sentence where the two points do not tell the scale.
    """
    if not (math.isfinite(length_m) and length_m > 0):
        raise ValueError(f"The known length must be a positive number of metres, got {length_m}.")
    if first.unit != second.unit:
        raise ValueError("The two readings are of different counters: begin again at the first point.")
    moved = second.value - first.value
    quantum = max(first.quantum, second.quantum)
    if not abs(moved) >= FEWEST_STEPS * quantum:
        raise ValueError(
            f"The counter moved by {abs(moved) / quantum:.0f} steps between the two points, it needs {FEWEST_STEPS}: "
            "see that the wheel turns, or drive further."
        )
    return Calibration(
        counts_per_metre=abs(moved) / length_m,
        direction=1 if moved > 0 else -1,
        zero=first.value,
        scale_std=quantum / math.sqrt(6.0) / abs(moved),
    )
