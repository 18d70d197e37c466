"""Whether a landmark is one: the mapper's own evidence, over all frames of the run."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from estimators.landmarks import belief
from estimators.landmarks.belief import Bursts, Errors
from estimators.landmarks.projection import NEAREST
from estimators.landmarks.refine.run import Run, Spot, distance2_of, predict

Array = NDArray[np.float64]

SURE = 0.8
"""Up to this share of how far the detector sees, not to see a landmark is held against it."""


def shows_in(run: Run, spot: Spot, far: float, pixel_std: float) -> NDArray[np.bool_]:
    """In which frames (that count) some part of the landmark must show."""
    which = np.arange(len(run.frames.position))
    middle = np.clip(run.frames.position + 0.6 * far, spot.low, spot.high)
    pixels, depth = predict(run, which, middle, spot.angle)
    size = (run.camera.width - pixel_std, run.camera.height - pixel_std)
    inside = (pixels > pixel_std).all(axis=1) & (pixels < size).all(axis=1)
    return np.asarray(inside & (depth > NEAREST) & (depth < SURE * far) & (run.frames.weight > 0.2), dtype=bool)


def judge(
    run: Run,
    spot: Spot,
    shows: NDArray[np.bool_],
    density: Array,
    errors: Errors,
    pixel_std: float,
) -> tuple[float, int, int]:
    """Log likelihood ratio of a landmark's existence over all frames in which it should show, its hits and its misses.

    The mapper's own evidence (belief), but with the misses before the first sighting as well.
    """
    hit = np.zeros(len(run.frames.position), dtype=bool)
    hit[run.detections.frame[spot.rows]] = True
    order = np.flatnonzero((shows | hit) & (run.frames.weight > 0.2))
    score = _prior(run, spot, density)
    distance2 = distance2_of(run, spot.rows, spot, pixel_std)
    ratio = _sighting_ratios(run, spot, distance2, density, errors, pixel_std)
    first_row = {int(run.detections.frame[row]): k for k, row in reversed(list(enumerate(spot.rows)))}
    gone = 0
    for frame in order:
        missed = float(belief.miss_evidence(errors, np.array([gone]))[0])
        value = ratio[first_row[int(frame)]] if hit[frame] else missed
        # What lies off the mark may be a false detection where the landmark itself was missed.
        gone = gone + 1 if value <= missed else 0
        score += float(run.frames.weight[frame]) * max(float(value), missed)
    return score, int(hit[order].sum()), int((~hit[order]).sum())


def _prior(run: Run, spot: Spot, density: Array) -> float:
    """ln of how much likelier a first sighting is clutter than a landmark nobody knew of."""
    expected = run.config.landmark_rate * 0.01 / (run.camera.width * run.camera.height)
    return float(np.clip(np.log(expected / density[spot.label]), -8.0, -2.0))


def _sighting_ratios(
    run: Run,
    spot: Spot,
    distance2: Array,
    density: Array,
    errors: Errors,
    pixel_std: float,
) -> Array:
    """ln p(sighting | landmark) - ln p(sighting | clutter) of each of its own sightings; the first is in the prior."""
    ratios = np.zeros(len(spot.rows))
    bursts: Bursts | None = None
    for k, row in enumerate(spot.rows):
        frame, label = int(run.detections.frame[row]), run.detections.label[row : row + 1]
        pixels = run.detections.pixels[row : row + 1]
        if bursts is None:
            started = np.array([frame])
            bursts = Bursts(pixels.copy(), np.ones(1), label, started, started.copy())
            continue
        same = run.matrix[bursts.label, label]
        clutter, going_on, bursts = belief.clutter_evidence(
            errors, bursts, frame, pixels, label, same, density[label], pixel_std
        )
        on_wall = belief.gaussian(distance2[k : k + 1], np.full(1, 4 * np.log(pixel_std)))
        if spot.high > spot.low:
            on_wall = np.maximum(on_wall, going_on)
        told = np.log(spot.belief @ run.matrix[:, label])
        ratios[k] = float((np.log(errors.stay_seen) + told + on_wall - clutter)[0])
    return ratios
