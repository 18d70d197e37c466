import numpy as np
import pytest

from estimators.frame import estimate_frame
from tests.unit.estimators.analytic_scenes import D435, UNIT_M, cylinder, ellipse, plane, to_depth


def profile_of(z: np.ndarray, noise: float = 0.003):
    estimate = estimate_frame(to_depth(z, noise), D435, UNIT_M)
    assert estimate.profile is not None
    return estimate.profile


def test_round_pipe_is_round() -> None:
    profile = profile_of(cylinder(0.2, offset=(0.03, -0.05), end_wall=1.6))
    assert 1000 * profile.minimum_diameter == pytest.approx(400, abs=2)
    assert 1000 * profile.maximum_diameter == pytest.approx(400, abs=2)
    assert 1000 * profile.mean_diameter == pytest.approx(400, abs=2)
    assert profile.ovality < 0.01
    assert profile.water is None


def test_oval_pipe_by_hand() -> None:
    profile = profile_of(ellipse(0.21, 0.19))
    assert 1000 * profile.maximum_diameter == pytest.approx(420, abs=3)
    assert 1000 * profile.minimum_diameter == pytest.approx(380, abs=3)
    # ASTM F1216: (420 - 400) / 400; the mean radius of a flat ellipse is close to (a + b) / 2
    assert profile.ovality == pytest.approx(0.05, abs=0.01)


def test_water_chord_is_left_out_and_reported() -> None:
    level = 0.12  # below the axis of a 400 mm pipe: 80 mm of water, a chord of 2 sqrt(200^2 - 120^2) = 320 mm
    z = np.minimum(cylinder(0.2, end_wall=1.6), plane((0.0, 1.0, 0.0), level))
    profile = profile_of(z)
    assert profile.water is not None
    assert 1000 * profile.water.depth == pytest.approx(80, abs=8)
    assert 1000 * profile.water.width == pytest.approx(320, abs=16)
    assert 1000 * profile.mean_diameter == pytest.approx(400, abs=4)


def test_unseen_wall_stays_open() -> None:
    z = cylinder(0.2, end_wall=1.6)
    z[:, 440:] = np.inf
    profile = profile_of(z)
    right = np.abs(profile.angles) < 0.5
    assert np.isnan(profile.radii[right]).all()
    assert np.isnan(profile.ovality)
