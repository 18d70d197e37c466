"""The map once more, with all frames at hand: every landmark against every sighting of the whole run.

The mapper meets a landmark far off, where its chainage is a guess, and must decide at once. Afterwards the chainage is known
from the last sightings before it left the picture, and the first ones can be looked at again: which detections are its own
(global nearest neighbour with the landmarks held fixed), where it lies (least squares, robust), how far it reaches, and
whether the misses before and after speak against it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

from estimators.landmarks import association, belief
from estimators.landmarks.belief import Bursts, Errors
from estimators.landmarks.ekf import wrap
from estimators.landmarks.extent import fit_extent
from estimators.landmarks.mapper import MapperConfig, thumbnail_size
from estimators.landmarks.projection import NEAREST, PipeCamera, View
from estimators.landmarks.types import Evidence, Landmark, Observation, Sighting

Array = NDArray[np.float64]
Index = NDArray[np.intp]

GATE = 11.8
"""Chi-squared of two degrees of freedom at 99.7 %: one look more at what the mapper's narrower gate left out."""
ROUNDS = 3
TAIL = 4.0
"""Degrees of freedom of Student's t in the least squares: sightings of something else pull little."""
LONG_FROM = 0.12
"""Shorter than this (m) a thing is a point."""
SURE = 0.8
"""Up to this share of how far the detector sees, not to see a landmark is held against it."""
BEYOND = 1.25
"""Farther off than this many times as far as the detector sees nothing is a sighting. (At first that is not known well.)"""
JOIN = 0.35
"""Two long things of one class at one clock with a smaller gap (m) are one."""
JOIN_FAR = 1.5
"""With a gap up to this (m) they are one if never seen together."""
JOIN_ANGLE = np.radians(20.0)
TOGETHER = 0.4
LEAST_TOGETHER = 6.0
SPLIT_GAP = 0.5
SPLIT_LEAST = 5


@dataclass(frozen=True)
class Detections:
    """All detections of a run, one row each: ``frame`` is the place of its observation in the run."""

    frame: Index
    pixels: Array
    label: Index
    score: Array
    inverse_depth: Array
    """1/Z (1/m) on the wall (eq. 20)."""
    angle: Array


@dataclass(frozen=True)
class Frames:
    """All frames of a run: ``position`` (m), ``centre`` (n, 2) px, ``axis`` (n, 2) m, ``std`` (n,) of the position, ``number``
    (n,), ``time_s`` (n,), and ``weight`` (n,): how much of a fresh look each is, by how far the crawler had moved."""

    position: Array
    centre: Array
    axis: Array
    std: Array
    number: NDArray[np.int64]
    time_s: Array
    weight: Array


@dataclass(frozen=True)
class Spot:
    """A landmark while it is being worked on; ``rows`` of the Detections that are its own."""

    low: float
    high: float
    angle: float
    covariance: Array
    label: int
    belief: Array
    rows: Index

    @property
    def middle(self) -> float:
        return (self.low + self.high) / 2


@dataclass(frozen=True)
class Refined:
    """The landmarks, and what they say of the detector: its noise (px, per axis), and how far it sees (m)."""

    landmarks: list[Landmark]
    pixel_std: float
    far: float


def refine(
    camera: PipeCamera,
    observations: Sequence[Observation],
    found: Sequence[Landmark],
    config: MapperConfig,
    names: Sequence[str],
) -> Refined:
    """Landmarks of a run anew from all of its ``observations``, starting at those the mapper ``found``.

    ``names`` are the classes, those of the mapper that found them.
    """
    frames = _frames(observations, config.fresh)
    detections = _detections(camera, observations, frames, names)
    matrix = belief.confusion(len(names), config.right_label)
    spots = [_first(landmark, names) for landmark in found]
    far, pixel_std = _starts(found, 10 * camera.radius), config.pixel_std
    for turn in range(ROUNDS):
        at_most = far if turn else 3 * far
        spots = _own(camera, frames, detections, spots, matrix, names, config, pixel_std, at_most)
        far = _reach(frames, detections, spots, far)
        spots = [_fit(camera, frames, detections, spot, names, config, pixel_std, far) for spot in spots if len(spot.rows) >= 3]
        spots = _join(camera, frames, detections, spots, [names[s.label] in config.long_classes for s in spots], far)
        spots = [part for spot in spots for part in _split(camera, frames, detections, spot, pixel_std, far)]
        pixel_std = _noise(frames, detections, spots, pixel_std)
    spots = [
        spot for spot in _own(camera, frames, detections, spots, matrix, names, config, pixel_std, far) if len(spot.rows) >= 3
    ]
    shown = [_shows(camera, frames, spot, far, pixel_std) for spot in spots]
    errors = _errors(frames, detections, shown, spots, config.errors)
    density = _density(camera, frames, detections, spots, len(names))
    kept: list[Landmark] = []
    for spot, shows in sorted(zip(spots, shown, strict=True), key=lambda pair: pair[0].middle):
        score, seen, missed = _judge(camera, frames, detections, spot, shows, density, errors, matrix, config, pixel_std)
        if score > config.confirm and seen >= config.least_hits:
            kept.append(_landmark(camera, frames, detections, spot, names, score, seen, missed, len(kept) + 1))
    return Refined(kept, pixel_std, far)


