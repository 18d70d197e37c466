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
    """``ratio`` of the scatter of the sightings to what they claim; ``alike`` (m,) how many sightings in a row of the same
    landmark count as one, their errors being alike; the same for rings (r,)."""

    ratio: float = 1.0
    alike: Array | float = 1.0
    ring_ratio: float = 1.0
    ring_alike: Array | float = 1.0

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
    cost = -float(np.sum(both / scatter.alike) + np.sum(ring_both / scatter.ring_alike))
    return Weighed(np.exp(right - both), np.exp(ring_right - ring_both), cost)


def measure(system: System, state: Array, scatter: Scatter, noise: Noise) -> Scatter:
    """The scatter that the residuals show; what it was where there are too few of them to tell."""
    weighed = weigh(system, state, scatter, noise)
    seen, rings = system.residuals(state)
    ratio, alike = _spread(seen, weighed.sightings, system.landmark, 2, scatter.ratio)
    ring_ratio, ring_alike = _spread(rings[:, None], weighed.rings, system.joint, 1, scatter.ring_ratio)
    return Scatter(ratio, alike, ring_ratio, ring_alike)


def _spread(residual: Array, weight: Array, owner: Indices, unknowns: int, before: float) -> tuple[float, Array | float]:
    """Ratio of residuals (m, d), in claimed standard deviations, and their likeness (m,), of things with ``unknowns`` each.

    Errors that are alike over a batch give it a sum that is larger than chance (the method of batch means): a burst of false
    sightings, or a detector that has its own idea of where the middle is. Each thing has its own likeness, as far as it has
    batches to tell, and the others' beside.
    """
    things = int(owner.max()) + 1 if len(owner) else 0
    sides = residual.shape[1]
    free = sides * float(weight.sum()) - unknowns * things
    if free < 30:
        return before, 1.0
    variance = float(weight @ np.sum(residual**2, axis=1)) / free
    order = np.argsort(owner, kind="stable")
    per_thing = np.bincount(owner, minlength=things)
    place = np.empty(len(owner), np.int64)
    place[order] = np.arange(len(owner)) - np.repeat(np.cumsum(per_thing) - per_thing, per_thing)
    # a last batch that is not full goes with the one before
    last = np.maximum(per_thing[owner] // BATCH - 1, 0)
    longest = int(last.max()) + 1
    batch = owner * longest + np.minimum(place // BATCH, last)
    sums = np.stack([np.bincount(batch, weight * residual[:, side], things * longest) for side in range(sides)], axis=1)
    count = np.bincount(batch, weight**2, things * longest)
    full = count > BATCH / 3
    square = np.where(full, np.sum(sums**2, axis=1) / np.where(full, count, 1.0), 0.0) / variance
    excess = square.reshape(things, longest).sum(axis=1)
    batches = sides * full.reshape(things, longest).sum(axis=1)
    # each thing's own unknowns take their share of its batches' sums
    kept = np.maximum(batches - unknowns, 0)
    common = (EXPERIENCE + excess[kept > 0].sum()) / (EXPERIENCE + kept.sum())
    own = (EXPERIENCE * common + np.where(kept > 0, excess, 0.0)) / (EXPERIENCE + kept)
    alike = np.clip(own, 1.0, BATCH)[owner]
    return float(np.clip(np.sqrt(variance), SMALLEST, LARGEST)), np.asarray(alike, dtype=np.float64)
