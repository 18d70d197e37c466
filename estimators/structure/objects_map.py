"""What is known of each object of the map: sightings, beliefs by Bayes alone and within what its pipes allow, its latest
clouds."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from estimators.structure.recognition import allowed_by
from estimators.structure.types import CLASSES, Array, Mask


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
    views: list[View] = field(default_factory=list)
    seen_from: list[Array] = field(default_factory=list)

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