# ---- laying out the run


def _frames(observations: Sequence[Observation], fresh: float) -> Frames:
    position = np.array([o.view.position for o in observations])
    moved = np.abs(np.diff(position, prepend=position[:1] - fresh))
    weight = np.zeros(len(position))
    since = 0.0
    for k, step in enumerate(moved):
        since += step
        if observations[k].detections is None:
            continue
        weight[k] = min(since / fresh, 1.0)
        since = 0.0
    return Frames(
        position,
        np.array([o.view.centre for o in observations]).reshape(-1, 2),
        np.array([o.view.axis for o in observations]).reshape(-1, 2),
        np.array([o.position_std for o in observations]),
        np.array([o.frame for o in observations], dtype=np.int64),
        np.array([o.time_s for o in observations]),
        weight,
    )


def _detections(camera: PipeCamera, observations: Sequence[Observation], frames: Frames, names: Sequence[str]) -> Detections:
    place = {name: k for k, name in enumerate(names)}
    rows = [(k, d.u, d.v, place[d.label], d.score) for k, o in enumerate(observations) for d in o.detections or ()]
    table = np.array(rows, dtype=np.float64).reshape(-1, 5)
    frame = table[:, 0].astype(np.intp)
    pixels = table[:, 1:3]
    a = (pixels[:, 0] - frames.centre[frame, 0]) / camera.fx
    b = (pixels[:, 1] - frames.centre[frame, 1]) / camera.fy
    axis = frames.axis[frame]
    along = a * axis[:, 0] + b * axis[:, 1]
    rho2 = np.maximum(a * a + b * b, 1e-12)
    depth = (along + np.sqrt(along**2 + rho2 * (camera.radius**2 - (axis**2).sum(axis=1)))) / rho2
    angle = np.arctan2(b * depth - axis[:, 1], a * depth - axis[:, 0])
    return Detections(frame, pixels, table[:, 3].astype(np.intp), table[:, 4], 1.0 / depth, angle)


def _first(landmark: Landmark, names: Sequence[str]) -> Spot:
    shares = np.array([landmark.belief.get(name, 0.0) for name in names])
    shares = shares / shares.sum() if shares.sum() > 0 else np.full(len(names), 1 / len(names))
    return Spot(
        landmark.chainage_from,
        landmark.chainage_to,
        landmark.angle,
        landmark.covariance,
        list(names).index(landmark.label),
        shares,
        np.zeros(0, dtype=np.intp),
    )


# ---- geometry of many sightings at once


def _predict(camera: PipeCamera, frames: Frames, which: Index, chainage: Array, angle: Array | float) -> tuple[Array, Array]:
    """Pixels (n, 2) of a point of the wall in the frames ``which`` (n,), and its depth (n,) (eq. 5)."""
    depth = chainage - frames.position[which]
    safe = np.maximum(depth, NEAREST)
    x = frames.axis[which, 0] + camera.radius * np.cos(angle)
    y = frames.axis[which, 1] + camera.radius * np.sin(angle)
    u = frames.centre[which, 0] + camera.fx * x / safe
    v = frames.centre[which, 1] + camera.fy * y / safe
    return np.stack([u, v], axis=1), depth


def _spread(camera: PipeCamera, depth: Array, std: Array, pixel_std: float) -> tuple[Array, Array]:
    """Standard deviations (px) of a sighting along and across the ray from the centre: the tether's error moves it along."""
    f = np.sqrt(camera.fx * camera.fy)
    return np.hypot(pixel_std, f * camera.radius / np.maximum(depth, NEAREST) ** 2 * std), np.full_like(depth, pixel_std)


