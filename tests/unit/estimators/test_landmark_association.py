"""Gating and global nearest neighbour."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from estimators.landmarks import association, ekf
from estimators.landmarks.projection import PipeCamera, View, jacobian, project

CAMERA = PipeCamera(500.0, 480.0, 0.3, 720, 576)
VIEW = View(1.0, (350.0, 290.0), (0.03, -0.02))


def gate_of(states: np.ndarray, pixels: np.ndarray, threshold: float = np.inf) -> association.Gated:
    n = len(states)
    covariances = np.repeat(np.array([[[0.01, 0.002], [0.002, 0.004]]]), n, axis=0)
    return association.gate(CAMERA, VIEW, states, covariances, pixels, (np.zeros(n), np.zeros(n)), (15.0, 4.0, 0.02), threshold)


def test_distances_are_those_of_the_written_out_equations() -> None:
    rng = np.random.default_rng(1)
    states = np.stack([rng.uniform(1.6, 4.0, 5), rng.uniform(-3, 3, 5)], axis=1)
    pixels = rng.uniform((0, 0), (720, 576), (4, 2))
    gated = gate_of(states, pixels)
    jac = jacobian(CAMERA, VIEW, states)
    covariance = np.array([[0.01, 0.002], [0.002, 0.004]])
    r = ekf.measurement_noise(jac, 15.0, 4.0, 0.02)
    for j, i in itertools.product(range(4), range(5)):
        s = jac[i] @ covariance @ jac[i].T + r[i]
        y = pixels[j] - project(CAMERA, VIEW, states)[i]
        assert gated.distance2[j, i] == pytest.approx(y @ np.linalg.inv(s) @ y, rel=1e-9)
        assert gated.log_det[j, i] == pytest.approx(np.log(np.linalg.det(s)), rel=1e-9)


def test_what_is_behind_the_camera_or_outside_the_gate_is_never_a_pair() -> None:
    states = np.array([[0.9, 0.0], [2.0, 0.0]])
    pixels = project(CAMERA, VIEW, states[1:]) + np.array([[0.0, 0.0], [300.0, 0.0]])[:, :]
    gated = gate_of(states, pixels, association.GATE)
    assert np.isinf(gated.distance2[:, 0]).all()
    assert gated.distance2[0, 1] == pytest.approx(0.0, abs=1e-12)
    assert np.isinf(gated.distance2[1, 1])


def test_a_long_track_is_compared_where_the_detection_lies_on_it() -> None:
    state = np.array([[2.5, 1.5]])
    on_it = project(CAMERA, VIEW, np.array([[2.1, 1.5], [3.6, 1.5]]))
    gated = association.gate(
        CAMERA, VIEW, state, np.full((1, 2, 2), 1e-9), on_it, (np.array([-0.6]), np.array([0.6])), (15.0, 0.0, 0.0)
    )
    np.testing.assert_allclose(gated.offset[:, 0], [-0.4, 0.6], atol=1e-9)
    assert gated.distance2[0, 0] == pytest.approx(0.0, abs=1e-9)
    assert gated.distance2[1, 0] > 0.0


@settings(max_examples=200, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 5), st.integers(1, 5))
def test_assignment_is_the_cheapest_of_all(seed: int, rows: int, columns: int) -> None:
    rng = np.random.default_rng(seed)
    cost = rng.normal(-1.0, 3.0, (rows, columns))
    cost[rng.random((rows, columns)) < 0.4] = np.inf
    got_rows, got_columns = association.assign(cost)
    assert len(set(got_rows.tolist())) == len(got_rows)
    assert len(set(got_columns.tolist())) == len(got_columns)
    got = cost[got_rows, got_columns]
    assert np.all(got < 0)
    # Brute force: each row goes to one of the columns or to none.
    best = 0.0
    for choice in itertools.product([*range(columns), None], repeat=rows):
        taken = [c for c in choice if c is not None]
        if len(taken) == len(set(taken)):
            total = sum(cost[r, c] for r, c in enumerate(choice) if c is not None)
            best = min(best, total)
    assert got.sum() == pytest.approx(best, abs=1e-9)


def test_components_are_the_groups_that_hang_together() -> None:
    gated = np.zeros((5, 5), dtype=bool)
    gated[0, 0] = gated[0, 1] = gated[2, 1] = gated[3, 4] = True
    groups = [(rows.tolist(), columns.tolist()) for rows, columns in association.components(gated)]
    assert groups == [([0, 2], [0, 1]), ([3], [4])]


def test_nothing_to_assign() -> None:
    rows, columns = association.assign(np.zeros((0, 4)))
    assert len(rows) == len(columns) == 0
    empty = gate_of(np.zeros((0, 2)), np.zeros((3, 2)))
    assert empty.distance2.shape == (3, 0)
