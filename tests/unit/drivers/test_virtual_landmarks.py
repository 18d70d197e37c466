"""Landmarks of the virtual sewer: their truth, their relief against hand-derived cases, and that all sensors see one world."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from drivers.virtual.camera import CctvCamera
from drivers.virtual.cctv import render
from drivers.virtual.furnish import furnished_sewer
from drivers.virtual.landmarks import LABELS, Connection, DisplacedJoint, Fracture, Patch, Roots, Thing, truths
from drivers.virtual.look import Look
from drivers.virtual.profile import circular, egg
from drivers.virtual.relief import Relief, march
from drivers.virtual.rig import Pose
from drivers.virtual.world import DEPOSIT, WALL, VirtualSewer
from estimators.detections import CLASSES
from estimators.pinhole import Intrinsics, rays

R = 0.15
INVERT = np.pi / 2
Array = NDArray[np.float64]


def sewer(*things: Thing) -> VirtualSewer:
    return VirtualSewer(circular(2 * R), 20.0, things=things)


def depth(there: VirtualSewer, pose: Pose, *directions: tuple[float, float]) -> Array:
    return np.asarray(there.cast(pose.position, pose.rotation, np.array(directions, np.float32)).depth, np.float64)


# --- truth ---


def test_the_classes_are_those_of_the_estimators() -> None:
    assert LABELS == CLASSES


def test_truths_are_numbered_along_the_pipe() -> None:
    found = truths((Roots(7.0, -1.0, 0.4), Connection(2.0, 0.3), Patch(3.0, 5.0, INVERT, 0.5)), R)
    assert [(one.id, one.label) for one in found] == [(0, "connection"), (1, "deposit"), (2, "roots")]
    assert found[0].centre == (2.0, 0.3)
    assert found[1].centre == (4.0, pytest.approx(INVERT))
    assert (found[1].chainage, found[1].chainage_to) == (3.0, 5.0)
    assert found[2].angle_to - found[2].angle == pytest.approx(0.8)


def test_a_crack_that_turns_left_has_its_angles_in_order() -> None:
    left = truths((Fracture(1.0, 1.5, 0.4, -0.2),), R)[0]
    assert (left.angle, left.angle_to) == (-0.2, 0.4)


# --- relief ---


def test_a_ray_ends_on_top_of_a_deposit() -> None:
    patch = Patch(0.5, 1.5, INVERT, 0.6, 0.03)
    # from the axis at z = 0.85 straight at the invert 0.15 m ahead, in the middle of the patch
    pose = Pose(chainage=0.85)
    found = depth(sewer(patch), pose, (0.0, 1.0))[0]
    height = float(Relief((patch,), R, True).height(np.float32(0.85 + found), np.float32(INVERT)))
    assert 0.015 < height < 0.03
    assert found == pytest.approx(R - height, abs=5e-4)
    assert depth(sewer(patch), pose, (0.0, -1.0))[0] == pytest.approx(R), "the crown is free"


def test_a_deposit_hides_what_lies_behind_it() -> None:
    # flat over its top of 20 mm, looked over from the axis: what is hidden behind its far end reaches to R / (R - h) of the
    # distance
    patch = Patch(1.0, 1.4, INVERT, 0.6, 0.02)
    hits = depth(sewer(patch), Pose(), *[(0.0, R / z) for z in (1.42, 1.5, 1.9)])
    assert hits[0] < 1.4
    assert hits[2] == pytest.approx(1.9, abs=1e-3), "far enough behind, the wall is seen again"


def test_behind_a_displaced_joint_the_wall_stands_in_on_one_side_and_out_on_the_other() -> None:
    step = DisplacedJoint(1.0, 0.0, 0.02)
    there = sewer(step)
    pose = Pose(chainage=1.0)
    # 0.1 m behind the joint the pipe is back by 0.1 / 1.2
    reach = 0.02 * (1 - 0.1 / 1.2)
    right, left = depth(there, pose, ((R - reach) / 0.1, 0.0), (-(R + reach) / 0.1, 0.0))
    assert right == pytest.approx(0.1, abs=1e-3)
    assert left == pytest.approx(0.1, abs=1e-3)
    # a ray that grazes by the axis side of the face ends on the face itself
    assert depth(there, Pose(chainage=0.5), ((R - 0.01) / 0.5, 0.0))[0] == pytest.approx(0.5, abs=0.01)


def test_a_connection_is_a_hole() -> None:
    hole = Connection(1.0, -INVERT, 0.1)
    pose = Pose(chainage=0.9)
    straight, beside, below = depth(sewer(hole), pose, (0.0, -R / 0.1), (0.0, -R / 0.3), (0.0, R / 0.1))
    assert straight > 0.1 + 0.02, "into it"
    assert beside == pytest.approx(0.3, abs=1e-3)
    assert below == pytest.approx(0.1, abs=1e-3)


@given(st.floats(-0.08, 0.08), st.floats(-0.08, 0.08), st.floats(0.05, 0.6), st.integers(0, 6))
@settings(max_examples=40, deadline=None)
def test_marching_finds_what_a_fine_search_finds(x: float, y: float, ahead: float, turn: int) -> None:
    relief = Relief((Patch(0.2, 0.9, 1.2, 0.7, 0.03),), R, True)
    angle = turn - 3.0
    end = np.array([R * np.cos(angle), R * np.sin(angle), ahead])
    ray = ((end - [x, y, 0]) / ahead).astype(np.float32)
    one = (ray[:1], ray[1:2], np.ones(1, np.float32))
    found = float(march(relief.height, R, relief.low, relief.high, (x, y, 0.0), one)[0])
    z = np.linspace(1e-3, ahead, 20_000, dtype=np.float32)
    px, py = x + z * ray[0], y + z * ray[1]
    gap = np.hypot(px, py) - R + relief.height(z, np.arctan2(py, px).astype(np.float32))
    first = float(z[np.argmax(gap >= 0)]) if (gap >= 0).any() else ahead
    assert found == pytest.approx(first, abs=0.02 * max(ahead, 0.1))


def test_a_pipe_that_is_not_round_keeps_its_shape_around_a_landmark() -> None:
    shape = egg(0.3)
    bare, with_roots = (VirtualSewer(shape, 20.0, things=things) for things in ((), (Connection(5.0, 0.0, 0.1),)))
    grid = rays(Intrinsics(80, 60, 42.0, 42.0, 39.5, 29.5))
    pose = Pose(chainage=4.2)
    one, other = (there.cast(pose.position, pose.rotation, grid).depth for there in (bare, with_roots))
    same = np.abs(one - other) < 0.02 * one
    assert same.mean() > 0.9
    assert not same.all()


def test_without_landmarks_nothing_changes_to_the_bit() -> None:
    grid = rays(Intrinsics(80, 60, 42.0, 42.0, 39.5, 29.5))
    pose = Pose(0.02, -0.01, 0.3, 0.05, 0.02, 0.1)
    flat = (Fracture(1.0, 2.0, 0.0, 0.3), Roots(1.5, -1.0))
    one, other = (sewer(*things).cast(pose.position, pose.rotation, grid) for things in ((), flat))
    assert np.array_equal(one.depth, other.depth)
    assert np.array_equal(one.material, other.material)
    assert np.array_equal(one.cosine, other.cosine)


# --- one world ---


@pytest.mark.parametrize("pose", [Pose(chainage=2.0), Pose(0.015, -0.01, 2.05, 0.05, -0.04, 0.03)])
def test_depth_and_cctv_see_a_deposit_at_one_place(pose: Pose) -> None:
    camera, look = CctvCamera(), Look(grain=0.0, dirt_line=-3.0, noise=0.0, jpeg=100, interlace=False)
    there = sewer(Patch(2.4, 3.0, INVERT - 0.1, 0.5, 0.03))
    lens = Intrinsics(camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy)
    bare = replace(there, things=())
    hits, wall = (one.cast(pose.position, pose.rotation, rays(lens)) for one in (there, bare))
    solid, thick = hits.material == DEPOSIT, wall.depth > 1.08 * hits.depth
    pictures = (render(one, camera, pose, np.random.default_rng(1), look).astype(int) for one in (there, bare))
    painted = np.abs(np.subtract(*pictures)).max(axis=2) > 20
    assert (painted & solid).sum() > 0.9 * painted.sum()
    assert (painted & thick).sum() > 0.8 * thick.sum()
    assert thick.sum() > 2000


def test_depth_and_cctv_see_a_connection_at_one_place() -> None:
    camera, pose = CctvCamera(), Pose(0.01, 0.01, 2.0, 0.04, 0.03, 0.0)
    there = sewer(Connection(2.45, -0.4, 0.12))
    lens = Intrinsics(camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy)
    far, near = (one.cast(pose.position, pose.rotation, rays(lens)).depth for one in (there, replace(there, things=())))
    deeper = far - near > 0.01
    look = Look(grain=0.0, stains=0.0, noise=0.0, jpeg=100, interlace=False)
    with_it, without = (
        cv2.cvtColor(render(one, camera, pose, np.random.default_rng(1), look), cv2.COLOR_BGR2GRAY).astype(int)
        for one in (there, replace(there, things=()))
    )
    dark = without - with_it > 60
    assert (deeper & dark).sum() / (deeper | dark).sum() > 0.6


@pytest.mark.parametrize("seed", range(3))
def test_a_furnished_pipe_has_its_landmarks_within_it(seed: int) -> None:
    there = furnished_sewer(np.random.default_rng(seed), 50.0, 0.4)
    counted = [one.label for one in there.landmarks]
    assert {label: counted.count(label) for label in LABELS} == dict(zip(LABELS, (8, 4, 4, 4, 4), strict=True))
    assert all(0 < one.chainage <= one.chainage_to < 50 for one in there.landmarks)
    joints = [joint.chainage for joint in there.joints]
    for one in there.landmarks:
        if one.label in ("displaced joint", "roots"):
            assert min(abs(one.chainage - joint) for joint in joints) < 1e-9
    assert there.cast(np.zeros(3), np.eye(3), np.array([[0.5, 0.5]], np.float32)).material[0] == WALL


def test_a_deposit_in_an_egg_stands_as_high_as_it_is() -> None:
    """Along rays from near the axis, the place where each ends lies on the egg less the deposit's height there."""
    sewer = VirtualSewer(egg(0.4), 4.0, things=(Patch(1.0, 1.2, 0.4, 0.4, 0.03),))
    slope, turn = np.meshgrid(np.linspace(0.15, 0.4, 60, dtype=np.float32), np.linspace(0.0, 0.8, 40, dtype=np.float32))
    rays = np.stack([slope * np.cos(turn), slope * np.sin(turn)], axis=-1)
    position = np.array([0.01, -0.02, 0.0])
    hits = sewer.cast(position, np.eye(3), rays)
    x, y = position[0] + hits.depth * rays[..., 0], position[1] + hits.depth * rays[..., 1]
    angle = np.arctan2(y, x).astype(np.float32)
    wanted = sewer.profile.radius(angle) - sewer.relief.height(hits.depth, angle)
    assert (sewer.relief.height(hits.depth, angle) > 0.015).sum() > 50
    # a wrong place of 4 mm of pipe, at the deposit's steepest
    np.testing.assert_allclose(np.hypot(x, y), wanted, atol=1.5e-3)