def _distance2(camera: PipeCamera, frames: Frames, detections: Detections, rows: Index, spot: Spot, pixel_std: float) -> Array:
    """Squared Mahalanobis distance of detections ``rows`` to the nearest point of the landmark."""
    which = detections.frame[rows]
    seen = frames.position[which] + 1.0 / detections.inverse_depth[rows]
    chainage = np.clip(seen, spot.low, spot.high)
    expected, depth = _predict(camera, frames, which, chainage, spot.angle)
    off = detections.pixels[rows] - expected
    ray = expected - frames.centre[which]
    ray /= np.maximum(np.hypot(ray[:, 0], ray[:, 1]), 1e-6)[:, None]
    radial = (off * ray).sum(axis=1)
    across = off[:, 0] * ray[:, 1] - off[:, 1] * ray[:, 0]
    along_std, across_std = _spread(camera, depth, frames.std[which], pixel_std)
    f = np.sqrt(camera.fx * camera.fy)
    slope = f * camera.radius / np.maximum(depth, NEAREST)
    along_std = np.hypot(along_std, slope / np.maximum(depth, NEAREST) * np.sqrt(spot.covariance[0, 0]))
    across_std = np.hypot(across_std, slope * np.sqrt(spot.covariance[1, 1]))
    distance2 = (radial / along_std) ** 2 + (across / across_std) ** 2
    return np.where((depth > NEAREST) & (detections.inverse_depth[rows] > 0), distance2, np.inf)


# ---- whose is which


def _own(
    camera: PipeCamera,
    frames: Frames,
    detections: Detections,
    spots: list[Spot],
    matrix: Array,
    names: Sequence[str],
    config: MapperConfig,
    pixel_std: float,
    far: float,
) -> list[Spot]:
    """Each landmark with its own detections: one a frame by global nearest neighbour; a long one has what else lies on it."""
    if not spots:
        return []
    count = len(detections.frame)
    everything = np.arange(count)
    cost = np.full((count, len(spots)), np.inf)
    for k, spot in enumerate(spots):
        near = everything[
            (frames.position[detections.frame] < spot.high - NEAREST)
            & (frames.position[detections.frame] > spot.low - BEYOND * far)
            & (np.abs(wrap(detections.angle - spot.angle)) < np.pi / 2)
        ]
        distance2 = _distance2(camera, frames, detections, near, spot, pixel_std)
        told = np.log(spot.belief @ matrix[:, detections.label[near]])
        cost[near, k] = np.where(distance2 < GATE, distance2 - 2 * told - GATE - 8.0, np.inf)
    owner = np.full(count, -1)
    useful = np.flatnonzero((cost < 0).any(axis=1))
    for group in np.split(useful, np.flatnonzero(np.diff(detections.frame[useful])) + 1):
        if len(group) == 1:
            owner[group[0]] = int(np.argmin(cost[group[0]]))
        elif len(group):
            rows, columns = association.assign(cost[group])
            owner[group[rows]] = columns
    long = [names[spot.label] in config.long_classes and spot.high - spot.low > LONG_FROM for spot in spots]
    for k in (place for place, reaches in enumerate(long) if reaches):
        also = (owner < 0) & (cost[:, k] < -8.0) & (detections.label == spots[k].label)
        owner[also] = k
    return [
        replace(spot, rows=np.flatnonzero(owner == k), belief=_believe(spot, detections, np.flatnonzero(owner == k), matrix))
        for k, spot in enumerate(spots)
    ]


def _believe(spot: Spot, detections: Detections, rows: Index, matrix: Array) -> Array:
    """Belief in each class from all labels (Bayes, even prior)."""
    logs = np.log(matrix[:, detections.label[rows]]).sum(axis=1)
    shares = np.exp(logs - logs.max())
    return np.asarray(shares / shares.sum(), dtype=np.float64)


# ---- where it lies


def _fit(
    camera: PipeCamera,
    frames: Frames,
    detections: Detections,
    spot: Spot,
    names: Sequence[str],
    config: MapperConfig,
    pixel_std: float,
    far: float,
) -> Spot:
    """The landmark from its own sightings."""
    spot = replace(spot, label=int(spot.belief.argmax()))
    if names[spot.label] not in config.long_classes or len(spot.rows) < 12:
        return _fit_point(camera, frames, detections, spot, pixel_std)
    return _fit_long(camera, frames, detections, spot, pixel_std, far)


