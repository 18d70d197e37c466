"""Descriptor, Bayes, what pipes allow, and several scans as one."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from device.structure.database import looked_at, shipped_knowledge, view_directions
from estimators.structure.cloud import Surface, surface_of, thinned
from estimators.structure.cvfh import BINS, cvfh, vfh
from estimators.structure.fusion import fused
from estimators.structure.graph import MapObject
from estimators.structure.handles import find_handle
from estimators.structure.next_view import difference, next_view
from estimators.structure.objects_map import ObjectRecord, belief
from estimators.structure.recognition import (
    CONFIGURATIONS,
    DescriptorSettings,
    allowed_by,
    configuration,
    describe,
    nearest_class,
    updated,
)
from estimators.structure.types import CLASSES

X, Y, Z = np.eye(3)


def test_curvature_of_eq_1_by_hand() -> None:
    """A flat grid has none; eight corners of a cube have the same variance along all axes, a third."""
    flat = np.stack(np.meshgrid(np.arange(5.0), np.arange(5.0), [10.0]), axis=-1).reshape(-1, 3)
    surface = surface_of(flat, 9)
    assert surface.curvature == pytest.approx(0.0, abs=1e-12)
    np.testing.assert_allclose(surface.normals, np.tile([0, 0, -1.0], (25, 1)), atol=1e-9)
    cube = np.stack(np.meshgrid([0.0, 1], [0.0, 1], [10.0, 11]), axis=-1).reshape(-1, 3)
    assert surface_of(cube, 8).curvature == pytest.approx(1 / 3)


def test_cells_hold_their_mean() -> None:
    points = np.array([[0.1, 0.1, 0.1], [0.3, 0.1, 0.1], [1.2, 0.0, 0.0]])
    np.testing.assert_allclose(sorted(thinned(points, 1.0).tolist()), [[0.2, 0.1, 0.1], [1.2, 0.0, 0.0]])
    assert thinned(np.zeros((0, 3)), 1.0).shape == (0, 3)


def test_a_histogram_by_hand() -> None:
    """Two points beside the centroid of a plane that faces the sensor: all their angles are known."""
    points = np.array([[1.0, 0, 2], [-0.5, 0, 2]])
    normals = np.tile([0, 0, -1.0], (2, 1))
    surface = Surface(points, normals, np.zeros(2), np.zeros((2, 1), dtype=np.intp))
    histogram = vfh(surface, np.array([0.0, 0, 2]), np.array([0, 0, -1.0]))
    assert histogram.shape == (BINS,)
    assert [int(np.flatnonzero(block)[0]) for block in np.split(histogram[:180], 4)[:3]] == [22, 22, 22]  # zero is the middle
    assert np.flatnonzero(histogram[135:180]).tolist() == [22, 44]  # half of the way and all of it
    assert np.flatnonzero(histogram[180:]).tolist() == [127]  # normals towards the sensor
    assert histogram.sum() == 2 * 5


def test_the_descriptor_does_not_change_when_the_sensor_turns() -> None:
    """Whatever turns object and view together; what is left are points that change their bin."""
    points = thinned(looked_at("tee", True, view_directions()[3]), 0.008)
    turned = points @ Rotation.from_euler("xyz", [0.3, -0.4, 2.0]).as_matrix().T
    one, two = (cvfh(surface_of(cloud, 16), DescriptorSettings().cvfh) for cloud in (points, turned))
    assert len(one) == len(two)
    for histogram in one:
        assert min(np.abs(histogram - other).sum() for other in two) < 0.02 * histogram.sum()


def test_too_few_points_have_no_descriptor() -> None:
    assert describe(np.zeros((3, 3)) + Z) is None


def test_parts_are_flat_faces() -> None:
    """Two squares at right angles are two parts."""
    steps = np.arange(0, 0.1, 0.01)
    a, b = (grid.ravel() for grid in np.meshgrid(steps, steps))
    floor = np.column_stack([a, np.full(100, 0.5), b + 1.0])
    wall = np.column_stack([a, 0.4 + b, np.full(100, 1.2)])
    assert len(cvfh(surface_of(np.vstack([floor, wall]), 9))) == 2


def test_views_of_the_data_base_are_recognised_and_confusions_are_shares() -> None:
    knowledge = shipped_knowledge()
    found = describe(looked_at("butterfly valve", True, view_directions()[2]))
    assert found is not None
    seen, apart = nearest_class(found, knowledge.views)
    assert CLASSES[seen] == "butterfly valve"
    assert apart[seen] == pytest.approx(0.0, abs=1e-3)
    only = np.array([label == "tee" for label in CLASSES])
    assert CLASSES[nearest_class(found, knowledge.views, only)[0]] == "tee"
    for table in (knowledge.confusion, knowledge.fused_confusion):
        np.testing.assert_allclose(table.sum(axis=1), 1)
        assert table.min() > 0


def test_bayes_by_hand() -> None:
    confusion = np.full((6, 6), 0.1)
    confusion[0, 2], confusion[1, 2] = 0.5, 0.25
    after = updated(np.full(6, 1 / 6), 2, confusion)
    assert after[0] == pytest.approx(0.5 / (0.5 + 0.25 + 4 * 0.1))
    record = ObjectRecord()
    record.evidence += 2 * np.log(confusion[:, 2])
    assert belief(record.evidence)[1] == pytest.approx(0.0625 / (0.25 + 0.0625 + 0.04))


@pytest.mark.parametrize(
    ("pipes", "number"),
    [([], 3), ([X], 3), ([X, -X], 2), ([X, Y], 1), ([X, -X, Z], 0), ([X, Y, -Y], 0), ([X, (X + Y) / 2**0.5], 3)],
)
def test_dispositions_of_table_2(pipes: list[np.ndarray], number: int) -> None:
    assert configuration(np.array(pipes).reshape(-1, 3)) == number


def test_what_table_2_allows() -> None:
    names = [{label for label, kept in zip(CLASSES, allowed, strict=True) if kept} for allowed in CONFIGURATIONS]
    assert names[0] == {"tee", "3-way valve"}
    assert names[1] == {"elbow", "tee", "3-way valve"}
    assert names[2] == set(CLASSES) - {"elbow"}
    assert names[3] == set(CLASSES)
    # the most restrictive is remembered, and two pairs that each show one part of three pipes say as much as the three
    assert np.array_equal(allowed_by({3, 0, 1}), CONFIGURATIONS[0])
    assert np.array_equal(allowed_by({1, 2}), CONFIGURATIONS[0])
    assert allowed_by(set()).all()


def test_fused_scans_are_less_noisy_and_drop_what_is_hidden() -> None:
    rng = np.random.default_rng(0)
    a, b = (grid.ravel() for grid in np.meshgrid(np.arange(-0.1, 0.1, 0.0035), np.arange(-0.1, 0.1, 0.0035)))
    rays = np.column_stack([a, b, np.ones(len(a))])
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    clouds = [rays * (2 + rng.normal(0, 0.005, (len(rays), 1))) for _ in range(6)]
    behind = rays * 2.2
    together = fused([*clouds, behind])
    ranges = np.linalg.norm(together, axis=1)
    assert ranges.max() < 2.05
    assert ranges.std() < 0.6 * 0.005
    np.testing.assert_array_equal(fused(clouds[:1]), clouds[0])


@pytest.mark.parametrize("is_open", [True, False])
def test_a_handle_tells_its_stem_and_whether_the_valve_is_open(is_open: bool) -> None:
    direction = np.array([0.3, -0.5, 0.8]) / np.linalg.norm([0.3, -0.5, 0.8])
    forward = -direction
    right = np.cross(forward, np.eye(3)[int(np.argmin(np.abs(forward)))])
    right /= np.linalg.norm(right)
    axes = np.column_stack([right, np.cross(forward, right), forward])
    cloud = looked_at("butterfly valve", is_open, direction) @ axes.T + 2.8 * direction  # back in the object's own frame
    handle = find_handle(cloud, np.zeros(3), X, np.zeros((0, 3)))
    assert handle is not None
    assert handle.stem @ Z > 0.9
    assert handle.is_open is is_open
    assert handle.lever is not None
    assert abs(handle.lever @ (X if is_open else Y)) > 0.9
    socket = looked_at("socket", True, direction) @ axes.T + 2.8 * direction
    assert find_handle(socket, np.zeros(3), X, np.zeros((0, 3))) is None


def _thing(beliefs: list[float], orientation: np.ndarray | None = None) -> MapObject:
    shares = np.array(beliefs)
    return MapObject(7, np.array([0.0, 0, 4]), np.eye(3), shares, shares, shares, np.zeros((0, 3)), 5, orientation)


def test_nothing_is_suggested_where_all_is_sure() -> None:
    views = shipped_knowledge().views
    assert next_view([_thing([1, 0, 0, 0, 0, 0])], {}, views, 3.0, 4.0) is None
    assert next_view([], {}, views, 3.0, 4.0) is None


def test_the_suggested_view_is_a_new_one_and_looks_at_what_is_unsure() -> None:
    views = shipped_knowledge().views
    thing = _thing([0.5, 0, 0, 0, 0, 0.5])
    first = next_view([thing], {}, views, 3.0, 4.0)
    assert first is not None
    assert first.objects == (7,)
    np.testing.assert_allclose(first.target, thing.position)
    direction = (first.position - thing.position) / np.linalg.norm(first.position - thing.position)
    second = next_view([thing], {7: [direction] * 3}, views, 3.0, 4.0)
    assert second is not None
    assert (second.position - thing.position) @ direction / np.linalg.norm(second.position - thing.position) < np.cos(0.35)


def test_two_classes_differ_more_from_where_the_handle_shows() -> None:
    """A ball valve and a socket, the one with a handle up: from above more apart than a socket from itself."""
    views = shipped_knowledge().views
    ball, socket = CLASSES.index("ball valve"), CLASSES.index("socket")
    assert difference(views, ball, socket, np.eye(3), Z) > difference(views, socket, socket, np.eye(3), Z) + 0.1
