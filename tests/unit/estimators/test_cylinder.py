import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from estimators.cylinder import Cylinder, assess, orthonormal_basis, search
from estimators.cylinder.refinement import linearise
from estimators.pointcloud import oriented_points
from tests.unit.estimators.analytic_scenes import D435, SMALL, UNIT_M, cone, cylinder, plane, to_depth


def find(z: np.ndarray, noise: float = 0.005, intrinsics=D435, seed: int = 0):
    cloud = oriented_points(to_depth(z, noise, seed), intrinsics, UNIT_M)
    found = search(cloud, np.random.default_rng(seed))
    return None if found is None else assess(cloud, found)


@pytest.mark.parametrize("radius", [0.075, 0.1, 0.15, 0.2, 0.3, 0.45, 0.55])
def test_reads_the_radius_of_a_pipe(radius: float) -> None:
    fit = find(cylinder(radius, end_wall=2.4))
    assert fit is not None
    assert 2000 * fit.radius == pytest.approx(2000 * radius, abs=1.5)
    assert fit.orientation > 0.999
    assert fit.coverage == pytest.approx(2 * np.pi, abs=0.2)


@settings(max_examples=25, deadline=None)
@given(
    radius=st.floats(0.08, 0.5),
    right=st.floats(-0.4, 0.4),
    down=st.floats(-0.4, 0.4),
    tilt_x=st.floats(-0.3, 0.3),
    tilt_y=st.floats(-0.3, 0.3),
)
def test_pose_does_not_matter(radius: float, right: float, down: float, tilt_x: float, tilt_y: float) -> None:
    fit = find(cylinder(radius, SMALL, (right * radius, down * radius), (tilt_x, tilt_y), end_wall=2.0), intrinsics=SMALL)
    assert fit is not None
    assert 2000 * fit.radius == pytest.approx(2000 * radius, abs=6)
    expected = np.array([tilt_x, tilt_y, 1.0]) / np.linalg.norm([tilt_x, tilt_y, 1.0])
    assert fit.axis @ expected > np.cos(np.radians(2))


def test_scale_of_the_unit_scales_the_radius() -> None:
    depth = to_depth(cylinder(0.2, end_wall=1.5), 0.003)
    radii = []
    for unit in (UNIT_M, 1.5 * UNIT_M):
        cloud = oriented_points(depth, D435, unit)
        found = search(cloud, np.random.default_rng(0))
        assert found is not None
        radii.append(found.radius)
    assert radii[1] == pytest.approx(1.5 * radii[0], rel=0.005)


def test_half_the_wall_is_enough() -> None:
    z = cylinder(0.2, end_wall=2.0)
    z[:, :424] = np.inf
    fit = find(z)
    assert fit is not None
    assert 2000 * fit.radius == pytest.approx(400, abs=4)
    assert fit.coverage == pytest.approx(np.pi, abs=0.4)


def test_a_dense_end_wall_does_not_win() -> None:
    fit = find(cylinder(0.1, end_wall=0.25))
    assert fit is not None
    assert 2000 * fit.radius == pytest.approx(200, abs=3)


@pytest.mark.parametrize(
    "scene",
    [
        plane((0.0, 0.0, 1.0), 0.8),
        plane((0.0, 0.5, 1.0), 0.6),
        plane((0.0, 1.0, 0.05), 0.15),
        np.where(cylinder(0.15) > 0.5, plane((0.0, 0.0, 1.0), 0.5), np.inf),
    ],
    ids=["end wall", "slope", "floor", "disc"],
)
def test_what_is_flat_is_not_a_pipe(scene: np.ndarray) -> None:
    fit = find(scene, noise=0.008)
    assert fit is None or fit.area < 1.0 or np.degrees(fit.coverage) < 60


def test_a_cone_is_not_taken_for_a_pipe_of_its_mean_width() -> None:
    assert find(cone(0.3, 0.15)).taper == pytest.approx(-0.15, abs=0.05)
    assert abs(find(cylinder(0.3, end_wall=1.5)).taper) < 0.005


def test_noise_alone_is_not_a_pipe() -> None:
    rng = np.random.default_rng(1)
    z = np.kron(rng.uniform(0.2, 2.4, (60, 106)), np.ones((8, 8)))
    fit = find(z, 0.0)
    assert fit is None or fit.area < 2.0


def test_radius_std_grows_with_noise() -> None:
    scene = cylinder(0.2, SMALL, end_wall=1.5)
    calm, rough = find(scene, 0.002, SMALL), find(scene, 0.05, SMALL)
    assert calm is not None
    assert rough is not None
    assert rough.radius_std > 2 * calm.radius_std


def test_radius_std_is_that_of_repeated_tries() -> None:
    fits = [find(cylinder(0.15, SMALL, end_wall=1.5), 0.01, SMALL, seed) for seed in range(30)]
    radii = np.array([fit.radius for fit in fits if fit is not None])
    claimed = np.median([fit.radius_std for fit in fits if fit is not None])
    assert 0.3 < claimed / radii.std() < 3.5


def test_jacobian_against_differences() -> None:
    rng = np.random.default_rng(0)
    points = rng.normal((0, 0, 1), 0.3, (50, 3))
    axis = np.array([0.1, -0.2, 1.0]) / np.linalg.norm([0.1, -0.2, 1.0])
    point, radius = np.array([0.02, 0.03, 0.0]), 0.2
    residual, jacobian, basis, anchor = linearise(points, axis, point, radius)
    step = 1e-6
    for k in range(5):
        moved_axis = axis + basis[:, k] * step if k < 2 else axis
        moved_anchor = anchor + basis[:, k - 2] * step if k in (2, 3) else anchor
        moved_radius = radius + step if k == 4 else radius
        across = (points - moved_anchor) @ orthonormal_basis(moved_axis / np.linalg.norm(moved_axis))
        moved = np.hypot(across[:, 0], across[:, 1]) - moved_radius
        assert (moved - residual) / step == pytest.approx(jacobian[:, k], abs=1e-4)


def test_same_seed_same_answer() -> None:
    one, other = find(cylinder(0.2, end_wall=1.5)), find(cylinder(0.2, end_wall=1.5))
    assert one is not None
    assert other is not None
    assert one.radius == other.radius


def test_too_few_points_give_nothing() -> None:
    cloud = oriented_points(np.zeros((480, 848), np.uint16), D435, UNIT_M)
    assert search(cloud, np.random.default_rng(0)) is None
    cloud = oriented_points(to_depth(cylinder(0.2)), D435, UNIT_M).take(np.arange(8))
    assert assess(cloud, Cylinder(np.array([0.0, 0.0, 1.0]), np.zeros(3), 0.2)) is None