def _fit_point(camera: PipeCamera, frames: Frames, detections: Detections, spot: Spot, pixel_std: float) -> Spot:
    """Chainage and angle by least squares with the tails of Student's t, reweighted step by step (Gauss-Newton)."""
    which = detections.frame[spot.rows]
    pixels = detections.pixels[spot.rows]
    state = np.array([spot.middle, spot.angle])
    information = np.eye(2)
    fresh = np.maximum(frames.weight[which], 0.05)
    last = np.inf
    for _ in range(25):
        expected, depth = _predict(camera, frames, which, np.full(len(which), state[0]), state[1])
        safe = np.maximum(depth, NEAREST)
        ray = expected - frames.centre[which]
        along = -ray / safe[:, None]
        around = np.stack(
            [-camera.fx * camera.radius * np.sin(state[1]) / safe, camera.fy * camera.radius * np.cos(state[1]) / safe], 1
        )
        jac = np.stack([along, around], axis=2)
        off = pixels - expected
        # Noise grows along the ray with the tether's error.
        unit = ray / np.maximum(np.hypot(ray[:, 0], ray[:, 1]), 1e-6)[:, None]
        along_std, across_std = _spread(camera, depth, frames.std[which], pixel_std)
        white = unit[:, :, None] * unit[:, None] * (along_std**-2 - across_std**-2)[:, None, None]
        white = white + np.eye(2) * (across_std**-2)[:, None, None]
        distance2 = np.einsum("ni,nij,nj->n", off, white, off)
        weight = fresh * (TAIL + 2) / (TAIL + distance2) * (depth > NEAREST)
        gram = np.einsum("n,nia,nij,njb->ab", weight, jac, white, jac)
        pull = np.einsum("n,nia,nij,nj->a", weight, jac, white, off)
        information = gram
        step = np.linalg.solve(gram + 1e-9 * np.eye(2), pull)
        # Not across the camera in one step.
        step[0] = np.clip(step[0], -0.5 * float(np.min(np.abs(depth))) - 0.05, 1.0)
        state = state + step
        if np.abs(step).max() < 1e-5 or abs(last - np.abs(step).max()) < 1e-9:
            break
        last = float(np.abs(step).max())
    covariance = np.asarray(np.linalg.inv(information + 1e-9 * np.eye(2)), dtype=np.float64)
    return replace(spot, low=float(state[0]), high=float(state[0]), angle=float(wrap(state[1:])[0]), covariance=covariance)


def _fit_long(camera: PipeCamera, frames: Frames, detections: Detections, spot: Spot, pixel_std: float, far: float) -> Spot:
    """Extent by maximum likelihood, angle by the robust mean of the sightings' own."""
    rows = spot.rows
    which = detections.frame[rows]
    seen = detections.inverse_depth[rows]
    f_radius = np.sqrt(camera.fx * camera.fy) * camera.radius
    angle_std = pixel_std / (f_radius * np.maximum(seen, 1e-3))
    angle, angle_var = _mean_angle(detections.angle[rows], angle_std, spot.angle)
    near = nearest_depth(camera, frames.centre[which].mean(axis=0), angle)
    std = np.hypot(pixel_std / f_radius, seen**2 * frames.std[which])
    unseen = np.setdiff1d(np.flatnonzero(frames.weight > 0.2), which)
    extent = fit_extent(frames.position[which], seen, std, frames.position[unseen], (near, max(far, 1.5 * near)))
    if extent.high - extent.low < LONG_FROM:
        return _fit_point(camera, frames, detections, spot, pixel_std)
    covariance = np.diag([extent.std**2, angle_var])
    return replace(spot, low=extent.low, high=extent.high, angle=angle, covariance=covariance)


def _mean_angle(angles: Array, std: Array, about: float) -> tuple[float, float]:
    """Weighted mean of angles (rad) near ``about`` and its variance, stray ones discounted."""
    mean = about
    weight = std**-2
    for _ in range(5):
        off = wrap(angles - mean)
        weight = std**-2 * (TAIL + 1) / (TAIL + (off / std) ** 2)
        mean += float((weight * off).sum() / weight.sum())
    return float(wrap(np.array([mean]))[0]), float(1 / weight.sum())


