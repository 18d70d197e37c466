"""CCTV pictures of the virtual sewer: what they show lies where the truth says."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from drivers.virtual.camera import CctvCamera, on_wall
from drivers.virtual.cctv import Renderer, render
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


@pytest.mark.parametrize("ahead", [0.3, 0.5, 0.9])
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
