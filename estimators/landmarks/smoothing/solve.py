"""Smoothing a run: Gauss-Newton over all its unknowns, with wrong sightings weighed down and slips told from drift."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from estimators.landmarks.smoothing import slips
from estimators.landmarks.smoothing.scatter import Scatter, measure, weigh
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
PATIENCE, RESOLVED = 3, 30
"""Slips are looked for from one iteration to the other: two sets of slips as good as each other may take turns for ever."""
CLOSE = 1e-3
"""Change of any position (m) below which the iterations end."""


def smooth(
    run: Run,
    constraints: Constraints | None = None,
    noise: Noise | None = None,
    rng: np.random.Generator | None = None,
) -> Smoothed:
    """Map and way of a run as far as it is known, with covariances; ``rng`` weighs the slips. No frame: ValueError."""
    if len(run.frames.time_s) == 0:
        raise ValueError("There is no frame to smooth.")
    noise = noise or Noise()
    system = build(run, constraints or Constraints(), noise)
    return _iterate(system, noise, rng or np.random.default_rng(0))


def _iterate(system: System, noise: Noise, rng: np.random.Generator) -> Smoothed:
    believed = slips.slip_prior(system.run, system.knots, noise)
    prior, slipped = believed, np.zeros(len(believed.spike), np.bool_)
    state, scatter, converged, iteration = system.initial.copy(), Scatter(), False, 0
    fixed = (system.prior.T @ system.prior).tocsc()
    for iteration in range(1, ITERATIONS + 1):
        temper = TEMPER[iteration - 1] if iteration <= len(TEMPER) else 1.0
        before, slipped_before = state, slipped
        precision = 1 / prior.variance(slipped)
        state, information = _step(system, fixed, precision, state, scatter.tempered(temper), noise)
        if PATIENCE <= iteration < RESOLVED and len(slipped):
            free = _increments(system, _freed(system, information, precision, prior))
            slipped, chance = slips.climb(prior, slipped, _slack_steps(system, state), free)
            if iteration >= len(TEMPER):
                prior = slips.learned(believed, chance, noise)
        if iteration >= len(TEMPER):
            scatter = measure(system, state, scatter, noise)
        layout = system.layout
        moved = np.abs(state - before)[layout.landmarks : layout.centres]
        change = max(
            float(np.max(np.abs(system.positions(state) - system.positions(before)))), float(np.max(moved, initial=0.0))
        )
        if iteration > len(TEMPER) and change < CLOSE and (slipped == slipped_before).all():
            converged = True
            break
    precision = 1 / prior.variance(slipped)
    information, _ = _normal(system, fixed, precision, state, scatter, noise)
    factor = _freed(system, information, precision, prior)
    slack = slips.weigh_all(prior, slipped, _slack_steps(system, state), _increments(system, factor), rng)
    return _result(system, prior, slack, factor, state, scatter, noise, iteration, converged)


def _freed(system: System, information: Sparse, precision: Array, prior: slips.SlipPrior) -> Any:
    """The information, factorised, as it would be were every interval one with a slip: what is at rest has a variance that is
    lost beside the others', and the rest of the run says of the increments what it says whatever their prior."""
    step = system.increments
    return _factorise(sparse.csc_matrix(information + step.T @ (sparse.diags_array(1 / prior.slab - precision) @ step)))


def _slack_steps(system: System, state: Array) -> Array:
    """The slack's increments (K - 1,)."""
    return np.diff(state[system.layout.slack : system.layout.landmarks])


def _increments(system: System, factor: Any) -> Array:
    """Covariance (K - 1, K - 1) of the slack's increments."""
    layout = system.layout
    covariance = _columns(factor, layout.slack, layout.landmarks)[layout.slack : layout.landmarks]
    return np.diff(np.diff(covariance, axis=0), axis=1)


def _cost(system: System, precision: Array, state: Array, scatter: Scatter, noise: Noise) -> float:
    known = system.prior @ state - system.prior_value
    step = system.increments @ state
    return float(weigh(system, state, scatter, noise).cost + 0.5 * known @ known + 0.5 * precision @ step**2)


def _normal(
    system: System, fixed: Sparse, precision: Array, state: Array, scatter: Scatter, noise: Noise
) -> tuple[Sparse, Array]:
    """Information matrix and gradient at ``state``."""
    weighed = weigh(system, state, scatter, noise)
    seen, rings = system.residuals(state)
    jacobian = system.jacobian(state)
    weight = weighed.sightings / (scatter.ratio**2 * scatter.alike)
    weights = np.concatenate([weight, weight, weighed.rings / (scatter.ring_ratio**2 * scatter.ring_alike)])
    residual = np.concatenate([seen[:, 0], seen[:, 1], rings])
    weighted = sparse.diags_array(weights) @ jacobian
    step = system.increments
    information = fixed + jacobian.T @ weighted + step.T @ (sparse.diags_array(precision) @ step)
    gradient = jacobian.T @ (weights * residual) + system.prior.T @ (system.prior @ state - system.prior_value)
    gradient = gradient + step.T @ (precision * (step @ state))
    return sparse.csc_matrix(information), np.asarray(gradient, dtype=np.float64)


