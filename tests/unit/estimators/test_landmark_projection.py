"""The cylinder in the picture."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from estimators.landmarks.projection import PipeCamera, View, back_project, clock_hour, jacobian, project

CAMERA = PipeCamera(500.0, 450.0, 0.3, 720, 576)
CENTRE = (350.0, 300.0)


def test_a_landmark_by_hand() -> None:
    view = View(10.0, CENTRE)
    states = np.array([[11.0, 0.0], [10.5, np.pi / 2]])
    # 0.3 m to the right, 1 m ahead: 150 px; 0.3 m down, 0.5 m ahead: 270 px.
    np.testing.assert_allclose(project(CAMERA, view, states), [[500.0, 300.0], [350.0, 570.0]])


def test_a_camera_off_the_axis_sees_a_ring_off_the_centre_by_f_e_over_z() -> None:
    view = View(0.0, CENTRE, (0.05, -0.02))
    angles = np.linspace(-np.pi, np.pi, 36, endpoint=False)
    ring = project(CAMERA, view, np.stack([np.full(36, 2.0), angles], axis=1))
    np.testing.assert_allclose(ring.mean(axis=0), [350 + 500 * 0.05 / 2, 300 - 450 * 0.02 / 2])


@settings(max_examples=200, deadline=None)
@given(
    depth=st.floats(0.1, 20.0),
    angle=st.floats(-3.14, 3.14),
    x=st.floats(-0.15, 0.15),
    y=st.floats(-0.15, 0.15),
    position=st.floats(-50, 50),
)
def test_back_projection_undoes_projection(depth: float, angle: float, x: float, y: float, position: float) -> None:
    view = View(position, CENTRE, (x, y))
    state = np.array([[position + depth, angle]])
    np.testing.assert_allclose(back_project(CAMERA, view, project(CAMERA, view, state)), state, atol=1e-6)


def test_jacobian_is_the_derivative() -> None:
    view = View(1.0, CENTRE, (0.03, 0.04))
    states = np.array([[1.7, 0.4], [3.0, -2.5]])
    small = 1e-6
    for column in range(2):
        step = np.zeros(2)
        step[column] = small
        slope = (project(CAMERA, view, states + step) - project(CAMERA, view, states - step)) / (2 * small)
        np.testing.assert_allclose(jacobian(CAMERA, view, states)[:, :, column], slope, rtol=1e-6)


def test_what_is_beside_or_behind_has_no_picture_and_the_centre_lies_nowhere() -> None:
    view = View(1.0, CENTRE)
    assert np.isnan(project(CAMERA, view, np.array([[0.5, 0.0], [1.01, 0.0]]))).all()
    assert np.isnan(back_project(CAMERA, view, np.array([CENTRE]))).all()


@pytest.mark.parametrize(
    ("degrees", "hour"), [(-90, 12.0), (0, 3.0), (90, 6.0), (180, 9.0), (-180, 9.0), (-60, 1.0), (270, 12.0)]
)
def test_clock(degrees: float, hour: float) -> None:
    assert clock_hour(np.radians(degrees)) == pytest.approx(hour)
