"""The geometry of the virtual sewer against what can be worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from drivers.virtual.profile import SAMPLES, PipeProfile, circular, dented, egg, oval
from drivers.virtual.rig import HandMotion, Pose, sway
from drivers.virtual.world import CHAMBER, DEPOSIT, END, JOINT, WALL, WATER, Deposit, Hits, Joint, VirtualSewer
from estimators.pinhole import Intrinsics, rays

SMALL = Intrinsics(80, 60, 42.0, 42.0, 39.5, 29.5)
GRID = rays(SMALL)
ANGLES = np.linspace(-np.pi, np.pi, SAMPLES, endpoint=False)
PROFILES = {
    "circular": circular(0.3),
    "oval": oval(0.33, 0.27),
    "egg": egg(0.4),
    "dented": dented(0.5, 0.03, 0.7),
}


def look(sewer: VirtualSewer, pose: Pose, *directions: tuple[float, float]) -> Hits:
    """Along rays (X/Z, Y/Z)."""
    return sewer.cast(pose.position, pose.rotation, np.array(directions, np.float32))


def points(hits: Hits, pose: Pose, grid: NDArray[np.float32]) -> NDArray[np.float64]:
    """Where the rays ended, in the pipe frame."""
    direction = np.concatenate([grid, np.ones((*grid.shape[:-1], 1))], axis=-1)
    return np.asarray(pose.position + (hits.depth[..., None] * direction) @ pose.rotation.T)


# --- straight ahead ---


def test_the_end_wall_is_met_on_the_axis_at_its_distance() -> None:
    hits = look(VirtualSewer(circular(0.3), length=4.0), Pose(chainage=0.25), (0.0, 0.0))
    assert hits.depth[0] == pytest.approx(3.75)
    assert hits.material[0] == END
    assert hits.cosine[0] == pytest.approx(1.0)


@pytest.mark.parametrize("degrees", [10.0, 30.0, 45.0])
def test_the_wall_is_met_at_radius_over_tangent(degrees: float) -> None:
    tangent = np.tan(np.radians(degrees))
    hits = look(VirtualSewer(circular(0.4), length=20.0), Pose(), (tangent, 0.0), (0.0, -tangent), (-tangent, 0.0))
    assert hits.depth == pytest.approx(0.2 / tangent, rel=1e-5)
    assert set(hits.material) == {WALL}
    assert hits.cosine == pytest.approx(np.sin(np.radians(degrees)), rel=1e-4)


def test_depth_is_along_the_camera_not_along_the_ray() -> None:
    hits = look(VirtualSewer(circular(2.0), length=1.0), Pose(), (0.0, 0.0), (0.5, 0.5))
    assert hits.depth == pytest.approx(1.0), "a wall straight across has one depth all over"


def test_off_the_axis_the_near_side_is_nearer() -> None:
    hits = look(VirtualSewer(circular(0.4), length=20.0), Pose(right=0.05), (0.5, 0.0), (-0.5, 0.0))
    assert hits.depth == pytest.approx([0.3, 0.5])


# --- poses ---


@pytest.mark.parametrize(
    ("pose", "where"),
    [
        (Pose(yaw=0.1), (np.tan(0.1), 0.0)),
        (Pose(pitch=0.1), (0.0, np.tan(0.1))),
        (Pose(yaw=-0.2), (-np.tan(0.2), 0.0)),
    ],
)
def test_yaw_looks_right_and_pitch_looks_down(pose: Pose, where: tuple[float, float]) -> None:
    sewer = VirtualSewer(circular(4.0), length=2.0)
    ahead = points(look(sewer, pose, (0.0, 0.0)), pose, np.zeros((1, 2), np.float32))[0]
    assert ahead == pytest.approx([2 * where[0], 2 * where[1], 2.0], abs=1e-5)


def test_roll_turns_the_picture_clockwise() -> None:
    """A camera turned clockwise by a right angle has its right side where its bottom was."""
    sewer = VirtualSewer(circular(0.4), length=20.0, water=0.1)
    hits = look(sewer, Pose(roll=np.pi / 2), (1.0, 0.0), (-1.0, 0.0))
    assert list(hits.material) == [WATER, WALL]


@settings(max_examples=25, deadline=None)
@given(yaw=st.floats(-0.4, 0.4), pitch=st.floats(-0.4, 0.4), roll=st.floats(-3, 3))
def test_a_turned_camera_sees_the_same_points(yaw: float, pitch: float, roll: float) -> None:
    """The same world direction ends at the same place, whichever way the camera is turned."""
    sewer = VirtualSewer(circular(0.3), length=3.0, water=0.03)
    straight, turned = Pose(0.02, -0.03, 0.1), Pose(0.02, -0.03, 0.1, yaw, pitch, roll)
    hits = sewer.cast(straight.position, straight.rotation, GRID[::6, ::6])
    there = points(hits, straight, GRID[::6, ::6])
    seen = (there - turned.position) @ turned.rotation
    ahead = seen[..., 2] > 0.05
    again = (seen[..., :2] / seen[..., 2:])[ahead].astype(np.float32)
    found = sewer.cast(turned.position, turned.rotation, again)
    error = np.abs(points(found, turned, again) - there[ahead]).max(axis=1)
    assert np.quantile(error, 0.98) < 2e-3  # a ray at an edge may end on the other side of it


def test_swaying_stays_around_its_place_and_is_settled_by_the_seed() -> None:
    motion = HandMotion(0.01, 0.02, 20.0)
    rest = Pose(0.1, 0.0, 0.5)

    def path(seed: int) -> NDArray[np.float64]:
        poses = sway(rest, motion, np.random.default_rng(seed))
        return np.array([next(poses).position for _ in range(4000)])

    first = path(3)
    assert np.array_equal(first, path(3))
    assert not np.array_equal(first, path(4))
    assert first.mean(axis=0) == pytest.approx(rest.position, abs=0.004)
    assert first.std(axis=0).min() > 0.004
    assert first.std(axis=0).max() < 0.025
    assert np.abs(np.diff(first, axis=0)).max() < 0.02, "no jumps"


# --- profiles ---


@settings(max_examples=20, deadline=None)
@given(
    name=st.sampled_from(sorted(PROFILES)),
    right=st.floats(-0.05, 0.05),
    down=st.floats(-0.05, 0.05),
    yaw=st.floats(-0.3, 0.3),
    pitch=st.floats(-0.3, 0.3),
)
def test_every_wall_hit_lies_on_the_profile(name: str, right: float, down: float, yaw: float, pitch: float) -> None:
    profile = PROFILES[name]
    pose = Pose(right, down, 0.1, yaw, pitch)
    hits = VirtualSewer(profile, length=30.0).cast(pose.position, pose.rotation, GRID)
    wall = hits.material == WALL
    assert wall.mean() > 0.9
    met = points(hits, pose, GRID)[wall]
    radius = profile.radius(np.arctan2(met[:, 1], met[:, 0]))
    assert np.abs(np.hypot(met[:, 0], met[:, 1]) - radius).max() < 1e-3


def test_the_egg_of_din_4263() -> None:
    """H : W = 3 : 2; the three arcs touch, so the outline has no corner, and each point lies on its own arc."""
    width = 0.6
    profile = egg(width)
    radii = np.asarray(profile.radii)
    x, y = radii * np.cos(ANGLES), radii * np.sin(ANGLES)
    assert x.max() - x.min() == pytest.approx(width, rel=1e-3)
    assert y.max() - y.min() == pytest.approx(1.5 * width, rel=1e-3)
    assert -y.min() == pytest.approx(y.max(), rel=1e-3)
    assert y[np.argmax(x)] == pytest.approx(-0.25 * width, abs=0.01 * width), "widest where the crown's arc ends"
    assert np.allclose(radii, profile.radius(np.angle(-np.exp(-1j * ANGLES))), atol=1e-6), "left and right alike"
    crown = np.hypot(x, y + width / 4)
    side = np.hypot(np.abs(x) + width, y + width / 4)
    invert = np.hypot(x, y - width / 2)
    assert crown[y < -width / 4] == pytest.approx(width / 2, rel=1e-6)
    # the side's circle (centre W to the left, at the crown's height) meets the invert's inside it, on the line of both centres
    joins_y = width / 2 + 0.6 * width / 4
    between = (y > -width / 4) & (y < joins_y - 1e-6)
    assert side[between] == pytest.approx(1.5 * width, rel=1e-6)
    assert invert[y > joins_y + 1e-6] == pytest.approx(width / 4, rel=1e-6)
    edges = np.diff(np.stack([x, y]), axis=1, append=np.stack([x[:1], y[:1]]))
    heading = np.unwrap(np.arctan2(edges[1], edges[0]))
    assert np.abs(np.diff(heading)).max() < 0.05, "no corner anywhere"


def test_an_oval_has_its_width_and_height() -> None:
    radii = np.asarray(oval(0.4, 0.3).radii)
    assert (radii * np.cos(ANGLES)).max() == pytest.approx(0.2)
    assert (radii * np.sin(ANGLES)).max() == pytest.approx(0.15)
    assert oval(0.4, 0.4).mean_diameter == pytest.approx(0.4, rel=1e-4)


def test_a_dent_presses_in_where_it_is() -> None:
    profile = dented(0.5, 0.03, np.pi / 2)
    assert profile.below() == pytest.approx(0.22, abs=1e-4)
    assert float(profile.radius(np.array([-np.pi / 2]))[0]) == pytest.approx(0.25, abs=1e-4)
    assert not profile.round
    assert circular(0.5).round


@pytest.mark.parametrize("profile", PROFILES.values(), ids=PROFILES)
def test_the_radius_is_continuous_over_the_seam(profile: PipeProfile) -> None:
    left = profile.radius(np.array([-np.pi, np.pi - 1e-6, np.pi]))
    assert left == pytest.approx([left[0]] * 3, abs=1e-5)


# --- what lies in the pipe ---


def test_water_is_level_at_its_height() -> None:
    sewer = VirtualSewer(circular(0.4), length=20.0, water=0.12)
    pose = Pose(down=-0.02, chainage=0.1, roll=0.2, pitch=0.1)
    hits = sewer.cast(pose.position, pose.rotation, GRID)
    met = points(hits, pose, GRID)
    wet = hits.material == WATER
    assert wet.sum() > 100
    assert met[wet][:, 1] == pytest.approx(0.2 - 0.12, abs=1e-5)
    assert met[hits.material == WALL][:, 1].max() <= 0.08 + 1e-4
    widest = np.abs(met[wet][:, 0]).max()
    assert widest <= np.sqrt(0.2**2 - 0.08**2) + 1e-4, "the chord of the surface"


def test_a_deposit_has_a_top_and_a_face() -> None:
    sewer = VirtualSewer(circular(0.4), length=20.0, deposit=Deposit(0.6, 1.4, 0.1))
    pose = Pose(down=-0.05)
    hits = sewer.cast(pose.position, pose.rotation, GRID)
    met = points(hits, pose, GRID)[hits.material == DEPOSIT]
    top, face = np.abs(met[:, 1] - 0.1) < 1e-4, np.abs(met[:, 2] - 0.6) < 1e-4
    assert top.sum() > 20
    assert face.sum() > 20
    assert np.all(top | face)
    assert met[:, 2].min() > 0.6 - 1e-4
    assert met[:, 2].max() < 1.4 + 1e-4
    assert met[:, 1].min() > 0.1 - 1e-4


@pytest.mark.parametrize("depth", [0.01, -0.01])
def test_a_joint_is_a_ring_of_its_width(depth: float) -> None:
    joint = Joint(0.5, 0.04, depth)
    plain, jointed = (VirtualSewer(circular(0.4), 20.0, joints=joints) for joints in ((), (joint,)))
    grid = np.stack([np.linspace(0.05, 1.2, 4000), np.zeros(4000)], axis=-1).astype(np.float32)
    hits = jointed.cast(np.zeros(3), np.eye(3), grid)
    met = points(hits, Pose(), grid)
    ring = hits.material == JOINT
    assert ring.sum() > 50
    assert met[ring][:, 2].min() > 0.48 - 1e-4
    assert met[ring][:, 2].max() < 0.52 + 1e-4
    out = np.hypot(met[ring][:, 0], met[ring][:, 1]) - 0.2
    assert (out.max() if depth > 0 else out.min()) == pytest.approx(depth, abs=1e-4), "its floor, or its lip"
    smooth = plain.cast(np.zeros(3), np.eye(3), grid)
    assert hits.depth[~ring] == pytest.approx(smooth.depth[~ring])


# --- from outside ---


def test_before_the_mouth_the_chamber_wall_stands_around_it() -> None:
    sewer = VirtualSewer(circular(0.3), length=5.0)
    pose = Pose(chainage=-0.4)
    hits = look(sewer, pose, (0.0, 0.0), (0.3, 0.0), (0.45, 0.0), (-0.9, 0.5))
    assert list(hits.material) == [END, WALL, CHAMBER, CHAMBER]
    assert hits.depth == pytest.approx([5.4, 0.5, 0.4, 0.4])


@pytest.mark.parametrize("down", [-1.2, -0.3, 0.3])
def test_beside_the_mouth_only_rays_through_it_see_the_pipe(down: float) -> None:
    sewer = VirtualSewer(circular(0.3), length=5.0)
    pose = Pose(down=down, chainage=-0.35)
    hits = sewer.cast(pose.position, pose.rotation, GRID)
    met = points(hits, pose, GRID)
    chamber = hits.material == CHAMBER
    assert met[chamber][:, 2] == pytest.approx(0.0, abs=1e-5)
    assert np.hypot(met[chamber][:, 0], met[chamber][:, 1]).min() > 0.15 - 1e-4
    inside = met[~chamber]
    assert np.all(inside[:, 2] > -1e-4)
    entry = pose.position + (inside - pose.position) * (0.35 / (inside[:, 2:] + 0.35))
    assert np.all(np.hypot(entry[:, 0], entry[:, 1]) < 0.15 + 1e-3), "none came through the chamber wall"
    assert chamber.all() == (down == -1.2)
