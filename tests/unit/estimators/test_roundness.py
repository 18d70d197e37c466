"""The mean radius of a wall that is not round, of which a part is hidden: by hand it is (a + b) / 2 to first order."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from estimators.cylinder import Cylinder, CylinderFit, assess, search
from estimators.cylinder.roundness import HARMONIC_STD, mean_radius
from estimators.pointcloud import oriented_points
from tests.unit.estimators.analytic_scenes import D435, UNIT_M, cylinder, ellipse, to_depth


def fit_to(z: np.ndarray, hidden_below: float = np.inf, noise: float = 0.004) -> CylinderFit:
    """The fit to what is seen above ``hidden_below`` (m below the axis), as if the rest were under water."""
    rows = (np.arange(z.shape[0]) - D435.ppy) / D435.fy
    seen = np.where(rows[:, None] * np.where(np.isfinite(z), z, 0) < hidden_below, z, np.inf)
    cloud = oriented_points(to_depth(seen, noise), D435, UNIT_M)
    found = search(cloud, np.random.default_rng(0))
    assert found is not None
    fit = assess(cloud, found)
    assert fit is not None
    return fit


@pytest.mark.parametrize("hidden_below", [np.inf, 0.05])
def test_a_round_pipe_is_not_moved(hidden_below: float) -> None:
    fit = fit_to(cylinder(0.25, end_wall=1.6), hidden_below)
    assert abs(fit.mean_shift) < max(3 * fit.mean_std, 0.0003)
    assert fit.mean_std < 0.002


@settings(max_examples=8, deadline=None)
@given(squeeze=st.floats(-0.025, 0.025))
def test_an_oval_of_which_the_invert_is_hidden(squeeze: float) -> None:
    fit = fit_to(ellipse(0.25 * (1 + squeeze), 0.25 * (1 - squeeze)), hidden_below=0.05)
    assert fit.radius + fit.mean_shift == pytest.approx(0.25, abs=max(3 * fit.mean_std, 0.0012))


def test_the_shift_mends_what_the_circle_gets_wrong() -> None:
    fit = fit_to(ellipse(0.256, 0.244), hidden_below=0.05)
    assert abs(fit.radius - 0.25) > 0.002
    assert abs(fit.radius + fit.mean_shift - 0.25) < 0.4 * abs(fit.radius - 0.25)


def test_the_less_is_seen_the_less_is_known() -> None:
    whole = fit_to(ellipse(0.253, 0.247))
    half = fit_to(ellipse(0.253, 0.247), hidden_below=0.0)
    assert whole.mean_std < 0.5 * half.mean_std


def test_hardly_any_wall_leaves_the_prior() -> None:
    points = np.array([[0.25, 0.0, 1.0 + 0.01 * k] for k in range(20)], np.float32)
    axis = Cylinder(np.array([0.0, 0.0, 1.0]), np.zeros(3), 0.25)
    shift, std = mean_radius(points, np.full(20, 0.002, np.float32), axis)
    assert shift == 0.0
    assert std == pytest.approx(HARMONIC_STD[2] * 0.25)
