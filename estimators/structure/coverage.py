"""How far along its line a pipe has been seen: counts of scans for each stretch of it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from estimators.structure.types import Array, Mask

BIN = 0.02
_HOLE = 0.10
"""A stretch without surface longer than this (m) is a hole: the side of a tee is less."""
_OFTEN = 0.25
"""Share of the scans that showed the best part of the line which must have shown a short part beyond a hole."""
_LONG = 0.2
"""A stretch of this length (m) is pipe, however few scans have shown it."""
_GAP = 0.4
"""A pipe ends before a hole wider than this (m): no valve is as long."""
_HALF = 400
_NEAR_END = 0.05
"""Where single scans saw it end so near (m) to the end of the slots, it ends in their middle."""


class Coverage:
    """Scans that showed the surface at each place along one line, from its own point."""

    def __init__(self) -> None:
        self._counts = np.zeros(2 * _HALF, dtype=int)
        self._begins: list[float] = []
        self._stops: list[float] = []
        self.scans = 0
        self._ends: tuple[float, float] | None = None

    def add(self, along: Array) -> None:
        """One scan showed the places ``along`` (m), the first and the last of them as far as the pipe was in view."""
        slots = np.unique(np.clip(np.floor(np.asarray(along) / BIN).astype(int) + _HALF, 0, 2 * _HALF - 1))
        self._counts[slots] += 1
        self._begins.append(float(np.min(along)))
        self._stops.append(float(np.max(along)))
        self.scans += 1
        self._ends = None

    def ends(self) -> tuple[float, float]:
        """Where it begins and ends: what only one scan of several showed does not count, nor what lies beyond a wide gap.

        A pipe goes on behind a valve, but then it is long there or seen as often as elsewhere: a short piece that few scans
        have shown beyond a hole is something else that happens to lie on the line.
        """
        if self._ends is None:  # asked for far more often than a scan comes
            self._ends = self._found_ends()
        return self._ends

    def shown(self, along: float, reach: float = 0.2) -> int:
        """How many scans showed the pipe within ``reach`` (m) of a place: so often something that sits there could be seen."""
        at, wide = int(np.floor(along / BIN)) + _HALF, round(reach / BIN)
        return int(self._counts[max(at - wide, 0) : max(at + wide + 1, 0)].max(initial=0))

    def _found_ends(self) -> tuple[float, float]:
        least = 1 if self.scans < 3 else max(2, round(0.05 * float(np.percentile(self._counts[self._counts > 0], 90))))
        where = np.flatnonzero(self._counts >= least)
        if not len(where):
            return 0.0, 0.0
        where = where[self._one_pipe(where)]
        breaks = np.flatnonzero(np.diff(where) * BIN > _GAP)
        starts = np.concatenate([[0], breaks + 1])
        stops = np.concatenate([breaks, [len(where) - 1]])
        weights = [self._counts[where[a] : where[b] + 1].sum() for a, b in zip(starts, stops, strict=True)]
        best = int(np.argmax(weights))
        low, high = (where[starts[best]] - _HALF) * BIN, (where[stops[best]] + 1 - _HALF) * BIN
        return _middle(self._begins, float(low)), _middle(self._stops, float(high))

    def _one_pipe(self, where: NDArray[np.intp]) -> Mask:
        """Which of the slots ``where`` (n,) lie on stretches between holes that are long, or were seen often."""
        label = np.concatenate([[0], np.cumsum(np.diff(where) * BIN > _HOLE)])
        stretches = [where[label == k] for k in range(label[-1] + 1)]
        seen = np.array([np.median(self._counts[stretch]) for stretch in stretches])
        long = np.array([(stretch[-1] + 1 - stretch[0]) * BIN >= _LONG for stretch in stretches])
        kept: Mask = (long | (seen >= _OFTEN * seen.max()))[label]
        return kept


def _middle(seen: list[float], end: float) -> float:
    """Where single scans ``seen`` it end, if they did about ``end``: slots end where the furthest of many did."""
    near = [place for place in seen if abs(place - end) < _NEAR_END]
    return float(np.median(near)) if near else end