def nearest_depth(camera: PipeCamera, centre: Array, angle: float) -> float:
    """Depth (m) at which a point of the wall at ``angle`` leaves the picture."""
    x, y = camera.fx * camera.radius * np.cos(angle), camera.fy * camera.radius * np.sin(angle)
    room_x = camera.width - centre[0] if x > 0 else centre[0]
    room_y = camera.height - centre[1] if y > 0 else centre[1]
    return float(max(abs(x) / max(room_x, 1.0), abs(y) / max(room_y, 1.0), NEAREST))


def _join(
    camera: PipeCamera, frames: Frames, detections: Detections, spots: list[Spot], long: Sequence[bool], far: float
) -> list[Spot]:
    """Doubles become one: points of the same class that lie within their errors, and pieces of a long thing.

    ``long`` says whether each spot's class may be long. Two pieces at one clock are one thing when they touch, or when no
    frame ever shows both, though both should have shown at once for long enough: a detector that makes one detection of a
    deposit makes it here or there.
    """
    order = sorted(range(len(spots)), key=lambda k: -len(spots[k].rows))
    kept: list[Spot] = []
    for spot, reaches in ((spots[k], long[k]) for k in order):
        for k, other in enumerate(kept):
            if spot.label != other.label:
                continue
            turn = abs(float(wrap(np.array([spot.angle - other.angle]))[0]))
            gap = max(spot.low - other.high, other.low - spot.high, 0.0)
            pieces = reaches and max(spot.high - spot.low, other.high - other.low) > LONG_FROM
            if pieces and gap < JOIN_FAR and turn < JOIN_ANGLE:
                same = gap < JOIN or _together(camera, frames, detections, spot, other, far) < TOGETHER
            else:
                sigma = np.sqrt(np.diag(spot.covariance + other.covariance))
                same = gap < 0.08 + 2 * float(sigma[0]) and turn < np.radians(8.0) + 2 * float(sigma[1])
            if same:
                joined = replace(other, rows=np.union1d(spot.rows, other.rows))
                if pieces:
                    joined = replace(joined, low=min(spot.low, other.low), high=max(spot.high, other.high))
                kept[k] = joined
                break
        else:
            kept.append(spot)
    return kept


def _together(camera: PipeCamera, frames: Frames, detections: Detections, one: Spot, two: Spot, far: float) -> float:
    """How often both were seen in one frame, as a share of how often that would be were they seen independently of each other.
    1 where they were not in view together for long enough to tell."""
    seen = np.zeros((2, len(frames.position)), dtype=bool)
    shows = frames.weight > 0.2
    for k, spot in enumerate((one, two)):
        seen[k, detections.frame[spot.rows]] = True
        near = nearest_depth(camera, frames.centre.mean(axis=0), spot.angle)
        shows = shows & (spot.high - frames.position > near) & (spot.low - frames.position < far)
    first, second = seen[0] & shows, seen[1] & shows
    expected = first.sum() * second.sum() / max(int(shows.sum()), 1)
    return float((first & second).sum() / expected) if expected >= LEAST_TOGETHER else 1.0


def _split(camera: PipeCamera, frames: Frames, detections: Detections, spot: Spot, pixel_std: float, far: float) -> list[Spot]:
    """Two things where one was thought to be: where its near sightings leave a gap along the pipe, and the sightings on both
    sides of it come in the same frames."""
    if spot.high - spot.low < SPLIT_GAP:
        return [spot]
    which = detections.frame[spot.rows]
    seen = np.maximum(detections.inverse_depth[spot.rows], 1e-3)
    chainage = frames.position[which] + 1 / seen
    spread = pixel_std / (np.sqrt(camera.fx * camera.fy) * camera.radius * seen**2)
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
    return [before, after] if _together(camera, frames, detections, before, after, far) > TOGETHER else [spot]


# ---- what the landmarks say of the detector


def _noise(frames: Frames, detections: Detections, spots: list[Spot], pixel_std: float) -> float:
    """Noise (px) of one axis across the ray: that is free of the tether and of where on a long thing the detector looks.

    Residuals stop at the gate; the deviation of the whole is that of the part within, made good for what was cut off.
    """
    residuals: list[Array] = []
    for spot in spots:
        if len(spot.rows) >= 20:
            which = detections.frame[spot.rows]
            radius = np.hypot(*(detections.pixels[spot.rows] - frames.centre[which]).T)
            residuals.append(np.abs(wrap(detections.angle[spot.rows] - spot.angle)) * radius)
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


