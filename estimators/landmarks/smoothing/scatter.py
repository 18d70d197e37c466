"""How far sightings scatter: which are something else, how large the scatter of the others is, and how alike it stays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimators.landmarks.smoothing.system import System
from estimators.landmarks.smoothing.types import Array, Indices, Noise

BATCH = 12
"""Sightings in a row of one thing over which their common error is looked for."""
EXPERIENCE = 10.0
"""Batches' worth of belief that errors are independent."""
SMALLEST, LARGEST = 0.2, 5.0


@dataclass(frozen=True)
class Scatter:
    """``ratio`` of the scatter of the sightings to what they claim; ``alike``, how many sightings in a row count as one (their
    errors being alike); the same for rings."""

    ratio: float = 1.0
    alike: float = 1.0
    ring_ratio: float = 1.0
    ring_alike: float = 1.0

    def tempered(self, factor: float) -> Scatter:
        return Scatter(self.ratio * factor, self.alike, self.ring_ratio * factor, self.ring_alike)


@dataclass(frozen=True)
class Weighed:
    """How likely each sighting (m,) and ring (r,) is what it is taken for, and minus the log likelihood of all of them."""

    sightings: Array
    rings: Array
    cost: float


def weigh(system: System, state: Array, scatter: Scatter, noise: Noise) -> Weighed:
    """A sighting is either of its landmark, with a normal error, or of anything else around there."""
    seen, rings = system.residuals(state)
    std, ring_std = system.run.sightings.std * scatter.ratio, system.run.rings.std * scatter.ring_ratio
    right = np.log((1 - noise.outliers) / (2 * np.pi * std**2)) - 0.5 * np.sum(seen**2, axis=1) / scatter.ratio**2
    wrong = np.log(noise.outliers / noise.outlier_span**2)
    ring_right = np.log((1 - noise.outliers) / (np.sqrt(2 * np.pi) * ring_std)) - 0.5 * (rings / scatter.ring_ratio) ** 2
    ring_wrong = np.log(noise.outliers / noise.outlier_span)
    both, ring_both = np.logaddexp(right, wrong), np.logaddexp(ring_right, ring_wrong)
    cost = -float(both.sum() / scatter.alike + ring_both.sum() / scatter.ring_alike)
    return Weighed(np.exp(right - both), np.exp(ring_right - ring_both), cost)


def measure(system: System, state: Array, scatter: Scatter, noise: Noise) -> Scatter:
    """The scatter that the residuals show; what it was where there are too few of them to tell."""
    weighed = weigh(system, state, scatter, noise)
    seen, rings = system.residuals(state)
    ratio, alike = _spread(seen, weighed.sightings, system.landmark, 2, scatter.ratio)
    ring_ratio, ring_alike = _spread(rings[:, None], weighed.rings, system.joint, 1, scatter.ring_ratio)
    return Scatter(ratio, alike, ring_ratio, ring_alike)


def _spread(residual: Array, weight: Array, owner: Indices, unknowns: int, before: float) -> tuple[float, float]:
    """Ratio and likeness of residuals (m, d), in claimed standard deviations, of things with ``unknowns`` each."""
    things = len(np.unique(owner))
    free = residual.shape[1] * float(weight.sum()) - unknowns * things
    if free < 30:
        return before, 1.0
    variance = float(weight @ np.sum(residual**2, axis=1)) / free
    order = np.argsort(owner, kind="stable")
    _, start = np.unique(owner[order], return_index=True)
    place = np.empty(len(owner), np.int64)
    place[order] = np.arange(len(owner)) - np.repeat(start, np.diff(np.append(start, len(owner))))
    _, batch = np.unique(np.stack([owner, place // BATCH]), axis=1, return_inverse=True)
    batch = batch.ravel()
    sums = np.stack([np.bincount(batch, weight * residual[:, d]) for d in range(residual.shape[1])], axis=1)
    count = np.bincount(batch, weight**2)
    full = count > BATCH / 3
    batches = int(full.sum()) * residual.shape[1]
    # each thing's own unknowns take their share of the batches' sums
    kept = max(batches - unknowns * things, 1)
    common = float(np.sum(sums[full] ** 2 / count[full, None])) / variance if batches else 0.0
    alike = (EXPERIENCE + common * batches / kept) / (EXPERIENCE + batches)
    return float(np.clip(np.sqrt(variance), SMALLEST, LARGEST)), float(np.clip(alike, 1.0, BATCH))
