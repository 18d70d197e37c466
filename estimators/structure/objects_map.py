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
    """Sum of the log likelihoods of what stood above it."""
    views: list[View] = field(default_factory=list)
    seen_from: list[Array] = field(default_factory=list)

    def semantic(self) -> Array:
        """Beliefs (6,) from single scans, the pipes that leave it and its handle."""
        return belief(self._tempered(self.evidence) + self.ports, self.allowed())

    def together(self) -> Array:
        """Beliefs (6,) from fused scans, the pipes that leave it and its handle."""
        return belief(self._tempered(self.fused) + self.ports, self.allowed())

    def _tempered(self, evidence: Array) -> Array:
        """What was seen, weighed as so many sightings as are independent: n / (1 + (n - 1) rho)."""
        return np.asarray((evidence + self.handles) / (1 + CORRELATED * max(len(self.seen_from) - 1, 0)))

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