def _starts(found: Sequence[Landmark], default: float) -> float:
    """How far ahead (m) the detector sees, to begin with: where the mapper's tracks began."""
    starts = [
        landmark.chainage_from - sighting.view.position
        for landmark in found
        for sighting in landmark.sightings[:3]
        if landmark.chainage_from > sighting.view.position
    ]
    return float(np.median(starts)) if starts else default


def _reach(frames: Frames, detections: Detections, spots: list[Spot], before: float) -> float:
    """How far ahead (m) the detector sees: the depth that parts best the frames in which point landmarks were mostly seen from
    those farther off in which they were not (the likeliest step of the hit rate)."""
    depths: list[Array] = []
    hits: list[NDArray[np.bool_]] = []
    for spot in spots:
        if spot.high - spot.low < LONG_FROM and len(spot.rows) >= 20:
            depth = spot.middle - frames.position
            hit = np.zeros(len(depth), dtype=bool)
            hit[detections.frame[spot.rows]] = True
            nearest = float(np.quantile(depth[hit], 0.02))
            counted = (depth > nearest) & (depth < 3 * np.quantile(depth[hit], 0.9)) & (frames.weight > 0.2)
            depths.append(depth[counted])
            hits.append(hit[counted])
    if not depths:
        return before
    depth, hit = np.concatenate(depths), np.concatenate(hits)
    order = np.argsort(depth)
    below = np.arange(1, len(depth) + 1)
    seen = np.cumsum(hit[order])
    value = _step_likelihood(seen, below) + _step_likelihood(seen[-1] - seen, below[-1] - below)
    return float(depth[order][int(np.argmax(value))])


def _step_likelihood(seen: NDArray[np.int64], of: NDArray[np.int64]) -> Array:
    """Greatest ln likelihood of ``seen`` hits ``of`` so many frames at an even rate."""
    rate = (seen + 0.5) / (of + 1.0)
    return np.asarray(seen * np.log(rate) + (of - seen) * np.log1p(-rate), dtype=np.float64)


# ---- whether it is


def _errors(
    frames: Frames, detections: Detections, shown: Sequence[NDArray[np.bool_]], spots: Sequence[Spot], errors: Errors
) -> Errors:
    """The detector's recall as the landmarks show it: the median share of frames in which one that should show was seen."""
    shares = []
    for spot, shows in zip(spots, shown, strict=True):
        if shows.sum() >= 20 and len(spot.rows) >= 20:
            hit = np.zeros(len(shows), dtype=bool)
            hit[detections.frame[spot.rows]] = True
            shares.append(float((hit & shows).sum() / shows.sum()))
    return replace(errors, seen=float(np.clip(np.median(shares), 0.3, 0.95))) if shares else errors


def _density(camera: PipeCamera, frames: Frames, detections: Detections, spots: Sequence[Spot], count: int) -> Array:
    """False detections per frame and px^2 of each class: what belongs to no landmark."""
    free = np.ones(len(detections.frame), dtype=bool)
    for spot in spots:
        free[spot.rows] = False
    number = np.bincount(detections.label[free], minlength=count)
    return np.asarray((number + 5.0) / (max(len(frames.position), 1) * camera.width * camera.height), dtype=np.float64)


def _shows(camera: PipeCamera, frames: Frames, spot: Spot, far: float, pixel_std: float) -> NDArray[np.bool_]:
    """In which frames (that count) some part of the landmark must show."""
    which = np.arange(len(frames.position))
    middle = np.clip(frames.position + 0.6 * far, spot.low, spot.high)
    pixels, depth = _predict(camera, frames, which, middle, spot.angle)
    inside = (pixels > pixel_std).all(axis=1) & (pixels < (camera.width - pixel_std, camera.height - pixel_std)).all(axis=1)
    return np.asarray(inside & (depth > NEAREST) & (depth < SURE * far) & (frames.weight > 0.2), dtype=bool)


