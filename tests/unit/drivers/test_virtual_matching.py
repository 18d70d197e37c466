"""What geometry does to a stereo match, in the virtual camera as in a real one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from drivers.virtual.noise import BASELINE_M, UNIT_M, Matching, StereoCamera, StereoNoise, Window
from drivers.virtual.profile import circular
from drivers.virtual.rig import Pose
from drivers.virtual.world import WALL, Hits, VirtualSewer
from estimators.pinhole import Intrinsics, rays

LENS = Intrinsics(848, 480, 421.139, 421.139, 426.176, 237.017)
FINE_LENS = Intrinsics(1280, 720, 635.682, 635.682, 643.285, 355.427)
CLEAN = StereoNoise(fine=0.0, coarse=0.0, speckles=0.0, matching=Matching(uneven=0.0))


def seen_by(noise: StereoNoise, hits: Hits, lens: Intrinsics = LENS, seed: int = 1) -> NDArray[np.uint16]:
    return StereoCamera(lens, noise, Window(), np.random.default_rng(seed)).picture(hits)


def flat(depth: float, lens: Intrinsics = LENS) -> Hits:
    shape = (lens.height // 2, lens.width // 2)
    return Hits(np.full(shape, depth, np.float32), np.ones(shape, np.float32), np.full(shape, WALL, np.uint8))


def pipe(diameter: float) -> Hits:
    pose = Pose(chainage=0.3)
    return VirtualSewer(circular(diameter)).cast(pose.position, pose.rotation, np.ascontiguousarray(rays(LENS)[::2, ::2]))


@pytest.mark.parametrize("depth", [0.2, 0.4, 1.5])
def test_what_only_the_left_eye_sees_is_missing(depth: float) -> None:
    picture = seen_by(CLEAN, flat(depth))
    hidden = round(LENS.fx * BASELINE_M / depth)
    assert not picture[:, : hidden - 1].any()
    assert (picture[:, hidden + 1 :] > 0).mean() > 0.8


@pytest.mark.parametrize(("lens", "nearest"), [(LENS, 0.167), (FINE_LENS, 0.252)])
def test_a_finer_picture_begins_further_away(lens: Intrinsics, nearest: float) -> None:
    assert not seen_by(CLEAN, flat(nearest - 0.005, lens), lens).any()
    assert (seen_by(CLEAN, flat(nearest + 0.005, lens), lens) > 0).mean() > 0.5


def test_side_walls_of_a_small_pipe_are_lost_and_its_crown_and_invert_are_not() -> None:
    hits = pipe(0.2)
    missing = np.zeros((LENS.height, LENS.width))
    for seed in range(4):
        missing += seen_by(CLEAN, hits, seed=seed) == 0
    middle_v, middle_u, reach = round(LENS.ppy), round(LENS.ppx), 150
    crown = missing[middle_v - reach - 20 : middle_v - reach + 20, middle_u - 40 : middle_u + 40].mean() / 4
    side = missing[middle_v - 40 : middle_v + 40, middle_u + reach - 20 : middle_u + reach + 20].mean() / 4
    assert crown < 0.35
    assert side > crown + 0.4


def test_side_walls_of_a_large_pipe_stay() -> None:
    picture = seen_by(CLEAN, pipe(0.8))
    assert (picture[200:280, 600:640] > 0).mean() > 0.7


def test_without_slant_the_sides_are_as_the_crown() -> None:
    picture = seen_by(replace(CLEAN, matching=Matching(slant=0.0, uneven=0.0)), pipe(0.2))
    assert (picture[200:280, 556:596] > 0).mean() > 0.7


def test_false_matches_are_far_at_the_left_and_round() -> None:
    nothing = Hits(*(np.zeros((240, 424), kind) for kind in (np.float32, np.float32, np.uint8)))
    noise = replace(CLEAN, light=0.0, speckles=400.0)
    picture = seen_by(noise, nothing)
    disparity = np.where(picture > 0, LENS.fx * BASELINE_M / np.maximum(picture * UNIT_M, 1e-3), 0)
    columns = np.broadcast_to(np.arange(LENS.width), picture.shape)
    # a blob begins where its disparity still fits into the picture, and is at most 17 pixels wide
    assert (disparity[picture > 0] <= np.minimum(columns[picture > 0] + 1, 127)).all()
    assert 0.5 * 126 * 0.8 < np.median(disparity[(picture > 0) & (columns > 200)]) < 0.5 * 126 * 1.2
    assert 0.01 < (picture > 0).mean() < 0.12


def test_the_wall_that_closes_the_pipe_is_whole_and_the_rim_around_it_is_thin() -> None:
    pose = Pose(chainage=0.3)
    hits = VirtualSewer(circular(0.4), length=1.5).cast(
        pose.position, pose.rotation, np.ascontiguousarray(rays(LENS)[::2, ::2])
    )
    missing = np.mean([seen_by(replace(CLEAN, light=0.8), hits, seed=seed) == 0 for seed in range(4)], axis=0)
    radius = LENS.fx * 0.2 / 1.2
    v, u = np.mgrid[: LENS.height, : LENS.width]
    away = np.hypot(u - LENS.ppx, v - LENS.ppy)
    end, rim, wall = (
        missing[(away > radius * low + add) & (away < radius * low + add + 15)].mean()
        for low, add in ((0.3, 0), (1, 4), (1, 40))
    )
    assert end < 0.05
    assert rim > wall + 0.1


def test_large_patches_differ_and_stay_where_they_are() -> None:
    camera = StereoCamera(LENS, replace(CLEAN, light=0.7, matching=Matching(uneven=0.6)), Window(), np.random.default_rng(3))
    blocks = [(camera.picture(flat(0.6)) > 0)[:, 48:].reshape(4, 120, 8, 100).mean(axis=(1, 3)) for _ in range(2)]
    assert blocks[0].std() > 0.1
    assert np.corrcoef(blocks[0].ravel(), blocks[1].ravel())[0, 1] > 0.9
