"""Whose is which: global nearest neighbour between all detections and all landmarks, the landmarks held fixed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from estimators.landmarks import association
from estimators.landmarks.ekf import wrap
from estimators.landmarks.projection import NEAREST
from estimators.landmarks.refine.run import LONG_FROM, Run, Spot, distance2_of

Array = NDArray[np.float64]
Index = NDArray[np.intp]

GATE = 11.8
"""Chi-squared of two degrees of freedom at 99.7 %: one look more at what the mapper's narrower gate left out."""
BEYOND = 1.25
"""Farther off than this many times as far as the detector sees nothing is a sighting."""


def own(
    run: Run,
    spots: list[Spot],
    pixel_std: float,
    far: float,
) -> list[Spot]:
    """Each landmark with its own detections: one a frame by global nearest neighbour; a long one has what else lies on it."""
    if not spots:
        return []
    count = len(run.detections.frame)
    everything = np.arange(count)
    cost = np.full((count, len(spots)), np.inf)
    for k, spot in enumerate(spots):
        near = everything[
            (run.frames.position[run.detections.frame] < spot.high - NEAREST)
            & (run.frames.position[run.detections.frame] > spot.low - BEYOND * far)
            & (np.abs(wrap(run.detections.angle - spot.angle)) < np.pi / 2)
        ]
        distance2 = distance2_of(run, near, spot, pixel_std)
        told = np.log(spot.belief @ run.matrix[:, run.detections.label[near]])
        cost[near, k] = np.where(distance2 < GATE, distance2 - 2 * told - GATE - 8.0, np.inf)
    owner = np.full(count, -1)
    useful = np.flatnonzero((cost < 0).any(axis=1))
    for group in np.split(useful, np.flatnonzero(np.diff(run.detections.frame[useful])) + 1):
        if len(group) == 1:
            owner[group[0]] = int(np.argmin(cost[group[0]]))
        elif len(group):
            rows, columns = association.assign(cost[group])
            owner[group[rows]] = columns
    long = [run.names[spot.label] in run.config.long_classes and spot.high - spot.low > LONG_FROM for spot in spots]
    for k in (place for place, reaches in enumerate(long) if reaches):
        also = (owner < 0) & (cost[:, k] < -8.0) & (run.detections.label == spots[k].label)
        owner[also] = k
    return [
        replace(spot, rows=np.flatnonzero(owner == k), belief=_believe(run, np.flatnonzero(owner == k)))
        for k, spot in enumerate(spots)
    ]


def _believe(run: Run, rows: Index) -> Array:
    """Belief in each class from all labels (Bayes, even prior)."""
    logs = np.log(run.matrix[:, run.detections.label[rows]]).sum(axis=1)
    shares = np.exp(logs - logs.max())
    return np.asarray(shares / shares.sum(), dtype=np.float64)
