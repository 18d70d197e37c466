"""Where a landmark lies and how far it reaches, from its own sightings.

Errors that all sightings of one landmark share do not average out, and its covariance says so: where the focus of expansion is,
and how far from the axis the landmark is (the camera's offset, a pipe that is not quite as wide as stated, a thing that stands
out of the wall). Errors that a stretch of sightings shares make these count for fewer.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from estimators.landmarks.ekf import wrap
from estimators.landmarks.projection import NEAREST
from estimators.landmarks.refine.alike import alike, together
from estimators.landmarks.refine.centroids import Centroids, Window, fit_centroids
from estimators.landmarks.refine.edges import Edges, fit_edges
from estimators.landmarks.refine.run import LONG_FROM, Errors, Granted, Reach, Run, Spot, nearest_depth, predict, spread

Array = NDArray[np.float64]
Index = NDArray[np.intp]

TAIL = 4.0
"""Degrees of freedom of Student's t in the least squares: sightings of something else pull little."""
LONG_LEAST = 12
"""With fewer sightings than this nothing is said of an extent."""
AROUND, STARTS = 0.8, 20
"""The fit of a point starts at the best of so many places on either side (m)."""
FOREIGN = 100.0
"""Squared deviations of a sighting that cannot be the landmark's."""
BORDER, LEAST_WEIGHT = 2.0, 0.05
"""So many standard deviations from the picture's border a sighting counts in full, at the border only so much."""
STAND_OUT = 0.5
"""Of by how much outlines stand out, in standard deviations of a detection."""
LAW_STD = (0.15, 0.08)
"""Of the near and the far end told by centroids, as shares of the depth they were last seen at: no detector keeps to a law.
By experience with detectors of each law (the 28 m segment)."""
NEAR_STD, NEAR_STD_BLIND = 0.1, 0.5
"""Of the logarithm of how much less near than thought the detector sees: where points have told it, and where none has."""


def fit(run: Run, spot: Spot, pixel_std: float, reach: Reach, granted: Granted) -> Spot:
    """The landmark from its own sightings; ``reach`` is how far the detector sees, ``granted`` how well the rest is known."""
    spot = replace(spot, label=int(spot.belief.argmax()))
    if run.names[spot.label] not in run.config.long_classes or len(spot.rows) < LONG_LEAST:
        return _fit_point(run, spot, pixel_std, granted)
    return _fit_long(run, spot, pixel_std, reach, granted)


