"""Smoothing a run: Gauss-Newton over all its unknowns, with wrong sightings weighed down and slips told from drift."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from estimators.landmarks.smoothing import slips
from estimators.landmarks.smoothing.system import Sparse, System, build
from estimators.landmarks.smoothing.types import (
    Array,
    Constraints,
    Known,
    Noise,
    Run,
    Smoothed,
    SmoothedJoint,
    SmoothedLandmark,
)

ITERATIONS = 60
TEMPER = (4.0, 4.0, 3.0, 3.0, 2.0, 2.0)
"""Factors on the scatter of sightings in the first iterations: until slips are found they look like wrong sightings."""
CLOSE = 1e-3
"""Change of any position (m) below which the iterations end."""


def smooth(run: Run, constraints: Constraints | None = None, noise: Noise | None = None) -> Smoothed:
    """The likeliest map and way of a run, with covariances. A run of no frames is refused with ValueError."""
    if len(run.frames.time_s) == 0:
        raise ValueError("There is no frame to smooth.")
    noise = noise or Noise()
    system = build(run, constraints or Constraints(), noise)
    return _iterate(system, noise)


def _iterate(system: System, noise: Noise) -> Smoothed:
    layout = system.layout
    prior = slips.slip_prior(system.run, system.knots, noise)
    sites = slips.start_sites(prior)
    state, ratio, converged, iteration = system.initial.copy(), 1.0, False, 0
    fixed = (system.prior.T @ system.prior).tocsc()
    for iteration in range(1, ITERATIONS + 1):
        temper = TEMPER[iteration - 1] if iteration <= len(TEMPER) else 1.0
        before = system.positions(state)
        landmarks_before = state[layout.landmarks : layout.centres].copy()
        state, information = _step(system, fixed, sites, state, ratio * temper, noise)
        change = float(np.max(np.abs(system.positions(state) - before)))
        moved = np.abs(state[layout.landmarks : layout.centres] - landmarks_before)
        change = max(change, float(np.max(moved, initial=0.0)))
        if len(prior.spike) and iteration > 2:
            covariance = _columns(information, layout.slack, layout.landmarks)[layout.slack : layout.landmarks]
            steps = np.diff(np.diff(covariance, axis=0), axis=1)
            sites = slips.update_sites(sites, prior, np.diff(state[layout.slack : layout.landmarks]), steps)
        if iteration >= len(TEMPER):
            ratio = 0.5 * ratio + 0.5 * _scatter(system, state, ratio, noise)
        if iteration > len(TEMPER) + 3 and change < CLOSE:
            converged = True
            break
    return _result(system, fixed, sites, prior, state, ratio, noise, iteration, converged)


def _weights(system: System, state: Array, ratio: float, noise: Noise) -> tuple[Array, Array, float]:
    """How likely each sighting (m,) and ring (r,) is what it is taken for, and the cost of all (minus log likelihood)."""
    seen, rings = system.residuals(state)
    std, ring_std = system.run.sightings.std * ratio, system.run.rings.std * ratio
    right = np.log((1 - noise.outliers) / (2 * np.pi * std**2)) - 0.5 * np.sum(seen**2, axis=1) / ratio**2
    wrong = np.log(noise.outliers / noise.outlier_span**2)
    ring_right = np.log((1 - noise.outliers) / (np.sqrt(2 * np.pi) * ring_std)) - 0.5 * rings**2 / ratio**2
    ring_wrong = np.log(noise.outliers / noise.outlier_span)
    both, ring_both = np.logaddexp(right, wrong), np.logaddexp(ring_right, ring_wrong)
    return np.exp(right - both), np.exp(ring_right - ring_both), -float(both.sum() + ring_both.sum())


def _cost(system: System, sites: slips.Sites, state: Array, ratio: float, noise: Noise) -> float:
    known = system.prior @ state - system.prior_value
    step = system.increments @ state
    slack = 0.5 * sites.precision @ step**2 - sites.shift @ step
    return float(_weights(system, state, ratio, noise)[2] + 0.5 * known @ known + slack)


def _normal(
    system: System, fixed: Sparse, sites: slips.Sites, state: Array, ratio: float, noise: Noise
) -> tuple[Sparse, Array]:
    """Information matrix and gradient at ``state``."""
    weight, ring_weight, _ = _weights(system, state, ratio, noise)
    seen, rings = system.residuals(state)
    jacobian = system.jacobian(state)
    weights = np.concatenate([weight, weight, ring_weight]) / ratio**2
    residual = np.concatenate([seen[:, 0], seen[:, 1], rings])
    weighted = sparse.diags_array(weights) @ jacobian
    step = system.increments
    information = fixed + jacobian.T @ weighted + step.T @ (sparse.diags_array(sites.precision) @ step)
    gradient = jacobian.T @ (weights * residual) + system.prior.T @ (system.prior @ state - system.prior_value)
    gradient = gradient + step.T @ (sites.precision * (step @ state) - sites.shift)
    return sparse.csc_matrix(information), np.asarray(gradient, dtype=np.float64)


def _step(system: System, fixed: Sparse, sites: slips.Sites, state: Array, ratio: float, noise: Noise) -> tuple[Array, Any]:
    """One Levenberg-Marquardt step, and the factorised information at where it began."""
    information, gradient = _normal(system, fixed, sites, state, ratio, noise)
    cost = _cost(system, sites, state, ratio, noise)
    factor = _factorise(information)
    step = factor.solve(gradient)
    damping = 1e-3
    for _ in range(12):
        trial = state - step
        if _cost(system, sites, trial, ratio, noise) <= cost + 1e-9 * abs(cost):
            return trial, factor
        damped = information + sparse.diags_array(damping * information.diagonal())
        step = _factorise(sparse.csc_matrix(damped)).solve(gradient)
        damping *= 6
    return state, factor


def _factorise(information: Sparse) -> Any:
    return splu(information, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})


def _columns(factor: Any, first: int, last: int) -> Array:
    """Columns (size, last - first) of the covariance."""
    unit = np.zeros((factor.shape[0], last - first))
    unit[np.arange(first, last), np.arange(last - first)] = 1.0
    return np.asarray(factor.solve(unit), dtype=np.float64)


def _scatter(system: System, state: Array, ratio: float, noise: Noise) -> float:
    """How many times larger the scatter of the agreeing sightings is than they claim."""
    weight, ring_weight, _ = _weights(system, state, ratio, noise)
    seen, rings = system.residuals(state)
    total = float(weight @ np.sum(seen**2, axis=1) + ring_weight @ rings**2)
    free = 2 * float(weight.sum()) + float(ring_weight.sum())
    layout = system.layout
    free -= layout.centres - layout.landmarks
    return float(np.clip(np.sqrt(total / free), 0.2, 5.0)) if free > 30 else ratio


def _result(
    system: System,
    fixed: Sparse,
    sites: slips.Sites,
    prior: slips.SlipPrior,
    state: Array,
    ratio: float,
    noise: Noise,
    iterations: int,
    converged: bool,
) -> Smoothed:
    layout, knots = system.layout, system.knots
    information, _ = _normal(system, fixed, sites, state, ratio, noise)
    covariance = _columns(_factorise(information), 0, layout.centres)[: layout.centres]
    positions = system.positions(state)
    weight, ring_weight, _ = _weights(system, state, ratio, noise)
    landmarks = []
    for k, name in enumerate(layout.landmark_ids):
        at, mine = layout.landmarks + 2 * k, system.landmark == k
        angle = float(np.arctan2(np.sin(state[at + 1]), np.cos(state[at + 1])))
        block = covariance[at : at + 2, at : at + 2]
        landmarks.append(
            SmoothedLandmark(
                int(name), float(state[at]), angle, (block + block.T) / 2, int(mine.sum()), float(weight[mine].sum())
            )
        )
    joints = []
    for k, name in enumerate(layout.joint_ids):
        at, mine = layout.joints + k, system.joint == k
        std = float(np.sqrt(covariance[at, at]))
        joints.append(SmoothedJoint(int(name), float(state[at]), std, int(mine.sum()), float(ring_weight[mine].sum())))
    slack = slice(layout.slack, layout.landmarks)
    focal = float(np.exp(state[0]))
    return Smoothed(
        positions,
        _position_std(system, covariance),
        tuple(landmarks),
        tuple(joints),
        Known(float(state[1]), float(np.sqrt(covariance[1, 1]))),
        Known(focal, focal * float(np.sqrt(covariance[0, 0]))),
        slips.report(system.run, knots, sites, prior, state[slack], covariance[slack, slack], positions),
        ratio,
        iterations,
        converged,
    )


def _position_std(system: System, covariance: Array) -> Array:
    knots, slack = system.knots, system.layout.slack
    counted = knots.encoder - knots.encoder[0]
    left, right = slack + knots.left, slack + knots.right
    a, b = 1 - knots.share, knots.share
    variance = counted**2 * covariance[1, 1] + a**2 * covariance[left, left] + b**2 * covariance[right, right]
    variance += 2 * (a * b * covariance[left, right] + counted * (a * covariance[1, left] + b * covariance[1, right]))
    return np.asarray(np.sqrt(np.maximum(variance, 0.0)), dtype=np.float64)
