"""The bank of filters."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from estimators.landmarks import ekf
from estimators.landmarks.projection import NEAREST, PipeCamera, View, jacobian, project

CAMERA = PipeCamera(500.0, 500.0, 0.3, 720, 576)
CENTRE = (360.0, 288.0)


def noise(count: int, std: float) -> np.ndarray:
    return np.repeat(np.eye(2)[None] * std**2, count, axis=0)


def test_one_step_near_the_truth_is_the_plain_kalman_filter_of_the_paper() -> None:
    view = View(0.0, CENTRE)
    state, covariance = np.array([[1.0, 0.3]]), np.array([np.diag([1e-6, 1e-6])])
    pixel = project(CAMERA, view, np.array([[1.0005, 0.3004]]))
    h = jacobian(CAMERA, view, state)[0]
    r = np.eye(2) * 4.0
    gain = covariance[0] @ h.T @ np.linalg.inv(h @ covariance[0] @ h.T + r)
    expected = state[0] + gain @ (pixel[0] - project(CAMERA, view, state)[0])
    got, after = ekf.update(CAMERA, view, state, covariance, pixel, noise(1, 2.0))
    np.testing.assert_allclose(got[0], expected, atol=1e-8)
    np.testing.assert_allclose(after[0], (np.eye(2) - gain @ h) @ covariance[0], rtol=1e-3, atol=1e-12)


@settings(max_examples=50, deadline=None)
@given(chainage=st.floats(0.6, 3.0), angle=st.floats(-3.1, 3.1), seed=st.integers(0, 2**32 - 1))
def test_filter_finds_a_landmark_from_sightings_on_the_way_to_it(chainage: float, angle: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    truth = np.array([[chainage + 2.0, angle]])
    view = View(2.0, CENTRE)
    state, covariance = ekf.initial(CAMERA, view, project(CAMERA, view, truth), 5.0, 0.0, 0.0)
    np.testing.assert_allclose(state, truth, atol=1e-9)
    for position in np.arange(2.0, truth[0, 0] - 0.5, 0.02):
        view = View(float(position), CENTRE)
        pixel = project(CAMERA, view, truth) + rng.normal(0, 5.0, (1, 2))
        state, covariance = ekf.update(CAMERA, view, state, covariance, pixel, noise(1, 5.0))
    error = state[0] - truth[0]
    error[1] = ekf.wrap(error[1:])[0]
    assert error @ np.linalg.solve(covariance[0], error) < 25.0


def test_chainage_stays_ahead_of_the_camera_whatever_is_seen() -> None:
    rng = np.random.default_rng(3)
    state = np.array([[1.05, 0.5]])
    covariance = np.array([np.diag([4.0, 0.2])])
    for position in np.linspace(0.8, 1.2, 60):
        view = View(float(position), CENTRE)
        pixel = rng.uniform((0, 0), (720, 576), (1, 2))
        state, covariance = ekf.update(CAMERA, view, state, covariance, pixel, noise(1, 1.0))
        assert state[0, 0] >= position + NEAREST
        assert np.all(np.linalg.eigvalsh(covariance[0]) > 0)


def test_initial_covariance_says_how_deep_a_far_landmark_may_lie() -> None:
    view = View(0.0, CENTRE)
    pixels = project(CAMERA, view, np.array([[1.0, 0.0], [3.0, 0.0]]))
    _, covariance = ekf.initial(CAMERA, view, pixels, 15.0, 0.0, 0.0)
    # Z^2 sigma / (f R) along, sigma Z / (f R) around.
    np.testing.assert_allclose(np.sqrt(covariance[:, 0, 0]), np.array([1.0, 9.0]) * 15 / 150, rtol=1e-9)
    np.testing.assert_allclose(np.sqrt(covariance[:, 1, 1]), np.array([1.0, 3.0]) * 15 / 150, rtol=1e-9)


def test_noise_of_the_tether_counts_along_the_motion_of_the_picture_only() -> None:
    view = View(0.0, CENTRE)
    jac = jacobian(CAMERA, view, np.array([[0.6, 0.0]]))
    r = ekf.measurement_noise(jac, 2.0, 0.0, 0.01)
    speed = 150 / 0.6**2  # px per metre at that depth
    np.testing.assert_allclose(r[0], np.diag([4.0 + (speed * 0.01) ** 2, 4.0]), atol=1e-9)


def test_inverse_of_small_matrices() -> None:
    matrices = np.random.default_rng(0).normal(size=(7, 2, 2))
    np.testing.assert_allclose(ekf.inverse2(matrices), np.linalg.inv(matrices), rtol=1e-9)


def test_angles_wrap() -> None:
    np.testing.assert_allclose(ekf.wrap(np.array([np.pi + 0.1, -np.pi - 0.1, 0.3])), [-np.pi + 0.1, np.pi - 0.1, 0.3])
    assert ekf.wrap(np.array([3 * np.pi]))[0] == pytest.approx(-np.pi)
