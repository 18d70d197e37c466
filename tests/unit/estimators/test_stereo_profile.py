"""Eq. 17 of the RADIUS paper: its terms, the fit of walls that were made from it, and what the cone says of the offset."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from estimators.pinhole import Intrinsics
from estimators.radial_profile.cone import apex, own_offset_std
from estimators.radial_profile.ends import longest_run, wall_ends
from estimators.radial_profile.fit import Wall, WallPoints, refine_wall, search_wall
from estimators.radial_profile.model import Axis, design, parameters, profile_at, recentred
from estimators.radial_profile.reference import reference_fit
from estimators.radial_profile.shape import egg, shape_of
from estimators.stereo.follow import reread
from estimators.stereo.rig import StereoRig

F, B, R = 1000.0, 0.05, 0.25
CAMERA = Intrinsics(1920, 1200, F, F, 960.0, 600.0)


def rig(offset: float | None = 0.0) -> StereoRig:
    return StereoRig(CAMERA, B, offset)


def cylinder(
    rng: np.random.Generator,
    count: int = 4000,
    noise: float = 0.2,
    offset: float = 0.0,
    vanishing: tuple[float, float] = (0, 0),
) -> WallPoints:
    """Points on a round pipe about an axis that meets the picture at ``vanishing``: x = v + f R cos / Z, by hand."""
    theta, z = rng.uniform(-np.pi, np.pi, count), rng.uniform(0.8, 2.0, count)
    x, y = vanishing[0] + F * R * np.cos(theta) / z, vanishing[1] + F * R * np.sin(theta) / z
    disparity = offset + F * B / z + rng.normal(0, noise, count)
    return WallPoints(np.arctan2(y, x), np.hypot(x, y), disparity, np.full(count, 0.1))


def test_the_terms_are_those_of_the_published_code() -> None:
    theta, z = np.array([0.3]), np.array([2.0])
    expected = [1, 2, np.cos(0.3), np.sin(0.3), 2 * np.cos(0.3), 2 * np.sin(0.3)]
    expected += [np.cos(0.6), np.sin(0.6), 2 * np.cos(0.6), 2 * np.sin(0.6)]
    np.testing.assert_allclose(design(theta, z, 2)[0], expected)
    assert parameters(6) == 26


def test_an_axis_takes_over_the_first_harmonic() -> None:
    coefficients = np.array([0.2, 0.0, 0.003, -0.002, 0.01, 0.0])
    moved, axis = recentred(coefficients, Axis(0.01, 0.0, 0.0, 0.02))
    np.testing.assert_allclose(moved, [0.2, 0, 0, 0, 0, 0])
    assert axis == Axis(pytest.approx(0.013), pytest.approx(-0.002), pytest.approx(0.01), pytest.approx(0.02))


def test_a_round_pipe_far_off_the_cameras_axis_is_round_about_its_own() -> None:
    """About the camera's axis its radius would bend by 5 mm: d sin(theta) squared over twice the radius, d up to 7 cm."""
    rng = np.random.default_rng(8)
    theta, z = rng.uniform(-np.pi, np.pi, 4000), rng.uniform(0.5, 2.0, 4000)
    x, y = (0.03 + 0.02 * z + R * np.cos(theta)) / z, (-0.02 + R * np.sin(theta)) / z
    points = WallPoints(np.arctan2(y, x), F * np.hypot(x, y), F * B / z + rng.normal(0, 0.2, 4000), np.full(4000, 0.1))
    found = search_wall(points, rig(), rng)
    assert found is not None
    wall = refine_wall(points, found[0], rig(), (2, 4, 6), 1.0, 500.0)
    assert wall.harmonics == 2
    assert (wall.axis.x, wall.axis.right) == (pytest.approx(0.03, abs=1e-3), pytest.approx(0.02, abs=1e-3))
    angle = np.linspace(-np.pi, np.pi, 90)
    for depth in (0.6, 1.9):
        np.testing.assert_allclose(wall.radius(angle, np.full(90, depth)), R, atol=1e-3)
    np.testing.assert_allclose(wall.meet(x, y, wall.first_guess(x, y), 5), z, rtol=0.01)  # a ray and its depth


@settings(deadline=None)
@given(st.integers(1, 6), st.floats(-np.pi, np.pi), st.floats(0.1, 5.0), st.integers(0, 1000))
def test_constant_and_slope_add_up_to_the_model(count: int, theta: float, z: float, seed: int) -> None:
    coefficients = np.random.default_rng(seed).normal(size=parameters(count))
    constant, slope = profile_at(coefficients, np.array([theta]))
    direct = design(np.array([theta]), np.array([z]), count) @ coefficients
    np.testing.assert_allclose(constant + slope * z, direct, rtol=1e-9, atol=1e-9)


def test_depth_and_disparity_are_inverse() -> None:
    found = rig(7.0).depth(np.array([7.0 + F * B / 1.5, 7.0, 3.0]))
    assert found[0] == pytest.approx(1.5)
    assert np.isnan(found[1:]).all()  # at infinity, and behind it


