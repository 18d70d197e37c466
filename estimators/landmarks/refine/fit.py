"""Where a landmark lies and how far it reaches, from its own sightings."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from estimators.landmarks.ekf import wrap
from estimators.landmarks.extent import fit_extent
from estimators.landmarks.projection import NEAREST
from estimators.landmarks.refine.run import LONG_FROM, Run, Spot, nearest_depth, predict, spread

Array = NDArray[np.float64]

TAIL = 4.0
"""Degrees of freedom of Student's t in the least squares: sightings of something else pull little."""
LONG_LEAST = 12
"""With fewer sightings than this nothing is said of an extent."""


def fit(
    run: Run,
    spot: Spot,
    pixel_std: float,
    far: float,
) -> Spot:
    """The landmark from its own sightings."""
    spot = replace(spot, label=int(spot.belief.argmax()))
    if run.names[spot.label] not in run.config.long_classes or len(spot.rows) < LONG_LEAST:
        return _fit_point(run, spot, pixel_std)
    return _fit_long(run, spot, pixel_std, far)


def _fit_point(run: Run, spot: Spot, pixel_std: float) -> Spot:
    """Chainage and angle by least squares with the tails of Student's t, reweighted step by step (Gauss-Newton)."""
    which = run.detections.frame[spot.rows]
    pixels = run.detections.pixels[spot.rows]
    camera = run.camera
    state = np.array([spot.middle, spot.angle])
    information = np.eye(2)
    fresh = np.maximum(run.frames.weight[which], 0.05)
    last = np.inf
    for _ in range(25):
        expected, depth = predict(run, which, np.full(len(which), state[0]), state[1])
        safe = np.maximum(depth, NEAREST)
        ray = expected - run.frames.centre[which]
        along = -ray / safe[:, None]
        around = np.stack(
            [-camera.fx * camera.radius * np.sin(state[1]) / safe, camera.fy * camera.radius * np.cos(state[1]) / safe], 1
        )
        jac = np.stack([along, around], axis=2)
        off = pixels - expected
        # Noise grows along the ray with the tether's error.
        unit = ray / np.maximum(np.hypot(ray[:, 0], ray[:, 1]), 1e-6)[:, None]
        along_std, across_std = spread(camera, depth, run.frames.std[which], pixel_std)
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


def _fit_long(run: Run, spot: Spot, pixel_std: float, far: float) -> Spot:
    """Extent by maximum likelihood, angle by the robust mean of the sightings' own."""
    rows = spot.rows
    which = run.detections.frame[rows]
    seen = run.detections.inverse_depth[rows]
    f_radius = np.sqrt(run.camera.fx * run.camera.fy) * run.camera.radius
    angle_std = pixel_std / (f_radius * np.maximum(seen, 1e-3))
    angle, angle_var = _mean_angle(run.detections.angle[rows], angle_std, spot.angle)
    near = nearest_depth(run.camera, run.frames.centre[which].mean(axis=0), angle)
    std = np.hypot(pixel_std / f_radius, seen**2 * run.frames.std[which])
    unseen = np.setdiff1d(np.flatnonzero(run.frames.weight > 0.2), which)
    extent = fit_extent(run.frames.position[which], seen, std, run.frames.position[unseen], (near, max(far, 1.5 * near)))
    if extent.high - extent.low < LONG_FROM:
        return _fit_point(run, spot, pixel_std)
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
