"""The smoother's own Gauss-Newton beside maintained optimisers, on one and the same least-squares problem.

The problem is a drive of ``landmark_smoothing`` with its weights and slips settled, started from the first guess: scipy's
``least_squares`` (trust region, sparse Jacobian), and gtsam's Levenberg-Marquardt where gtsam is installed (custom factors; it
is no dependency). All have to end at the same map.
"""

from __future__ import annotations

import argparse
import importlib
import importlib.util
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.optimize import least_squares
from scipy.sparse.linalg import splu

from estimators.landmarks.mapper import Mapper
from estimators.landmarks.smoothing import Constraints, Known, Noise, run_of, smooth
from estimators.landmarks.smoothing import slips as slip_module
from estimators.landmarks.smoothing.scatter import Scatter, weigh
from estimators.landmarks.smoothing.system import System, build
from tests.bench.landmark_smoothing import CAMERA, FOCAL_RADIUS, Settings, simulate
from tests.bench.table import print_table

Array = NDArray[np.float64]


class Problem:
    """Residuals (rows,) and Jacobian (rows, size) of a run with settled weights."""

    def __init__(self, system: System, precision: Array, weights: Array) -> None:
        self.system = system
        self.root = np.sqrt(weights)
        self.steps = sparse.diags_array(np.sqrt(precision)) @ system.increments

    def residuals(self, state: Array) -> Array:
        seen, rings = self.system.residuals(state)
        measured = self.root * np.concatenate([seen[:, 0], seen[:, 1], rings])
        prior = self.system.prior @ state - self.system.prior_value
        return np.concatenate([measured, prior, self.steps @ state])

    def jacobian(self, state: Array) -> Any:
        measured = sparse.diags_array(self.root) @ self.system.jacobian(state)
        return sparse.vstack([measured, self.system.prior, self.steps], format="csr")

    def cost(self, state: Array) -> float:
        return 0.5 * float(np.sum(self.residuals(state) ** 2))


def problem_of(seed: int, rings: bool, length: float) -> Problem:
    settings = Settings(length=length, landmarks=max(2, round(length / 3.5)))
    drive = simulate(np.random.default_rng(seed), settings, FOCAL_RADIUS)
    mapper = Mapper(CAMERA)
    for observation in drive.observations:
        mapper.update(observation)
    mapper.finish()
    run = run_of(drive.observations, mapper.landmarks(), CAMERA)
    if rings:
        run = run_of(drive.observations, mapper.landmarks(), CAMERA, rings=drive.rings)
    constraints, noise = Constraints(focal_radius=Known(FOCAL_RADIUS, 0.4), start=Known(0.0, 0.01)), Noise()
    system = build(run, constraints, noise)
    # the state the smoother ends at tells which sightings count and where the tether slipped
    result = smooth(run, constraints, noise)
    state = system.initial.copy()
    layout, knots = system.layout, system.knots
    state[0], state[1] = np.log(result.focal_radius.value), result.scale.value
    counted = knots.encoder - knots.encoder[0]
    state[layout.slack : layout.landmarks] = (result.positions - state[1] * counted)[knots.frame]
    for k, mark in enumerate(result.landmarks):
        state[layout.landmarks + 2 * k : layout.landmarks + 2 * k + 2] = mark.chainage, mark.angle
    for k, joint in enumerate(result.joints):
        state[layout.joints + k] = joint.chainage
    weighed = weigh(system, state, Scatter(), noise)
    prior = slip_module.slip_prior(run, knots, noise)
    ends = run.frames.time_s[knots.frame]
    slipped = np.zeros(len(prior.spike), bool)
    for slip in result.slips:
        slipped |= (ends[:-1] >= slip.start_s) & (ends[1:] <= slip.end_s)
    weights = np.concatenate([weighed.sightings, weighed.sightings, weighed.rings])
    return Problem(system, 1 / prior.variance(slipped), weights)


def own(problem: Problem) -> tuple[Array, int]:
    """Gauss-Newton with a sparse factorisation, damped where a step does not help: what ``smooth`` does."""
    state, cost = problem.system.initial.copy(), problem.cost(problem.system.initial)
    steps, gained = 0, np.inf
    while gained > 1e-6 * cost and steps < 60:
        steps += 1
        jacobian = problem.jacobian(state)
        information = sparse.csc_matrix(jacobian.T @ jacobian)
        gradient = jacobian.T @ problem.residuals(state)
        damping = 0.0
        for _ in range(12):
            damped = information + sparse.diags_array(damping * information.diagonal())
            factor = splu(
                sparse.csc_matrix(damped), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
            )
            trial = state - factor.solve(gradient)
            if problem.cost(trial) <= cost:
                break
            damping = max(6 * damping, 1e-3)
        gained = cost - problem.cost(trial)
        state, cost = trial, problem.cost(trial)
    return state, steps


