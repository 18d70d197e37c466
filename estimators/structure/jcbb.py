"""Joint compatibility branch and bound (Neira and Tardos 2001; paper, Sec. 4.5 and 4.6): which observation shows which feature.

Candidates are pairs that fit one by one; the largest set of pairs that fit together wins, the one with the least distance among
several.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from estimators.structure.types import Array

_GATES: dict[tuple[int, float], float] = {}


@dataclass(frozen=True)
class Candidate:
    """Observation ``seen`` may show feature ``feature``; its rows in the joint innovation are ``rows``."""

    seen: int
    feature: int
    rows: slice


def gate(dimensions: int, share: float = 0.99) -> float:
    """The squared distance that ``share`` of true pairs stay below."""
    key = (dimensions, share)
    if key not in _GATES:
        _GATES[key] = float(chi2.ppf(share, dimensions))
    return _GATES[key]


def associate(candidates: list[Candidate], innovation: Array, covariance: Array, most: int = 3000) -> list[Candidate]:
    """The best jointly compatible set. ``innovation`` (m,) and ``covariance`` (m, m) are those of all candidates stacked.

    At most ``most`` sets are looked at, the likeliest first; the best so far is returned then.
    """
    ordered: dict[int, list[tuple[float, Candidate]]] = {}
    for candidate in candidates:
        rows = candidate.rows
        part = innovation[rows]
        distance = float(part @ np.linalg.solve(covariance[rows, rows], part))
        if distance < gate(len(part)):
            ordered.setdefault(candidate.seen, []).append((distance, candidate))
    # the observation with the fewest candidates first: what is certain prunes what is not
    levels = sorted(ordered.values(), key=lambda pairs: (len(pairs), min(d for d, _ in pairs)))
    for pairs in levels:
        pairs.sort(key=lambda pair: pair[0])
    search = _Search(levels, innovation, covariance, most)
    search.go(0, [], set())
    return search.best


class _Search:
    def __init__(self, levels: list[list[tuple[float, Candidate]]], innovation: Array, covariance: Array, most: int) -> None:
        self._levels, self._innovation, self._covariance, self._left = levels, innovation, covariance, most
        self.best: list[Candidate] = []
        self._best_distance = np.inf

    def go(self, level: int, chosen: list[Candidate], taken: set[int], distance: float = 0.0) -> None:
        if len(chosen) + len(self._levels) - level < len(self.best) or self._left <= 0:
            return
        if level == len(self._levels):
            if (len(chosen), -distance) > (len(self.best), -self._best_distance):
                self.best, self._best_distance = list(chosen), distance
            return
        for _, candidate in self._levels[level]:
            if candidate.feature in taken:
                continue
            self._left -= 1
            together, dimensions = self._distance([*chosen, candidate])
            if together < gate(dimensions):
                self.go(level + 1, [*chosen, candidate], taken | {candidate.feature}, together)
        # without this observation: only where more pairs than the best could still come of it
        if len(chosen) + len(self._levels) - level - 1 > len(self.best) or not self.best:
            self.go(level + 1, chosen, taken, distance)

    def _distance(self, chosen: list[Candidate]) -> tuple[float, int]:
        rows = np.concatenate([np.arange(c.rows.start, c.rows.stop) for c in chosen])
        part = self._innovation[rows]
        return float(part @ np.linalg.solve(self._covariance[np.ix_(rows, rows)], part)), len(rows)
