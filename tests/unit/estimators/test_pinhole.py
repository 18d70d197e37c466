import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from estimators.pinhole import Intrinsics, deproject_pixels, project_rays, rays

PLAIN = Intrinsics(640, 480, 381.41, 381.41, 320.0, 240.0)
COEFFS = st.tuples(*[st.floats(-0.08, 0.08)] * 2, *[st.floats(-0.002, 0.002)] * 2, st.floats(-0.02, 0.02))


def test_principal_point_looks_straight_ahead() -> None:
    assert deproject_pixels(np.array([[320.0, 240.0]]), PLAIN) == pytest.approx(np.zeros((1, 2)))


def test_eqs_1_and_2_by_hand() -> None:
    ray = deproject_pixels(np.array([[320.0 + 381.41, 240.0 - 0.5 * 381.41]]), PLAIN)
    assert ray == pytest.approx(np.array([[1.0, -0.5]]))


@given(coeffs=COEFFS, model=st.sampled_from(["brown_conrady", "inverse_brown_conrady"]))
def test_projection_inverts_deprojection(coeffs: tuple[float, ...], model: str) -> None:
    camera = Intrinsics(640, 480, 450.0, 450.0, 320.0, 240.0, model, coeffs)
    pixels = np.array([[320.0, 240.0], [60.0, 50.0], [600.0, 400.0], [320.0, 20.0]])
    assert project_rays(deproject_pixels(pixels, camera), camera) == pytest.approx(pixels, abs=0.01)


def test_inverse_brown_conrady_is_librealsenses_closed_form() -> None:
    camera = Intrinsics(640, 480, 400.0, 400.0, 320.0, 240.0, "inverse_brown_conrady", (0.1, -0.05, 0.001, 0.002, 0.01))
    x, y = (500.0 - 320.0) / 400.0, (300.0 - 240.0) / 400.0
    r2 = x * x + y * y
    f = 1 + 0.1 * r2 - 0.05 * r2**2 + 0.01 * r2**3
    expected = [x * f + 2 * 0.001 * x * y + 0.002 * (r2 + 2 * x * x), y * f + 2 * 0.002 * x * y + 0.001 * (r2 + 2 * y * y)]
    assert deproject_pixels(np.array([[500.0, 300.0]]), camera)[0] == pytest.approx(expected)


def test_brown_conrady_undoes_the_lens() -> None:
    camera = Intrinsics(640, 480, 400.0, 400.0, 320.0, 240.0, "brown_conrady", (0.1, 0.0, 0.0, 0.0, 0.0))
    ray = np.array([[0.5, 0.0]])  # the lens moves it to 0.5 (1 + 0.1 * 0.25) = 0.5125
    assert project_rays(ray, camera)[0, 0] == pytest.approx(320 + 400 * 0.5125)
    assert deproject_pixels(np.array([[320 + 400 * 0.5125, 240.0]]), camera) == pytest.approx(ray, abs=1e-6)


def test_rays_are_computed_once_and_cannot_be_spoilt() -> None:
    assert rays(PLAIN) is rays(PLAIN)
    with pytest.raises(ValueError, match="read-only"):
        rays(PLAIN)[0, 0, 0] = 1.0


@pytest.mark.parametrize(
    "wrong",
    [{"width": 0}, {"fx": -1.0}, {"fy": 0.0}, {"model": "fisheye"}, {"ppx": float("nan")}],
)
def test_impossible_intrinsics_are_refused(wrong: dict) -> None:
    with pytest.raises(ValueError, match=r"\w"):
        Intrinsics(**{"width": 640, "height": 480, "fx": 400.0, "fy": 400.0, "ppx": 320.0, "ppy": 240.0, **wrong})
