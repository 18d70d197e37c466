"""One thing that was mapped as two, and two that were mapped as one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from estimators.landmarks.ekf import wrap
from estimators.landmarks.refine.run import LONG_FROM, Reach, Run, Spot, nearest_depth

ALIKE = (0.08, float(np.radians(8.0)))
"""Points of one class nearer to each other than this (m, rad), and two deviations more, are one."""
JOIN = 0.35
"""Two long things of one class at one clock with a smaller gap (m) are one,"""
JOIN_FAR = 1.5
"""and with a gap up to this (m) if they are never seen together."""
JOIN_ANGLE = float(np.radians(20.0))
TOGETHER = 0.4
"""Seen together less than this share of what chance would bring is never."""
LEAST_TOGETHER = 6.0
"""Frames that chance should bring, for that to be judged."""
SURELY = 0.9
"""Up to this share of how far the detector sees it counts as seeing."""
ECHO = 2.5
"""So many times oftener its neighbour is seen."""
SPLIT_GAP = 0.5
SPLIT_LEAST = 5
"""A gap (m), and near sightings on either side of it, for one to be looked at as two."""


def join(run: Run, spots: list[Spot], reach: Reach) -> list[Spot]:
    """Doubles become one: points of the same class that lie within their errors, and pieces of a long thing.

    Two pieces at one clock are one thing when they touch, or when no
    frame ever shows both, though both should have shown at once for long enough: a detector that makes one detection of a
    deposit makes it here or there.
    """
    kept: list[Spot] = []
    for spot in sorted(spots, key=lambda spot: -len(spot.rows)):
        reaches = run.names[spot.label] in run.config.long_classes
        for k, other in enumerate(kept):
            if spot.label != other.label:
                continue
            turn = abs(float(wrap(np.array([spot.angle - other.angle]))[0]))
            gap = max(spot.low - other.high, other.low - spot.high, 0.0)
            pieces = reaches and max(spot.high - spot.low, other.high - other.low) > LONG_FROM
            if pieces and gap < JOIN_FAR and turn < JOIN_ANGLE:
                same = gap < JOIN or _together(run, spot, other, reach) < TOGETHER
            else:
                sigma = np.sqrt(np.diag(spot.covariance + other.covariance))
                same = gap < ALIKE[0] + 2 * float(sigma[0]) and turn < ALIKE[1] + 2 * float(sigma[1])
            if same:
                joined = replace(other, rows=np.union1d(spot.rows, other.rows))
                if pieces:
                    joined = replace(joined, low=min(spot.low, other.low), high=max(spot.high, other.high))
                kept[k] = joined
                break
        else:
            kept.append(spot)
    return kept


def echoes(spots: list[Spot], shares: list[float], far: float) -> list[bool]:
    """Which of ``spots`` live on what strays from a neighbour: of its class, in view with it, and seen much oftener.

    ``shares`` are those of the frames in which each was seen of those in which it should have shown. In a narrow pipe far
    landmarks lie a few pixels apart, less than what a detection errs by: of a hundred detections of the one some fall nearer
    to a place beside it, always the same.
    """
    return [
        any(
            one is not other and one.label == other.label and abs(one.middle - other.middle) < far and ECHO * share < often
            for other, often in zip(spots, shares, strict=True)
        )
        for one, share in zip(spots, shares, strict=True)
    ]


def _together(run: Run, one: Spot, two: Spot, reach: Reach) -> float:
    """How often both were seen in one frame, as a share of how often that would be were they seen independently of each other.
    1 where they were not in view together for long enough to tell."""
    seen = np.zeros((2, len(run.frames.position)), dtype=bool)
    shows = run.frames.weight > 0.2
    for k, spot in enumerate((one, two)):
        seen[k, run.detections.frame[spot.rows]] = True
        near = max(nearest_depth(run.camera, run.frames.centre.mean(axis=0), spot.angle), reach.near)
        shows = shows & (spot.high - run.frames.position > near) & (spot.low - run.frames.position < SURELY * reach.far)
    first, second = seen[0] & shows, seen[1] & shows
    expected = first.sum() * second.sum() / max(int(shows.sum()), 1)
    return float((first & second).sum() / expected) if expected >= LEAST_TOGETHER else 1.0


def split(run: Run, spot: Spot, pixel_std: float, reach: Reach) -> list[Spot]:
    """Two things where one was thought to be: where its near sightings leave a gap along the pipe, and the sightings on both
    sides of it come in the same frames."""
    if spot.high - spot.low < SPLIT_GAP:
        return [spot]
    which = run.detections.frame[spot.rows]
    seen = np.maximum(run.detections.inverse_depth[spot.rows], 1e-3)
    chainage = run.frames.position[which] + 1 / seen
    spread = pixel_std / (np.sqrt(run.camera.fx * run.camera.fy) * run.camera.radius * seen**2)
    sure = np.sort(chainage[spread < 0.3 * SPLIT_GAP])
    if len(sure) < 2 * SPLIT_LEAST:
        return [spot]
    steps = np.diff(sure)[SPLIT_LEAST - 1 : len(sure) - SPLIT_LEAST]
    k = int(np.argmax(steps)) + SPLIT_LEAST - 1
    if sure[k + 1] - sure[k] < SPLIT_GAP:
        return [spot]
    below = chainage < (sure[k] + sure[k + 1]) / 2
    before = replace(spot, high=float(sure[k]), rows=spot.rows[below])
    after = replace(spot, low=float(sure[k + 1]), rows=spot.rows[~below])
    return [before, after] if _together(run, before, after, reach) > TOGETHER else [spot]
