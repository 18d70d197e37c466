"""What is known of each object of the map: sightings, beliefs by Bayes alone and within what its pipes allow, its latest
clouds."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from estimators.structure.recognition import allowed_by
from estimators.structure.types import CLASSES, Array, Mask

CORRELATED = 0.1
"""Correlation of what two sightings of one object say. An object that stands badly is taken for the same other class again and
again; counted as independent, a few dozen such sightings would outweigh everything else. It is the same whether one scan was
described or several as one: a second discount would let the pipes decide against a hundred sightings."""

HIDDEN = 0.3
"""Probability that the handle of a valve is not to be seen from where the vehicle goes: it points down, or away, or a pipe is
before it. That is the same at each sighting, so that many without a handle say no more against a valve than this."""
_BARE = CLASSES.index("elbow")
"""A class that has no handle: a hidden one looks the same."""


@dataclass
class View:
    """One sighting's cloud (N, 3) in the world, seen from ``eye`` (3,)."""

    eye: Array
    cloud: Array


@dataclass
class ObjectRecord:
    """``evidence`` (6,): sum of the log likelihoods of what single scans were recognised as, ``fused`` (6,) of what several
    scans together were; ``configurations``: Table 2's dispositions seen so far."""

    evidence: Array = field(default_factory=lambda: np.zeros(len(CLASSES)))
    fused: Array = field(default_factory=lambda: np.zeros(len(CLASSES)))
    configurations: set[int] = field(default_factory=set)
    ports: Array = field(default_factory=lambda: np.zeros(len(CLASSES)))
    """Log likelihoods of the pipes that the map shows to leave it."""
    handles: Array = field(default_factory=lambda: np.zeros(len(CLASSES)))
    """Sum of the log likelihoods of what stood above it, where a handle can be seen."""
    views: list[View] = field(default_factory=list)
    seen_from: list[Array] = field(default_factory=list)

    def semantic(self) -> Array:
        """Beliefs (6,) from single scans, the pipes that leave it and its handle."""
        return self._with_all(self.evidence)

    def together(self) -> Array:
        """Beliefs (6,) from single and fused scans, the pipes that leave it and its handle. Both are of the same scans: their
        mean counts, or everything would count twice."""
        return self._with_all((self.evidence + self.fused) / 2)

    def _with_all(self, evidence: Array) -> Array:
        """What was seen, weighed as so many sightings as are independent: n / (1 + (n - 1) rho); and what the map tells."""
        weight = 1 / (1 + CORRELATED * max(len(self.seen_from) - 1, 0))
        handle = np.logaddexp(np.log(1 - HIDDEN) + weight * self.handles, np.log(HIDDEN) + weight * self.handles[_BARE])
        return belief(weight * evidence + handle + self.ports, self.allowed())

    def allowed(self) -> Mask:
        """Classes (6,) that the dispositions of pipes leave; all where they contradict each other."""
        allowed = allowed_by(self.configurations)
        return allowed if allowed.any() else np.ones(len(CLASSES), dtype=bool)


def belief(evidence: Array, allowed: Mask | None = None) -> Array:
    """Probabilities (6,) of the classes from log likelihoods, zero outside ``allowed``."""
    logs = evidence if allowed is None else np.where(allowed, evidence, -np.inf)
    weights = np.exp(logs - logs.max())
    shares: Array = weights / weights.sum()
    return shares
