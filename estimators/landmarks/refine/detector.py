"""What the landmarks say of the detector: its noise, how far it sees, how often, and how often it sees what is not there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

from estimators.landmarks.belief import Errors
from estimators.landmarks.ekf import wrap
from estimators.landmarks.refine.own import GATE
from estimators.landmarks.refine.run import LONG_FROM, Granted, Reach, Run, Spot, nearest_depth
from estimators.landmarks.types import Landmark

Array = NDArray[np.float64]

BEFORE_BORDER = 1.2
"""A point last seen so many times as deep as where it leaves the picture was lost before."""
SHARE = 0.02
"""Standard deviation of the logarithm of a landmark's distance from the axis, before anything was seen."""
MOST_CENTRE, MOST_SHARE = 60.0, 0.15
"""A focus of expansion (px) and a radius (logarithm) further off than this would be seen otherwise."""
POINTS = 2
"""So many point landmarks tell how near the detector sees."""


def noise(run: Run, spots: list[Spot], pixel_std: float) -> float:
    """Noise (px) of one axis across the ray: that is free of the tether and of where on a long thing the detector looks.

    Residuals stop at the gate; the deviation of the whole is that of the part within, made good for what was cut off.
    """
    residuals: list[Array] = []
    for spot in spots:
        if len(spot.rows) >= 20:
            which = run.detections.frame[spot.rows]
            radius = np.hypot(*(run.detections.pixels[spot.rows] - run.frames.centre[which]).T)
            residuals.append(np.abs(wrap(run.detections.angle[spot.rows] - spot.angle)) * radius)
    if not residuals:
        return pixel_std
    limit = np.sqrt(GATE) * pixel_std
    everything = np.concatenate(residuals)
    median = float(np.median(everything[everything < limit]))
    estimate = pixel_std
    for _ in range(50):
        inside = 2 * float(ndtr(limit / estimate)) - 1
        estimate = median / float(ndtri(0.5 + 0.25 * inside))  # the median of |x| where |x| < limit
    return float(np.clip(estimate, 0.5 * pixel_std, 2.0 * pixel_std))


def starts(found: Sequence[Landmark], default: float) -> float:
    """How far ahead (m) the detector sees, to begin with: where the mapper's tracks began."""
    depths = [
        landmark.chainage_from - sighting.view.position
        for landmark in found
        for sighting in landmark.sightings[:3]
        if landmark.chainage_from > sighting.view.position
    ]
    return float(np.median(depths)) if depths else default


def reach(run: Run, spots: list[Spot], before: float) -> Reach:
    """How far ahead the detector sees: the depth that parts best the frames in which point landmarks were mostly seen from
    those farther off in which they were not (the likeliest step of the hit rate). And how near: where most of them were last
    seen, unless that was at the picture's border."""
    depths: list[Array] = []
    hits: list[NDArray[np.bool_]] = []
    last: list[float] = []
    for spot in spots:
        if spot.high - spot.low < LONG_FROM and len(spot.rows) >= 20:
            depth = spot.middle - run.frames.position
            hit = np.zeros(len(depth), dtype=bool)
            hit[run.detections.frame[spot.rows]] = True
            nearest = float(np.quantile(depth[hit], 0.02))
            counted = (depth > nearest) & (depth < 3 * np.quantile(depth[hit], 0.9)) & (run.frames.weight > 0.2)
            depths.append(depth[counted])
            hits.append(hit[counted])
            border = nearest_depth(run.camera, run.frames.centre[hit].mean(axis=0), spot.angle)
            last.append(nearest if nearest > BEFORE_BORDER * border else 0.0)
    if not depths:
        return Reach(0.0, before)
    depth, hit = np.concatenate(depths), np.concatenate(hits)
    order = np.argsort(depth)
    below = np.arange(1, len(depth) + 1)
    seen = np.cumsum(hit[order])
    value = _step_likelihood(seen, below) + _step_likelihood(seen[-1] - seen, below[-1] - below)
    return Reach(float(np.median(last)), float(depth[order][int(np.argmax(value))]), near_known=len(last) >= POINTS)


def granted(run: Run, spots: Sequence[Spot]) -> Granted:
    """How wrong that is which is taken for granted, as far as the point landmarks show it, beside what is believed before.

    Each landmark's own sightings tell its errors of centre and distance from the axis more or less well; the mean of their
    squares, less what is noise in them, is the variance looked for.
    """
    before = np.array([float(np.median(run.frames.centre_std)), SHARE])
    told = [spot.errors for spot in spots if spot.errors is not None and len(spot.rows) >= 20]
    found = []
    for std, columns, most in ((before[0], (0, 1), MOST_CENTRE), (before[1], (2,), MOST_SHARE)):
        square = np.array([errors.value[k] ** 2 - errors.variance[k] for errors in told for k in columns])
        noise2 = np.array([errors.variance[k] for errors in told for k in columns])
        # those that are too noisy to tell a usual error say next to nothing, unless theirs is far greater
        scale2 = std**2 + np.maximum(square, 0.0) / 4
        weight = (scale2 / (scale2 + noise2)) ** 2
        variance = (std**2 + float(weight @ square)) / (1.0 + float(weight.sum()))
        found.append(float(np.clip(np.sqrt(max(variance, 0.0)), std / 2, most)))
    return Granted(*found)


def _step_likelihood(seen: NDArray[np.int64], of: NDArray[np.int64]) -> Array:
    """Greatest ln likelihood of ``seen`` hits ``of`` so many frames at an even rate."""
    rate = (seen + 0.5) / (of + 1.0)
    return np.asarray(seen * np.log(rate) + (of - seen) * np.log1p(-rate), dtype=np.float64)


def errors_of(run: Run, spots: Sequence[Spot], shown: Sequence[NDArray[np.bool_]]) -> Errors:
    """The detector's recall as the landmarks show it: the median share of frames in which one that should show was seen."""
    shares = []
    for spot, shows in zip(spots, shown, strict=True):
        if shows.sum() >= 20 and len(spot.rows) >= 20:
            hit = np.zeros(len(shows), dtype=bool)
            hit[run.detections.frame[spot.rows]] = True
            shares.append(float((hit & shows).sum() / shows.sum()))
    return replace(run.config.errors, seen=float(np.clip(np.median(shares), 0.3, 0.95))) if shares else run.config.errors


def false_density(run: Run, spots: Sequence[Spot]) -> Array:
    """False detections per frame and px^2 of each class: what belongs to no landmark."""
    free = np.ones(len(run.detections.frame), dtype=bool)
    for spot in spots:
        free[spot.rows] = False
    number = np.bincount(run.detections.label[free], minlength=len(run.names))
    area = run.camera.width * run.camera.height
    return np.asarray((number + 5.0) / (max(len(run.frames.position), 1) * area), dtype=np.float64)
