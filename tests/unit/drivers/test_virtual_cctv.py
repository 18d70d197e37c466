"""CCTV pictures of the virtual sewer: what they show lies where the truth says."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from drivers.virtual.camera import CctvCamera, on_wall
from drivers.virtual.cctv import Renderer, render
from drivers.virtual.furnish import furnished_sewer
from drivers.virtual.landmarks import Connection, DisplacedJoint, Fracture, Patch, Roots, Thing
from drivers.virtual.look import Look, random_look
from drivers.virtual.profile import circular, egg
from drivers.virtual.rig import Pose
from drivers.virtual.world import Joint, VirtualSewer

CAMERA = CctvCamera()
CLEAN = Look(
    pieces=0.0, grain=0.0, stains=0.0, specks=0.0, dirt_line=-3.0, noise=0.0, jpeg=100, interlace=False, lamp_side=0.0, blur=0.0
)
ASKEW = Pose(0.012, -0.015, 2.0, 0.05, -0.04, 0.03)


def gray(picture: NDArray[np.uint8]) -> NDArray[np.float64]:
    return np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY), np.float64)


def look_at(sewer: VirtualSewer, pose: Pose, look: Look = CLEAN, seed: int = 1) -> NDArray[np.uint8]:
    return render(sewer, CAMERA, pose, np.random.default_rng(5), look, seed=seed)


# --- rings ---


@pytest.mark.parametrize("ahead", [0.3, 0.8])
@pytest.mark.parametrize("diameter", [0.3, 0.6])
def test_a_joint_is_a_dark_ring_of_radius_f_r_over_z(ahead: float, diameter: float) -> None:
    ahead *= diameter / 0.3
    pose = Pose(chainage=2.0)
    picture = gray(look_at(VirtualSewer(circular(diameter), 20.0, joints=(Joint(2.0 + ahead, 0.02),)), pose))
    plain = gray(look_at(VirtualSewer(circular(diameter), 20.0), pose))
    darker = (plain - picture)[287, :]  # a row through the middle of a camera that looks along the axis
    for side in (-1, 1):
        away = side * (np.arange(720) - CAMERA.cx)
        one_side = np.where(away > 0, darker, 0)
        dark = np.flatnonzero(one_side > 0.5 * one_side.max())
        # u = f R / Z, read backwards at both edges of the gap
        edges = CAMERA.fx * diameter / 2 / away[[dark[0], dark[-1]]]
        a_pixel = ahead**2 / (CAMERA.fx * diameter / 2)
        assert edges.mean() == pytest.approx(ahead, abs=0.005 + 0.5 * a_pixel)


def test_a_ring_seen_askew_lies_where_its_points_are_projected() -> None:
    joint = 2.5
    ring = gray(look_at(VirtualSewer(circular(0.3), 20.0, joints=(Joint(joint, 0.02),)), ASKEW))
    plain = gray(look_at(VirtualSewer(circular(0.3), 20.0), ASKEW))
    angle = np.linspace(-np.pi, np.pi, 72, endpoint=False)
    pixels = CAMERA.project(ASKEW, on_wall(0.15, np.array(joint), angle))
    assert np.all(CAMERA.holds(pixels))
    u, v = np.round(pixels).astype(int).T
    dark = ring[v, u] / plain[v, u]
    assert np.median(dark) < 0.5
    assert dark.max() < 0.95
    beside = CAMERA.project(ASKEW, on_wall(0.15, np.array(joint - 0.15), angle))
    beside = beside[CAMERA.holds(beside)]
    u, v = np.round(beside).astype(int).T
    assert np.median(ring[v, u] / plain[v, u]) > 0.9


# --- the wall ---


@pytest.mark.parametrize("pose", [Pose(chainage=2.0), ASKEW])
def test_texture_moves_as_the_projection_says(pose: Pose) -> None:
    sewer, look = VirtualSewer(circular(0.3), 20.0), replace(CLEAN, grain=0.12, stains=0.12)
    step = 0.008  # 0.2 m/s at 25 frames a second
    first, second = (look_at(sewer, replace(pose, chainage=pose.chainage + far), look) for far in (0.0, step))
    chainage, angle = np.meshgrid(pose.chainage + np.array([0.3, 0.4, 0.6]), np.linspace(-3, 3, 24))
    points = on_wall(0.15, chainage.ravel(), angle.ravel())
    before, after = (CAMERA.project(replace(pose, chainage=pose.chainage + far), points) for far in (0.0, step))
    inside = np.all((after > 25) & (after < [695, 551]), axis=1)
    found, good, _ = cv2.calcOpticalFlowPyrLK(
        *(cv2.cvtColor(p, cv2.COLOR_BGR2GRAY) for p in (first, second)), before[inside].astype(np.float32)[:, None], None
    )  # type: ignore[call-overload]
    error = np.hypot(*(found[:, 0] - after[inside]).T)[good[:, 0] == 1]
    assert len(error) > 30
    assert np.median(error) < 0.25
    assert np.quantile(error, 0.9) < 0.8
    assert np.median(np.hypot(*(after - before)[inside].T)) > 2, "there was something to see"


def test_it_grows_dark_along_the_pipe() -> None:
    picture = gray(look_at(VirtualSewer(circular(0.3), 30.0), Pose(chainage=1.0)))
    middle = [picture[287, 360 + offset] for offset in (5, 40, 120, 300)]
    assert middle[0] < 0.25 * middle[3]
    assert middle[0] < middle[1] < middle[2]


def test_the_wall_is_the_same_wherever_it_was_looked_at_before() -> None:
    sewer, look = VirtualSewer(circular(0.3), 30.0), replace(CLEAN, grain=0.1, stains=0.1, dirt_line=0.5)
    near, far = Pose(chainage=1.0), Pose(chainage=22.0)
    fresh = Renderer(sewer, CAMERA, look, 3)
    used = Renderer(sewer, CAMERA, look, 3)
    for pose in (near, far, near, far):
        last = used.picture(pose, np.random.default_rng(1))
    assert np.array_equal(last, fresh.picture(far, np.random.default_rng(1)))


def test_an_egg_is_not_drawn_round() -> None:
    shape = egg(0.3)
    pose = Pose(chainage=2.0)
    ring = gray(look_at(VirtualSewer(shape, 20.0, joints=(Joint(2.5, 0.02),)), pose))
    plain = gray(look_at(VirtualSewer(shape, 20.0), pose))
    dark = plain - ring > 25
    rows, columns = np.nonzero(dark)
    assert np.ptp(rows) / CAMERA.fy == pytest.approx(0.45 / 0.5, rel=0.05)
    assert np.ptp(columns) / CAMERA.fx == pytest.approx(0.30 / 0.5, rel=0.06)


# --- landmarks ---


def changed(thing: Thing, pose: Pose, look: Look = CLEAN, seed: int = 1, water: float = 0.0) -> NDArray[np.float64]:
    """Grey levels (H, W) that a landmark takes away from the picture of the empty pipe."""
    joints = (Joint(2.5, 0.02),)
    bare = VirtualSewer(circular(0.3), 20.0, water, joints=joints)
    return gray(look_at(bare, pose, look, seed)) - gray(look_at(replace(bare, things=(thing,)), pose, look, seed))


def outline(thing: Thing, pose: Pose) -> NDArray[np.float64]:
    """(n, 2) pixels of the border of what a landmark covers."""
    begin, end, left, right = thing.reach(0.15)
    angle = np.concatenate([np.linspace(left, right, 20), np.linspace(right, left, 20)])
    chainage = np.repeat([begin, end], 20)
    return CAMERA.project(pose, on_wall(0.15, chainage, angle))


@pytest.mark.parametrize(("angle", "pose"), [(-2.6, Pose(chainage=2.0)), (-1.4, ASKEW), (0.2, ASKEW)])
def test_a_connection_is_a_dark_blob_where_its_truth_is_projected(angle: float, pose: Pose) -> None:
    hole = Connection(2.5, angle, 0.12)
    dark = changed(hole, pose) > 60
    rim = np.linspace(0, 2 * np.pi, 60)
    turned = np.arcsin(0.06 * np.cos(rim) / 0.15)
    border = CAMERA.project(pose, on_wall(0.15, 2.5 + 0.06 * np.sin(rim), angle + turned)).astype(np.float32)
    v, u = np.mgrid[:576, :720]
    inside = np.zeros((576, 720), np.uint8)
    cv2.fillPoly(inside, [np.round(border).astype(np.int32)], 1)
    blob = inside > 0
    assert (dark & blob).sum() / (dark | blob).sum() > 0.6
    assert np.hypot(u[dark].mean() - u[blob].mean(), v[dark].mean() - v[blob].mean()) < 12


def test_a_deposit_lies_in_its_patch_and_stands_out_of_the_water() -> None:
    patch = Patch(2.4, 3.2, np.pi / 2 + 0.1, 0.5, 0.03)
    pose = Pose(chainage=2.0)
    for water in (0.0, 0.012):
        difference = np.abs(changed(patch, pose, water=water)) > 12
        area = np.zeros((576, 720), np.uint8)
        cv2.fillPoly(area, [np.round(outline(patch, pose)).astype(np.int32)], 1)
        area = cv2.dilate(area, np.ones((25, 25), np.uint8))
        assert (difference & (area > 0)).sum() > 3000
        assert (difference & (area > 0)).sum() > 0.8 * difference.sum(), "its shadow and mirror image aside"


def test_of_a_displaced_joint_the_face_shows_on_its_side() -> None:
    # the pipe behind stands in at 3 o'clock: its edge is at f (R - step) / Z there, and the face between that and f R / Z
    step, pose = DisplacedJoint(2.5, 0.0, 0.02), Pose(chainage=2.0)
    profile = np.abs(changed(step, pose))[287]
    outer, inner = 431.25 * 0.15 / 0.5, 431.25 * 0.13 / 0.5
    right = np.flatnonzero(profile[360:] > 15)
    assert right[0] < inner + 6
    face = profile[360 + int(inner) + 2 : 360 + int(outer) - 2]
    assert np.mean(face > 8) > 0.6


@pytest.mark.parametrize("seed", range(2))
def test_a_fracture_is_thin_and_dark_along_its_way(seed: int) -> None:
    crack, pose = Fracture(2.3, 2.7, -1.2, -0.9), Pose(chainage=2.0)
    dark = changed(crack, pose, seed=seed) > 25
    assert 100 < dark.sum() < 15_000
    share = np.linspace(0.05, 0.95, 12)
    way = CAMERA.project(pose, on_wall(0.15, 2.3 + 0.4 * share, -1.2 + 0.3 * share))
    near = cv2.dilate(dark.astype(np.uint8), np.ones((31, 31), np.uint8)) > 0
    seen = [near[round(v), round(u)] for u, v in way if 0 <= u < 719 and 0 <= v < 575]
    assert np.mean(seen) > 0.7


def test_roots_hang_in_at_their_joint() -> None:
    roots, pose = Roots(2.5, -np.pi / 2, 0.4, 0.08, 40), Pose(chainage=2.0)
    difference = np.abs(changed(roots, pose)) > 10
    v, u = np.nonzero(difference)
    assert difference.sum() > 800
    assert u.mean() == pytest.approx(CAMERA.cx, abs=25)
    # from the crown at 460 * 0.15 / 0.5 = 138 px above the middle down to where they end
    assert CAMERA.cy - 138 - 25 < np.quantile(v, 0.02)
    assert CAMERA.cy - 138 < v.mean() < CAMERA.cy - 30
    assert not difference[300:].any()


def test_water_mirrors_and_lies_level() -> None:
    sewer = VirtualSewer(circular(0.3), 20.0)
    pose, look = Pose(chainage=2.0), replace(CLEAN, water=(0.0, 0.0, 0.0))
    dry, wet = (gray(look_at(replace(sewer, water=water), pose, look)) for water in (0.0, 0.05))
    changed_rows, changed_columns = np.nonzero(np.abs(wet - dry) > 8)
    # its shore at the near edge of the picture: y = 0.10, x = sqrt(0.15^2 - 0.10^2), so v / u = fy y / (fx x)
    bottom = changed_columns[changed_rows == 574]
    half = np.sqrt(0.15**2 - 0.10**2) / 0.10 * (575 - CAMERA.cy) * CAMERA.fx / CAMERA.fy
    assert np.ptp(bottom) / 2 == pytest.approx(half, rel=0.06)
    assert (wet < dry - 8).sum() > 0.95 * len(changed_rows), "black water only darkens"
    assert changed_rows.min() > CAMERA.cy


def test_flowing_water_moves_while_the_wall_stands() -> None:
    sewer = VirtualSewer(circular(0.3), 20.0, water=0.05)
    look = replace(CLEAN, grain=0.2, ripples=0.06)
    renderer = Renderer(sewer, CAMERA, look, 1)
    one, other = (gray(renderer.picture(Pose(chainage=2.0), np.random.default_rng(1), moment=t)) for t in (0.0, 0.5))
    difference = np.abs(one - other)
    assert difference[:280].max() == 0
    assert difference[450:, 300:420].mean() > 1


def test_burned_in_text_is_there_and_nowhere_else() -> None:
    renderer = Renderer(VirtualSewer(circular(0.3), 20.0), CAMERA, replace(CLEAN, text=True), 1)
    plain = gray(renderer.picture(Pose(chainage=2.0), np.random.default_rng(1)))
    lettered = gray(renderer.picture(Pose(chainage=2.0), np.random.default_rng(1), texts=("0012.30 m", "00:12")))
    rows, columns = np.nonzero(plain != lettered)
    assert (rows.min() > 480, columns.max() < 250) == (True, True)
    assert lettered[rows, columns].max() > 220


@given(st.integers(0, 10_000))
@settings(max_examples=4, deadline=None)
def test_any_furnished_pipe_can_be_drawn_from_anywhere_in_it(seed: int) -> None:
    rng = np.random.default_rng(seed)
    sewer = furnished_sewer(rng, 12.0, float(rng.choice([0.2, 0.3, 0.6])))
    radius = sewer.radius
    for _ in range(2):
        right, down = rng.uniform(-0.3, 0.3, 2) * radius
        pose = Pose(float(right), float(down), float(rng.uniform(-0.5, 12.5)), *(float(a) for a in rng.normal(0, 0.1, 3)))
        small = CctvCamera(96.0, 102.0, 79.5, 63.5, 160, 128)
        picture = render(sewer, small, pose, rng, random_look(rng), replace(pose, chainage=pose.chainage - 0.004))
        assert picture.shape == (128, 160, 3)


# --- the recorder ---


def test_the_two_fields_of_an_interlaced_picture_are_two_moments() -> None:
    sewer, look = VirtualSewer(circular(0.3), 20.0), replace(CLEAN, grain=0.12, stains=0.12)
    now, before = Pose(chainage=2.0), Pose(chainage=1.98)
    woven = Renderer(sewer, CAMERA, replace(look, interlace=True), 1).picture(now, np.random.default_rng(1), before)
    whole = Renderer(sewer, CAMERA, look, 1)
    assert np.array_equal(woven[::2], whole.picture(now, np.random.default_rng(1))[::2])
    assert np.abs(woven[1::2].astype(int) - whole.picture(before, np.random.default_rng(1))[1::2]).mean() < 3
    assert np.abs(woven[1::2].astype(int) - whole.picture(now, np.random.default_rng(1))[1::2]).mean() > 5


def test_seeds_settle_the_picture() -> None:
    sewer = VirtualSewer(circular(0.3), 20.0)
    look = random_look(np.random.default_rng(3))
    a, b, c = (look_at(sewer, ASKEW, look, seed) for seed in (4, 4, 5))
    assert a.shape == (576, 720, 3)
    assert a.dtype == np.uint8
    assert np.array_equal(a, b)
    assert not np.array_equal(a, c)


def test_looks_differ_from_seed_to_seed_and_are_neither_black_nor_white() -> None:
    sewer = VirtualSewer(circular(0.3), 20.0, joints=(Joint(2.6, 0.02),))
    means = []
    for seed in range(6):
        picture = look_at(sewer, Pose(chainage=2.0), random_look(np.random.default_rng(seed)), seed)
        means.append(picture.mean(axis=(0, 1)))
        assert 40 < picture.mean() < 235
    assert np.std(means, axis=0).min() > 5
