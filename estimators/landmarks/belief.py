"""What a landmark is, and whether it is: class by Bayes over a confusion matrix, existence by a likelihood ratio.

A detector that errs does so in bursts that stay where they are in the picture, while a point of the wall moves outward as
the crawler drives. Existence is therefore one hypothesis against another, never a count: each sighting adds
ln p(sighting | a landmark on the wall) - ln p(sighting | clutter), where clutter is either new in this frame, spread over the
picture, or the burst of the frames before, fixed in the picture. A burst that cannot be told from a landmark far ahead earns
nothing until the crawler has driven on.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

FALSE = "false"
"""The name for "no landmark at all" in a belief."""


def confusion(count: int, right: float = 0.9) -> Array:
    """P(label | class) (count, count), rows the true class: ``right`` on the diagonal, the rest spread evenly."""
    if count == 1:
        return np.ones((1, 1))
    matrix = np.full((count, count), (1.0 - right) / (count - 1))
    np.fill_diagonal(matrix, right)
    return matrix


def after_label(belief: Array, likelihood: Array, weight: Array) -> Array:
    """Belief (n, classes) after a label of ``likelihood`` P(label | class) (n, classes) that counts ``weight`` (n,) 0..1."""
    posterior = belief * likelihood ** weight[:, None]
    return np.asarray(posterior / posterior.sum(axis=1, keepdims=True), dtype=np.float64)


def named(names: Sequence[str], belief: Array, score: float) -> dict[str, float]:
    """One track's belief by name, "false" among them: existence from its log likelihood ratio ``score``."""
    real = 1.0 / (1.0 + np.exp(-np.clip(score, -50, 50)))
    named = {name: float(real * share) for name, share in zip(names, belief, strict=False)}
    return {**named, FALSE: float(1.0 - real)}


@dataclass(frozen=True)
class Errors:
    """How the detector errs. ``seen`` P(detected | visible); a miss after a miss has probability ``stay_missed`` and a false
    detection continues with ``stay_false`` in the next frame, neither for more than ``burst_frames`` frames. ``gap_frames``:
    a burst interrupted for longer is over."""

    seen: float = 0.8
    stay_seen: float = 0.95
    stay_missed: float = 0.85
    stay_false: float = 0.85
    burst_frames: int = 25
    gap_frames: int = 4


def miss_evidence(errors: Errors, run: NDArray[np.int64]) -> Array:
    """ln P(missed | landmark in view) for a track missed ``run`` (n,) times before in a row."""
    first = np.log(1.0 - errors.seen)
    beyond = np.log(0.4)
    return np.where(run == 0, first, np.where(run < errors.burst_frames, np.log(errors.stay_missed), beyond))


def gaussian(distance2: Array, log_det: Array) -> Array:
    """ln N of a two-dimensional innovation."""
    return np.asarray(-0.5 * distance2 - 0.5 * log_det - np.log(2 * np.pi), dtype=np.float64)


@dataclass(frozen=True)
class Bursts:
    """The stretch of sightings of each track that would be one burst, were it clutter: ``mean`` (n, 2) in the picture (px),
    ``count`` (n,), ``label`` (n,) of its last, ``first`` and ``last`` frame number (n,)."""

    mean: Array
    count: Array
    label: NDArray[np.int64]
    first: NDArray[np.int64]
    last: NDArray[np.int64]


def clutter_evidence(
    errors: Errors,
    bursts: Bursts,
    frame: int,
    pixels: Array,
    labels: NDArray[np.int64],
    same_label: Array,
    density: Array,
    pixel_std: float,
) -> tuple[Array, Array, Bursts]:
    """ln p(sighting | clutter) (n,), the part of it that is a burst going on (n,), and the bursts with the sighting in them.

    ``pixels`` (n, 2) are the sightings, ``same_label`` (n,) P(label | label of the burst so far), ``density`` (n,) the false
    detections of that class per frame and px^2. A burst with a gap in it pays for the gap as a landmark does.
    """
    gap = np.maximum(frame - bursts.last - 1, 0)
    broken = np.where(gap > 0, np.log(1.0 - errors.seen) + (gap - 1) * np.log(errors.stay_missed), 0.0)
    alive = (frame - bursts.last <= errors.gap_frames) & (frame - bursts.first < errors.burst_frames)
    away = pixels - bursts.mean
    spread = pixel_std**2 * (1.0 + 1.0 / bursts.count)
    distance2 = (away**2).sum(axis=1) / spread
    going_on = np.where(
        alive, np.log(errors.stay_false * same_label) + broken + gaussian(distance2, 2 * np.log(spread)), -np.inf
    )
    fresh = np.log(density)
    total = np.logaddexp(fresh, going_on)
    same = going_on > fresh
    count = np.where(same, bursts.count + 1, 1.0)
    mean = np.where(same[:, None], bursts.mean + away / count[:, None], pixels)
    first = np.where(same, bursts.first, frame)
    return total, going_on, Bursts(mean, count, labels, first, np.full_like(bursts.last, frame))