def _step(
    system: System, fixed: Sparse, precision: Array, state: Array, scatter: Scatter, noise: Noise
) -> tuple[Array, Sparse]:
    """One Levenberg-Marquardt step, and the information at where it began."""
    information, gradient = _normal(system, fixed, precision, state, scatter, noise)
    cost = _cost(system, precision, state, scatter, noise)
    step = _factorise(information).solve(gradient)
    damping = 1e-3
    for _ in range(12):
        trial = state - step
        if _cost(system, precision, trial, scatter, noise) <= cost + 1e-9 * abs(cost):
            return trial, information
        damped = information + sparse.diags_array(damping * information.diagonal())
        step = _factorise(sparse.csc_matrix(damped)).solve(gradient)
        damping *= 6
    return state, information


def _factorise(information: Sparse) -> Any:
    return splu(information, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})


def _columns(factor: Any, first: int, last: int) -> Array:
    """Columns (size, last - first) of the covariance."""
    unit = np.zeros((factor.shape[0], last - first))
    unit[np.arange(first, last), np.arange(last - first)] = 1.0
    return np.asarray(factor.solve(unit), dtype=np.float64)


def _result(
    system: System,
    prior: slips.SlipPrior,
    slack: slips.Slack,
    factor: Any,
    state: Array,
    scatter: Scatter,
    noise: Noise,
    iterations: int,
    converged: bool,
) -> Smoothed:
    layout, knots = system.layout, system.knots
    state, covariance = _over_all_slips(system, slack, factor, state)
    positions = system.positions(state)
    weighed = weigh(system, state, scatter, noise)
    landmarks = []
    for k, name in enumerate(layout.landmark_ids):
        at, mine = layout.landmarks + 2 * k, system.landmark == k
        angle = float(np.arctan2(np.sin(state[at + 1]), np.cos(state[at + 1])))
        block = covariance[at : at + 2, at : at + 2] + np.diag([0.0, noise.roll_std**2])
        landmarks.append(
            SmoothedLandmark(
                int(name), float(state[at]), angle, (block + block.T) / 2, int(mine.sum()), float(weighed.sightings[mine].sum())
            )
        )
    joints = []
    for k, name in enumerate(layout.joint_ids):
        at, mine = layout.joints + k, system.joint == k
        std = float(np.sqrt(covariance[at, at]))
        joints.append(SmoothedJoint(int(name), float(state[at]), std, int(mine.sum()), float(weighed.rings[mine].sum())))
    focal = float(np.exp(state[0]))
    return Smoothed(
        positions,
        _position_std(system, covariance),
        tuple(landmarks),
        tuple(joints),
        Known(float(state[1]), float(np.sqrt(covariance[1, 1]))),
        Known(focal, focal * float(np.sqrt(covariance[0, 0]))),
        slips.report(system.run, knots, slack, prior, positions),
        scatter.ratio,
        iterations,
        converged,
    )


def _over_all_slips(system: System, slack: slips.Slack, factor: Any, state: Array) -> tuple[Array, Array]:
    """State, and covariance of all but the errors of centre and axis, with the increments as they are over all sets of slips:
    the rest follows them linearly, by what ``factor`` says where all are free to slip."""
    layout = system.layout
    covariance = _columns(factor, 0, layout.centres)
    if len(slack.mean) == 0:
        return state, covariance[: layout.centres]
    steps = np.diff(covariance[:, layout.slack : layout.landmarks], axis=1)
    between = np.diff(steps[layout.slack : layout.landmarks], axis=0)
    follow = np.linalg.solve((between + between.T) / 2, steps.T).T
    state = state + follow @ (slack.mean - _slack_steps(system, state))
    follow = follow[: layout.centres]
    return state, covariance[: layout.centres] + follow @ (slack.covariance - between) @ follow.T


def _position_std(system: System, covariance: Array) -> Array:
    knots, slack = system.knots, system.layout.slack
    counted = knots.encoder - knots.encoder[0]
    left, right = slack + knots.left, slack + knots.right
    a, b = 1 - knots.share, knots.share
    variance = counted**2 * covariance[1, 1] + a**2 * covariance[left, left] + b**2 * covariance[right, right]
    variance += 2 * (a * b * covariance[left, right] + counted * (a * covariance[1, left] + b * covariance[1, right]))
    return np.asarray(np.sqrt(np.maximum(variance, 0.0)), dtype=np.float64)