def _fit_point(run: Run, spot: Spot, pixel_std: float, granted: Granted) -> Spot:
    """Chainage and angle by least squares with the tails of Student's t, reweighted step by step (Gauss-Newton); to their
    covariance comes that of what is taken for granted: centre (px, 2) and the logarithm of the distance from the axis."""
    which = run.detections.frame[spot.rows]
    pixels = run.detections.pixels[spot.rows]
    camera = run.camera
    focal = np.array([camera.fx, camera.fy]) * camera.radius
    fresh = np.maximum(run.frames.weight[which], 0.05)
    state = np.array([_begin(run, spot, fresh, pixel_std), spot.angle])
    gram, pull, common = np.eye(5), np.zeros(5), 1.0
    last = np.inf
    for _ in range(25):
        expected, depth = predict(run, which, np.full(len(which), state[0]), state[1])
        safe = np.maximum(depth, NEAREST)[:, None]
        ray = expected - run.frames.centre[which]
        outwards = focal * np.array([np.cos(state[1]), np.sin(state[1])]) / safe
        turned = focal * np.array([-np.sin(state[1]), np.cos(state[1])]) / safe
        right, down = np.tile([1.0, 0.0], (len(which), 1)), np.tile([0.0, 1.0], (len(which), 1))
        jac = np.stack([-ray / safe, turned, right, down, outwards], axis=2)
        off = pixels - expected
        # Noise grows along the ray with the tether's error.
        unit = ray / np.maximum(np.hypot(ray[:, 0], ray[:, 1]), 1e-6)[:, None]
        along_std, across_std = spread(camera, depth, run.frames.std[which], pixel_std)
        white = unit[:, :, None] * unit[:, None] * (along_std**-2 - across_std**-2)[:, None, None]
        white = white + np.eye(2) * (across_std**-2)[:, None, None]
        radial, across = (off * unit).sum(axis=1), off[:, 0] * unit[:, 1] - off[:, 1] * unit[:, 0]
        deviation = np.stack([radial / along_std, across / across_std], axis=1)
        distance2 = together(run.frames.position[which], deviation)
        weight = fresh * (TAIL + 2) / (TAIL + distance2) * (depth > NEAREST) * _inside(run, expected, pixel_std)
        common = alike(run.frames.position[which], weight[:, None] * deviation)
        pulled = np.einsum("n,nia,nij->naj", weight, jac, white)
        gram, pull = np.einsum("naj,njb->ab", pulled, jac), np.einsum("naj,nj->a", pulled, off)
        step = np.linalg.solve(gram[:2, :2] + 1e-9 * np.eye(2), pull[:2])
        # Not across the camera in one step.
        step[0] = np.clip(step[0], -0.5 * float(np.min(np.abs(depth))) - 0.05, 1.0)
        state = state + step
        if np.abs(step).max() < 1e-5 or abs(last - np.abs(step).max()) < 1e-9:
            break
        last = float(np.abs(step).max())
    own = np.linalg.inv(gram[:2, :2] + 1e-9 * np.eye(2))
    shared = own @ gram[:2, 2:] * np.array([granted.centre, granted.centre, granted.share])
    covariance = np.asarray(common * own + shared @ shared.T, dtype=np.float64)
    everything = np.linalg.inv(gram + np.diag([1e-9, 1e-9, 1e-6, 1e-6, 1e-2]))
    errors = Errors((everything @ pull)[2:], common * np.diag(everything)[2:])
    low, angle = float(state[0]), float(wrap(state[1:])[0])
    return replace(spot, low=low, high=low, angle=angle, covariance=covariance, ends=None, errors=errors)


def _inside(run: Run, expected: Array, pixel_std: float) -> Array:
    """How much (n,) sightings expected at ``expected`` (n, 2) count: hardly at the border of the picture, where only those show
    that err inwards, and what errs inwards looks farther off."""
    size = np.array([run.camera.width, run.camera.height])
    room = np.minimum(expected, size - expected).min(axis=1)
    return np.asarray(np.clip(room / (BORDER * pixel_std), LEAST_WEIGHT, 1.0), dtype=np.float64)


def _begin(run: Run, spot: Spot, fresh: Array, pixel_std: float) -> float:
    """The chainage (m) near the landmark's own that most of its sightings agree with. From a wrong one there may be no way
    down: a burst of false detections beside the camera outweighs all others where it is taken for the landmark, and tells
    nothing where the landmark is behind."""
    which, pixels = run.detections.frame[spot.rows], run.detections.pixels[spot.rows]
    around = spot.middle + np.linspace(-AROUND, AROUND, 2 * STARTS + 1)
    costs = []
    for chainage in around:
        expected, depth = predict(run, which, np.full(len(which), chainage), spot.angle)
        along_std, _ = spread(run.camera, depth, run.frames.std[which], pixel_std)
        distance2 = together(run.frames.position[which], (pixels - expected) / along_std[:, None])
        costs.append(float(fresh @ np.log1p(np.where(depth > NEAREST, distance2, np.inf).clip(max=FOREIGN) / TAIL)))
    return float(around[int(np.argmin(costs))])