def scipys(problem: Problem, solver: str) -> tuple[Array, int]:
    found = least_squares(
        problem.residuals,
        problem.system.initial,
        (lambda state: problem.jacobian(state).toarray()) if solver == "exact" else problem.jacobian,
        method="trf",
        tr_solver=solver,  # type: ignore[arg-type]
        x_scale="jac",
        max_nfev=400,
    )
    return np.asarray(found.x), int(found.nfev)


def gtsams(problem: Problem) -> tuple[Array, int]:
    """Each unknown a vector of one, each row of the problem a factor: no projection factor of gtsam's has these unknowns."""
    gtsam = importlib.import_module("gtsam")
    pattern = problem.jacobian(problem.system.initial).tocsr()
    graph, start = gtsam.NonlinearFactorGraph(), gtsam.Values()
    for k, value in enumerate(problem.system.initial):
        start.insert(k, np.array([value]))
    unit = gtsam.noiseModel.Unit.Create(1)
    latest: dict[str, Any] = {"state": None}

    def everything(values: Any, keys: NDArray[np.int64]) -> tuple[Array, Any]:
        # the rows of the whole problem are computed at once for each point that gtsam asks about
        at = np.array([values.atVector(int(k))[0] for k in keys])
        known = latest["state"]
        if known is None or (known[keys] != at).any():
            state = np.array([values.atVector(k)[0] for k in range(len(problem.system.initial))])
            latest.update(state=state, residuals=problem.residuals(state), jacobian=problem.jacobian(state).tocsr())
        return latest["residuals"], latest["jacobian"]

    def factor(row: int, columns: NDArray[np.int64], first: int) -> Callable[[Any, Any, Any], Array]:
        def error(_this: Any, values: Any, slopes: Any) -> Array:
            residuals, jacobian = everything(values, columns)
            if slopes is not None:
                for k in range(len(columns)):
                    slopes[k] = jacobian.data[first + k : first + k + 1].reshape(1, 1)
            return np.asarray(residuals[row : row + 1])

        return error

    for row in range(pattern.shape[0]):
        first, last = int(pattern.indptr[row]), int(pattern.indptr[row + 1])
        columns = np.asarray(pattern.indices[first:last], dtype=np.int64)
        graph.add(gtsam.CustomFactor(unit, columns.tolist(), factor(row, columns, first)))
    optimizer = gtsam.LevenbergMarquardtOptimizer(graph, start)
    values = optimizer.optimize()
    return np.array([values.atVector(k)[0] for k in range(len(problem.system.initial))]), int(optimizer.iterations())


def main() -> None:
    parser = argparse.ArgumentParser(
        prog="python -m tests.bench.landmark_smoothing_peers", description=(__doc__ or "").splitlines()[0]
    )
    parser.add_argument("--length", type=float, default=28.0)
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    peers: list[tuple[str, Callable[[Problem], tuple[Array, int]]]] = [
        ("own Gauss-Newton", own),
        ("scipy trf, exact", lambda problem: scipys(problem, "exact")),
        ("scipy trf, lsmr", lambda problem: scipys(problem, "lsmr")),
    ]
    if importlib.util.find_spec("gtsam") is not None:
        peers.append(("gtsam LM", gtsams))
    for rings in (False, True):
        problem = problem_of(asked.seed, rings, asked.length)
        layout = problem.system.layout
        rows, best = [], own(problem)[0]
        for name, solve in peers:
            started = time.process_time()
            state, steps = solve(problem)
            seconds = time.process_time() - started
            away = np.abs(state - best)[layout.landmarks : layout.centres : 2].max(initial=0.0)
            rows.append((name, steps, f"{seconds:.2f}", f"{problem.cost(state):.3f}", f"{1000 * away:.2f}"))
        print_table(
            f"{asked.length:g} m, {len(problem.root)} rows of sightings{' and rings' if rings else ''}, {layout.size} unknowns",
            ("optimiser", "steps", "cpu s", "cost", "map differs by mm"),
            rows,
        )


if __name__ == "__main__":
    main()