def test_the_search_finds_a_pipe_among_as_many_other_points() -> None:
    rng = np.random.default_rng(1)
    wall = cylinder(rng)
    other = WallPoints(
        rng.uniform(-np.pi, np.pi, 4000), rng.uniform(100, 400, 4000), rng.uniform(20, 80, 4000), np.full(4000, 0.1)
    )
    mixed = WallPoints(*(np.r_[getattr(wall, name), getattr(other, name)] for name in vars(wall)))
    found = search_wall(mixed, rig(), rng)
    assert found is not None
    fitted = refine_wall(mixed, found[0], rig(), (2,), 0.5, 500.0)
    theta = np.linspace(-3, 3, 50)
    np.testing.assert_allclose(fitted.radius(theta, np.full(50, 1.2)), R, atol=0.002)


def test_too_few_points_are_no_pipe() -> None:
    rng = np.random.default_rng(2)
    assert search_wall(cylinder(rng, 50), rig(), rng) is None


@settings(deadline=None, max_examples=15)
@given(st.floats(-30, 60), st.floats(-40, 40), st.floats(-40, 40), st.integers(0, 99))
def test_the_cone_tells_offset_and_vanishing_point_whatever_offset_was_assumed(
    offset: float, u: float, v: float, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    points = cylinder(rng, noise=0.1, offset=offset, vanishing=(u, v))
    assumed = rig(0.0) if offset > -10 else rig(-40.0)
    found = search_wall(points, assumed, rng)
    assert found is not None
    wall = refine_wall(points, found[0], assumed, (2, 3, 4, 5, 6), 1.0, 500.0)
    cone = apex(wall, np.linspace(-np.pi, np.pi, 120, endpoint=False))
    assert abs(cone.offset_px - offset) < 3 * own_offset_std(cone, wall, 1.0)  # what the device states of it
    assert (cone.u_px, cone.v_px) == (pytest.approx(u, abs=4.0), pytest.approx(v, abs=4.0))


def test_a_wall_read_by_another_offset_is_met_at_the_same_disparities() -> None:
    rng = np.random.default_rng(4)
    found = search_wall(cylinder(rng, vanishing=(10, -20)), rig(), rng)
    assert found is not None
    wall = refine_wall(cylinder(rng, vanishing=(10, -20)), found[0], rig(), (2, 4), 1.0, 500.0)
    other = reread(wall, rig(12.0))
    u, v = rng.uniform(0.15, 0.3, (2, 50))
    met = [
        (each.rig.offset_px or 0.0) + each.rig.range_px_m / each.meet(u, v, each.first_guess(u, v), 9) for each in (wall, other)
    ]
    np.testing.assert_allclose(met[1], met[0], rtol=1e-4)


def test_a_radius_is_known_badly_where_no_wall_was_seen() -> None:
    rng = np.random.default_rng(5)
    points = cylinder(rng)
    wall = refine_wall(points.some(points.theta < 1.0), np.r_[R, np.zeros(17)], rig(), (4,), 1.0, 500.0)
    std = wall.radius_std(np.array([-1.5, 2.0]), np.array([1.0, 1.4]))
    assert std.shape == (2, 2)
    assert (std[:, 0] < 0.003 * R).all()
    assert (std[:, 1] > 10 * std[:, 0]).all()


def test_few_harmonics_are_kept_where_more_bring_nothing() -> None:
    rng = np.random.default_rng(3)
    points = cylinder(rng)
    found = search_wall(points, rig(), rng)
    assert found is not None
    wall = refine_wall(points, found[0], rig(), (1, 2, 3, 4, 5, 6), 1.0, 400.0)
    assert wall.harmonics <= 2


@pytest.mark.parametrize("noise", [0.3, 1.0])
def test_the_interval_of_the_width_holds_as_often_as_it_says(noise: float) -> None:
    held = 0
    for seed in range(40):
        rng = np.random.default_rng(seed)
        points = cylinder(rng, 1500, noise=noise)
        found = search_wall(points, rig(), rng)
        assert found is not None
        wall = refine_wall(points, found[0], rig(), (2,), noise, 1500.0)
        shape = shape_of(wall, np.ones(360, bool), np.linspace(-np.pi, np.pi, 360, endpoint=False))
        assert shape.width is not None
        held += shape.width.interval[0] <= 2 * R <= shape.width.interval[1]
    assert held >= 34  # of 40 at 95 %


def test_a_height_whose_invert_was_not_seen_is_not_told() -> None:
    rng = np.random.default_rng(4)
    points = cylinder(rng)
    points = points.some(np.abs(points.theta - np.pi / 2) > 0.5)
    found = search_wall(points, rig(), rng)
    assert found is not None
    wall = refine_wall(points, found[0], rig(), (2,), 1.0, 500.0)
    theta = np.linspace(-np.pi, np.pi, 360, endpoint=False)
    shape = shape_of(wall, np.abs(theta - np.pi / 2) > 0.5, theta)
    assert shape.height is None
    assert shape.width is not None
    assert 1.7 * R < shape.seen_height < 2 * R


def test_a_calibration_that_is_unsure_widens_every_length() -> None:
    rng = np.random.default_rng(5)
    points = cylinder(rng)
    found = search_wall(points, rig(), rng)
    assert found is not None
    unsure = StereoRig(CAMERA, B, 0.0, offset_std_px=1.0)
    wall = refine_wall(points, found[0], unsure, (2,), 1.0, 500.0)
    shape = shape_of(wall, np.ones(360, bool), np.linspace(-np.pi, np.pi, 360, endpoint=False))
    assert shape.width is not None
    depth = 0.5 * sum(wall.depths)
    assert shape.width.std == pytest.approx(2 * R * depth / (F * B), rel=0.1)  # one pixel, as a share of the disparity


def test_errors_of_offset_and_scale_cancel_where_both_were_found() -> None:
    known = StereoRig(CAMERA, B, 0.0, 1.0, 0.003, known_shift_px=50.0)
    assert known.relative_std(1.0) == pytest.approx(0.003)  # f b / Z = 50 px
    assert known.relative_std(2.0) == pytest.approx(np.hypot(1 / 25 - 1 / 50, 0.003))


def test_the_standard_egg_is_half_as_high_again_as_wide() -> None:
    outline = egg()
    assert np.ptp(outline[:, 0]) == pytest.approx(1.0, abs=1e-3)
    assert np.ptp(outline[:, 1]) == pytest.approx(1.5, abs=1e-3)


def egg_wall(width: float) -> Wall:
    """An egg about the camera's axis as six harmonics, without slope."""
    outline = width * egg(2000)
    angle, radius = np.arctan2(outline[:, 1], outline[:, 0]), np.hypot(outline[:, 0], outline[:, 1])
    order = np.argsort(angle)
    even = np.linspace(-np.pi, np.pi, 720, endpoint=False)
    values = np.interp(even, angle[order], radius[order], period=2 * np.pi)
    keep = np.r_[0, np.arange(2, parameters(6)).reshape(-1, 4)[:, :2].ravel()]
    coefficients = np.zeros(parameters(6))
    coefficients[keep] = np.linalg.lstsq(design(even, np.zeros(720), 6)[:, keep], values, rcond=None)[0]
    return Wall(coefficients, np.eye(26) * 1e-10, rig(), 0.3, 1.0, (1.0, 2.0))


def test_an_egg_is_known_from_its_upper_part() -> None:
    theta = np.linspace(-np.pi, np.pi, 360, endpoint=False)
    shape = shape_of(egg_wall(0.4), np.abs(theta - np.pi / 2) > 0.45, theta)
    assert shape.name == "egg"
    assert shape.height is None
    assert shape.fitted_width == pytest.approx(0.4, rel=0.02)
    assert shape.fitted_height == pytest.approx(0.6, rel=0.02)


def test_the_papers_fit_needs_nine_tenths_of_the_points() -> None:
    rng = np.random.default_rng(6)
    theta, z = rng.uniform(-np.pi, np.pi, 3000), rng.uniform(1, 2, 3000)
    r = R + 0.01 * np.cos(theta) + rng.normal(0, 0.0005, 3000)
    assert reference_fit(r[:40], theta[:40], z[:40], rng) is None
    fit = reference_fit(r, theta, z, rng)
    assert fit is not None
    assert fit.inliers.mean() > 0.99
    np.testing.assert_allclose(fit.coefficients[:4], [R, 0, 0.01, 0], atol=1e-3)
    r[:600] -= 0.05
    assert reference_fit(r, theta, z, rng) is None


@pytest.mark.parametrize(
    ("text", "gap", "expected"), [("..xxx.x", 0, (2, 5)), ("..xxx.x", 1, (2, 7)), ("......", 0, (0, 0)), ("x.....", 0, (0, 1))]
)
def test_longest_run(text: str, gap: int, expected: tuple[int, int]) -> None:
    assert longest_run(np.array([letter == "x" for letter in text]), gap) == expected


def test_ends_follow_a_slanted_rim_and_leave_cloth_out() -> None:
    rows, angles = 200, 360
    theta = (np.arange(angles) + 0.5) * (2 * np.pi / angles) - np.pi
    row = np.arange(rows)[:, None]
    last = 150 + 15 * np.cos(theta)
    on = (row >= 20) & (row < last)
    ends = wall_ends(on, ~on, np.ones_like(on), 4)
    assert ends is not None
    assert not (ends.inside & ~on).any()
    assert ends.inside.sum() > 0.88 * on.sum()


def test_without_wall_there_are_no_ends() -> None:
    nothing = np.zeros((100, 360), bool)
    assert wall_ends(nothing, ~nothing, ~nothing, 4) is None