def _fit_long(run: Run, spot: Spot, pixel_std: float, reach: Reach, granted: Granted) -> Spot:
    """Both ends from the outlines, or from the centroids where there are none; the angle by the robust mean of the sightings'
    own."""
    rows = spot.rows
    which = run.detections.frame[rows]
    seen = run.detections.inverse_depth[rows]
    f_radius = np.sqrt(run.camera.fx * run.camera.fy) * run.camera.radius
    angle_std = pixel_std / (f_radius * np.maximum(seen, 1e-3))
    angle, angle_var = _mean_angle(run.detections.angle[rows], angle_std, spot.angle)
    off = wrap(run.detections.angle[rows] - angle) / angle_std
    common = alike(run.frames.position[which], off / (1 + off**2 / TAIL))
    angle_var = common * angle_var + (granted.centre / f_radius / float(np.median(np.maximum(seen, 1e-3)))) ** 2
    outlined = np.isfinite(run.detections.near[rows]) & np.isfinite(run.detections.far[rows])
    if outlined.sum() >= LONG_LEAST:
        low, high, ends = _by_outlines(run, rows[outlined], pixel_std, reach, granted)
    else:
        low, high, ends = _by_centroids(run, rows, angle, pixel_std, reach, common, granted)
    if high - low < LONG_FROM:
        return _fit_point(run, spot, pixel_std, granted)
    covariance = np.diag([float(ends.sum()) / 4, angle_var])
    return replace(spot, low=low, high=high, angle=angle, covariance=covariance, ends=ends, errors=None)


def _by_outlines(run: Run, rows: Index, pixel_std: float, reach: Reach, granted: Granted) -> tuple[float, float, Array]:
    which = run.detections.frame[rows]
    f_radius = np.sqrt(run.camera.fx * run.camera.fy) * run.camera.radius
    near, far = run.detections.near[rows], run.detections.far[rows]
    std = np.hypot(np.hypot(pixel_std, granted.centre) / f_radius, near**2 * run.frames.std[which])
    closest = float(np.quantile(1 / near, 0.05))
    found = fit_edges(
        Edges(run.frames.position[which], near, far, std),
        (closest, max(reach.far, 1.5 * closest)),
        float(np.hypot(STAND_OUT * pixel_std, granted.centre)) / f_radius,
        granted.share,
    )
    return found.low, found.high, found.covariance


def _by_centroids(
    run: Run, rows: Index, angle: float, pixel_std: float, reach: Reach, common: float, granted: Granted
) -> tuple[float, float, Array]:
    which = run.detections.frame[rows]
    seen = run.detections.inverse_depth[rows]
    f_radius = np.sqrt(run.camera.fx * run.camera.fy) * run.camera.radius
    border = nearest_depth(run.camera, run.frames.centre[which].mean(axis=0), angle)
    near = max(border, reach.near)
    std = np.hypot(np.hypot(pixel_std, granted.centre) / f_radius, seen**2 * run.frames.std[which])
    unseen = np.setdiff1d(np.flatnonzero(run.frames.weight > 0.2), which)
    found = fit_centroids(
        Centroids(run.frames.position[which], seen, std, run.frames.position[unseen]),
        Window(near, max(reach.far, 1.5 * near), NEAR_STD if reach.near_known else NEAR_STD_BLIND),
        common,
    )
    # what all sightings share: how far from the axis the thing lies, and the centre; either end tells most when it is nearest
    shared = (granted.share * near) ** 2 + (near**2 * granted.centre / f_radius) ** 2
    own = np.diag((np.array(LAW_STD) * near) ** 2)
    return found.low, found.high, found.covariance + shared + own


def _mean_angle(angles: Array, std: Array, about: float) -> tuple[float, float]:
    """Weighted mean of angles (rad) near ``about`` and its variance, stray ones discounted."""
    mean = about
    weight = std**-2
    for _ in range(5):
        off = wrap(angles - mean)
        weight = std**-2 * (TAIL + 1) / (TAIL + (off / std) ** 2)
        mean += float((weight * off).sum() / weight.sum())
    return float(wrap(np.array([mean]))[0]), float(1 / weight.sum())