def _judge(
    camera: PipeCamera,
    frames: Frames,
    detections: Detections,
    spot: Spot,
    shows: NDArray[np.bool_],
    density: Array,
    errors: Errors,
    matrix: Array,
    config: MapperConfig,
    pixel_std: float,
) -> tuple[float, int, int]:
    """Log likelihood ratio of a landmark's existence over all frames in which it should show, its hits and its misses.

    The mapper's own evidence (belief), but with the misses before the first sighting as well.
    """
    hit = np.zeros(len(frames.position), dtype=bool)
    hit[detections.frame[spot.rows]] = True
    order = np.flatnonzero((shows | hit) & (frames.weight > 0.2))
    score = _prior(camera, spot, density, config)
    distance2 = _distance2(camera, frames, detections, spot.rows, spot, pixel_std)
    ratio = _sighting_ratios(frames, detections, spot, distance2, density, errors, matrix, pixel_std)
    first_row = {int(detections.frame[row]): k for k, row in reversed(list(enumerate(spot.rows)))}
    run = 0
    for frame in order:
        missed = float(belief.miss_evidence(errors, np.array([run]))[0])
        value = ratio[first_row[int(frame)]] if hit[frame] else missed
        # What lies off the mark may be a false detection where the landmark itself was missed.
        run = run + 1 if value <= missed else 0
        score += float(frames.weight[frame]) * max(float(value), missed)
    return score, int(hit[order].sum()), int((~hit[order]).sum())


def _prior(camera: PipeCamera, spot: Spot, density: Array, config: MapperConfig) -> float:
    """ln of how much likelier a first sighting is clutter than a landmark nobody knew of."""
    expected = config.landmark_rate * 0.01 / (camera.width * camera.height)
    return float(np.clip(np.log(expected / density[spot.label]), -8.0, -2.0))


def _sighting_ratios(
    frames: Frames,
    detections: Detections,
    spot: Spot,
    distance2: Array,
    density: Array,
    errors: Errors,
    matrix: Array,
    pixel_std: float,
) -> Array:
    """ln p(sighting | landmark) - ln p(sighting | clutter) of each of its own sightings; the first is in the prior."""
    ratios = np.zeros(len(spot.rows))
    bursts: Bursts | None = None
    for k, row in enumerate(spot.rows):
        frame, label = int(detections.frame[row]), detections.label[row : row + 1]
        pixels = detections.pixels[row : row + 1]
        if bursts is None:
            started = np.array([frame])
            bursts = Bursts(pixels.copy(), np.ones(1), label, started, started.copy())
            continue
        same = matrix[bursts.label, label]
        clutter, going_on, bursts = belief.clutter_evidence(
            errors, bursts, frame, pixels, label, same, density[label], pixel_std
        )
        on_wall = belief.gaussian(distance2[k : k + 1], np.full(1, 4 * np.log(pixel_std)))
        if spot.high > spot.low:
            on_wall = np.maximum(on_wall, going_on)
        told = np.log(spot.belief @ matrix[:, label])
        ratios[k] = float((np.log(errors.stay_seen) + told + on_wall - clutter)[0])
    return ratios


def _landmark(
    camera: PipeCamera,
    frames: Frames,
    detections: Detections,
    spot: Spot,
    names: Sequence[str],
    score: float,
    seen: int,
    missed: int,
    number: int,
) -> Landmark:
    sightings = tuple(
        Sighting(
            number,
            int(frames.number[frame]),
            float(frames.time_s[frame]),
            View(
                float(frames.position[frame]),
                (float(frames.centre[frame, 0]), float(frames.centre[frame, 1])),
                (float(frames.axis[frame, 0]), float(frames.axis[frame, 1])),
            ),
            float(detections.pixels[row, 0]),
            float(detections.pixels[row, 1]),
            names[int(detections.label[row])],
            float(detections.score[row]),
        )
        for row in spot.rows
        for frame in (int(detections.frame[row]),)
    )
    sizes = [thumbnail_size(camera, s.view, s.u, s.v, 0.0) for s in sightings]
    inside = [
        size if min(s.u, s.v, camera.width - s.u, camera.height - s.v) > 0.3 * size else 0.0
        for s, size in zip(sightings, sizes, strict=True)
    ]
    best = int(np.argmax(inside if max(inside) > 0 else sizes))
    shown = sightings[best]
    return Landmark(
        id=number,
        label=names[spot.label],
        status="passed",
        chainage=spot.middle,
        angle=spot.angle,
        covariance=spot.covariance,
        chainage_from=spot.low,
        chainage_to=spot.high,
        angle_from=spot.angle,
        angle_to=spot.angle,
        belief=belief.named(names, spot.belief, score),
        hits=seen,
        misses=missed,
        first_frame=sightings[0].frame,
        last_frame=sightings[-1].frame,
        evidence=Evidence(shown.frame, shown.u, shown.v, sizes[best]),
        sightings=sightings,
    )
