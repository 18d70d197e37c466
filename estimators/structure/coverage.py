"""How far along its line a pipe has been seen: counts of scans for each stretch of it."""

from __future__ import annotations

import numpy as np

from estimators.structure.types import Array

BIN = 0.02
_HALF = 400


class Coverage:
    """Scans that showed the surface at each place along one line, from its own point."""

    def __init__(self) -> None:
        self._counts = np.zeros(2 * _HALF, dtype=int)
        self.scans = 0

    def add(self, along: Array) -> None:
        """One scan showed the places ``along`` (m)."""
        slots = np.unique(np.clip((np.asarray(along) / BIN).astype(int) + _HALF, 0, 2 * _HALF - 1))
        self._counts[slots] += 1
        self.scans += 1

    def ends(self, gap: float = 0.4) -> tuple[float, float]:
        """Where it begins and ends: what only one scan of several showed does not count, nor what lies beyond a wide gap."""
        least = 1 if self.scans < 3 else max(2, round(0.05 * float(np.percentile(self._counts[self._counts > 0], 90))))
        where = np.flatnonzero(self._counts >= least)
        if not len(where):
            return 0.0, 0.0
        breaks = np.flatnonzero(np.diff(where) * BIN > gap)
        starts = np.concatenate([[0], breaks + 1])
        stops = np.concatenate([breaks, [len(where) - 1]])
        weights = [self._counts[where[a] : where[b] + 1].sum() for a, b in zip(starts, stops, strict=True)]
        best = int(np.argmax(weights))
        return (where[starts[best]] - _HALF) * BIN, (where[stops[best]] + 1 - _HALF) * BIN
