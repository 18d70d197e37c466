import numpy as np
import pytest

from estimators.pointcloud import oriented_points
from tests.unit.estimators.analytic_scenes import D435, UNIT_M, cylinder, plane, to_depth


def test_normals_of_a_plane() -> None:
    normal = np.array([0.3, -0.2, 1.0]) / np.linalg.norm([0.3, -0.2, 1.0])
    cloud = oriented_points(to_depth(plane(tuple(normal), 0.6)), D435, UNIT_M)
    assert len(cloud) > 10000
    towards_camera = -normal
    assert np.degrees(np.arccos(np.clip(cloud.normals @ towards_camera, -1, 1))).max() < 3
    assert cloud.points @ normal == pytest.approx(np.full(len(cloud), 0.6), abs=0.002)


def test_normals_of_a_cylinder_point_at_its_axis() -> None:
    cloud = oriented_points(to_depth(cylinder(0.2), noise=0.005), D435, UNIT_M)
    outward = cloud.points[:, :2] / np.linalg.norm(cloud.points[:, :2], axis=1, keepdims=True)
    agreement = -(cloud.normals[:, :2] * outward).sum(axis=1)
    assert np.percentile(agreement, 5) > 0.95


def test_crop_of_eqs_3_to_5() -> None:
    cloud = oriented_points(to_depth(plane((0.0, 0.0, 1.0), 2.45)), D435, UNIT_M)
    assert np.abs(cloud.points[:, :2]).max() <= 1.02
    assert len(oriented_points(to_depth(plane((0.0, 0.0, 1.0), 2.6)), D435, UNIT_M)) == 0


def test_speckle_gives_hardly_any_points() -> None:
    rng = np.random.default_rng(3)
    depth = np.where(rng.random((480, 848)) < 0.05, rng.integers(200, 2500, (480, 848)), 0).astype(np.uint16)
    assert len(oriented_points(depth, D435, UNIT_M)) < 30


def test_empty_and_saturated_pictures() -> None:
    for value in (0, 65535):
        cloud = oriented_points(np.full((480, 848), value, np.uint16), D435, UNIT_M)
        assert len(cloud) == 0
        assert cloud.valid_share == 0


def test_picture_of_another_size_is_refused() -> None:
    with pytest.raises(ValueError, match="intrinsics say"):
        oriented_points(np.zeros((480, 640), np.uint16), D435, UNIT_M)


def test_unit_scales_the_cloud() -> None:
    depth = to_depth(plane((0.0, 0.0, 1.0), 0.8))
    cloud = oriented_points(depth, D435, UNIT_M / 2)
    assert np.median(cloud.points[:, 2]) == pytest.approx(0.4, abs=1e-3)
