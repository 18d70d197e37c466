"""The baseline must be a fair one: on clean cylinders the paper's algorithm finds what is there."""

from __future__ import annotations

import numpy as np
import pytest

from estimators.pinhole import Intrinsics, rays
from tests.bench import paper_algorithm
from tests.bench.paper_algorithm import PaperFit

INTRINSICS = Intrinsics(width=212, height=120, fx=105.0, fy=105.0, ppx=106.3, ppy=60.2)


def pipe_depth(radius: float, offset: tuple[float, float] = (0.0, 0.0), length: float = 2.0) -> np.ndarray:
    """Depth picture (120, 212) in millimetres from inside a straight pipe along the view, open at its end."""
    directions = rays(INTRINSICS).astype(np.float64)
    a = (directions**2).sum(axis=2)
    b = directions @ np.asarray(offset)
    c = np.dot(offset, offset) - radius**2
    z = (b + np.sqrt(b * b - a * c)) / a
    return np.where(z < length, np.rint(z * 1000), 0).astype(np.uint16)


@pytest.mark.parametrize(("radius", "offset"), [(0.10, (0.0, 0.02)), (0.20, (0.03, 0.0)), (0.50, (-0.1, 0.2))])
def test_finds_a_clean_pipe_at_the_smallest_d_max(radius: float, offset: tuple[float, float]) -> None:
    fit = paper_algorithm.fit_frame(pipe_depth(radius, offset), INTRINSICS, 0.001, seed=1)[0.01]
    assert fit.radius == pytest.approx(radius, abs=0.004)
    assert fit.inlier_share > 0.95
    assert fit.orientation > 0.99
    across = np.linalg.norm(np.cross(fit.axis, np.array([*offset, 0.5]) - fit.point))
    assert across < 0.006, "the true axis must run through the fitted one"
    assert fit.mse < 0.005**2


def test_a_tilted_cylinder_is_found_from_its_points_alone() -> None:
    rng = np.random.default_rng(5)
    angle, along = rng.uniform(0, 2 * np.pi, 8000), rng.uniform(0.3, 1.0, 8000)
    axis = np.array([0.3, -0.2, 1.0]) / np.linalg.norm([0.3, -0.2, 1.0])
    u = np.cross(axis, [1.0, 0.0, 0.0])
    u /= np.linalg.norm(u)
    v = np.cross(axis, u)
    circle = 0.15 * (np.cos(angle)[:, None] * u + np.sin(angle)[:, None] * v)
    cloud = (along[:, None] * axis + circle + rng.normal(0, 0.001, (8000, 3))).astype(np.float32)
    fit = paper_algorithm.fit_cloud(cloud, np.random.default_rng(0))[0.01]
    assert fit.radius == pytest.approx(0.15, abs=0.003)
    assert abs(float(fit.axis @ axis)) > 0.999
    assert fit.orientation == pytest.approx(axis[2], abs=0.01)


def test_inliers_only_grow_with_d_max_and_a_wide_one_is_less_exact() -> None:
    fits = paper_algorithm.fit_frame(pipe_depth(0.10), INTRINSICS, 0.001)
    shares = [fits[d_max].inlier_share for d_max in paper_algorithm.D_MAX_SWEEP]
    assert shares == sorted(shares)
    assert tuple(fits) == paper_algorithm.D_MAX_SWEEP
    assert abs(fits[0.01].radius - 0.10) < abs(fits[0.24].radius - 0.10)


def test_the_reported_share_is_counted_on_the_reported_cylinder() -> None:
    cloud = np.random.default_rng(2).uniform(-0.5, 0.5, (900, 3)).astype(np.float32) + np.array([0, 0, 1], np.float32)
    for d_max, fit in paper_algorithm.fit_cloud(cloud, np.random.default_rng(3), hypotheses=300).items():
        distance = np.linalg.norm(np.cross(cloud - fit.point, fit.axis), axis=1) - fit.radius
        assert fit.inlier_share == pytest.approx(np.mean(np.abs(distance) < d_max), abs=3 / len(cloud))
        assert fit.mse == pytest.approx(np.mean(distance**2), rel=1e-4)


def test_same_seed_same_answer_and_another_seed_another() -> None:
    depth = pipe_depth(0.12)
    first, again, other = (paper_algorithm.fit_frame(depth, INTRINSICS, 0.001, seed=seed)[0.09].radius for seed in (4, 4, 5))
    assert first == again
    assert first != other


def test_an_empty_or_nearly_empty_frame_gives_no_cylinder() -> None:
    depth = np.zeros((120, 212), dtype=np.uint16)
    assert paper_algorithm.fit_frame(depth, INTRINSICS, 0.001) == {}
    depth[40:45, 40:50] = 600  # 50 points: no 51st neighbour to speak of
    assert paper_algorithm.fit_frame(depth, INTRINSICS, 0.001) == {}


def test_points_beyond_the_crop_are_left_out() -> None:
    depth = pipe_depth(0.10)
    depth[depth == 0] = 3000
    fit = paper_algorithm.fit_frame(depth, INTRINSICS, 0.001)[0.01]
    assert fit.radius == pytest.approx(0.10, abs=0.004)


def some_fit(radius: float, share: float) -> PaperFit:
    return PaperFit(0.09, np.zeros(3, np.float32), np.array([0, 0, 1], np.float32), radius, share, mse=1e-4, orientation=0.9)


def test_consensus_of_a_recording() -> None:
    result = paper_algorithm.summarise([some_fit(0.10, 0.9), some_fit(0.11, 0.9), some_fit(0.30, 0.1)])
    assert result is not None
    assert result.median_diameter == pytest.approx(0.22)
    assert result.mean_diameter == pytest.approx(2 * 0.17)
    assert result.inlier_weighted_diameter == pytest.approx(2 * (0.09 + 0.099 + 0.03) / 1.9), "divided by the weights' sum"
    assert result.radius_std == pytest.approx(np.std([0.10, 0.11, 0.30]))
    assert result.inlier_share == pytest.approx((1.9 / 3, np.std([0.9, 0.9, 0.1])))
    assert not result.accepted(0.01)
    assert result.accepted(0.10)
    assert paper_algorithm.summarise([]) is None


def test_of_two_positions_the_stabler_is_taken() -> None:
    shaky = paper_algorithm.summarise([some_fit(0.10, 0.9), some_fit(0.14, 0.9)])
    steady = paper_algorithm.summarise([some_fit(0.20, 0.5), some_fit(0.201, 0.5)])
    assert shaky is not None
    assert steady is not None
    assert paper_algorithm.choose([shaky, steady]) is steady
