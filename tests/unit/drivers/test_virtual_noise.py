"""How the virtual cameras err: statistics in bands, settled by the seed."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from drivers.virtual import world
from drivers.virtual.noise import (
    BASELINE_M,
    StereoCamera,
    StereoNoise,
    TimeOfFlightCamera,
    TimeOfFlightNoise,
    Window,
)
from drivers.virtual.profile import circular
from drivers.virtual.rig import Pose
from drivers.virtual.world import Hits, VirtualSewer
from estimators.pinhole import Intrinsics, rays

LENS = Intrinsics(848, 480, 421.0, 421.0, 424.0, 240.0)
TOF_LENS = Intrinsics(224, 172, 186.4, 186.4, 111.6, 85.8)
INNER = (slice(40, -40), slice(120, -60))
"""Away from the borders, where one picture sees what the other does not."""


def facing(metres: float, material: int = world.END, lens: Intrinsics = LENS, cosine: float = 1.0) -> Hits:
    """A wall straight across."""
    shape = (lens.height // 2, lens.width // 2)
    return Hits(np.full(shape, metres, np.float32), np.full(shape, cosine, np.float32), np.full(shape, material, np.uint8))


def stereo(seed: int = 1, noise: StereoNoise | None = None, window: Window | None = None) -> StereoCamera:
    quiet = noise or StereoNoise(speckles=0)
    return StereoCamera(LENS, quiet, window or Window(), np.random.default_rng(seed))


def metres(depth: NDArray[np.uint16]) -> NDArray[np.float64]:
    return depth[INNER].astype(float) / 1000


def holes(hits: Hits, noise: StereoNoise | None = None) -> float:
    return float((stereo(noise=noise).picture(hits)[INNER] == 0).mean())


# --- active stereo ---


def test_the_seed_settles_every_pixel() -> None:
    pictures = [[camera.picture(facing(0.6)) for _ in range(2)] for camera in (stereo(4), stereo(4), stereo(5))]
    assert np.array_equal(pictures[0], pictures[1])
    assert not np.array_equal(pictures[0][0], pictures[2][0])
    assert not np.array_equal(pictures[0][0], pictures[0][1]), "frames differ"


@pytest.mark.parametrize("distance", [0.4, 0.8, 1.6])
def test_noise_is_of_disparity_so_depth_noise_grows_with_its_square(distance: float) -> None:
    depth = metres(stereo().picture(facing(distance)))
    seen = depth[depth > 0]
    disparity = LENS.fx * BASELINE_M / seen
    std = 1.4826 * np.median(np.abs(disparity - np.median(disparity)))
    noise = StereoNoise()
    expected = np.hypot(noise.fine, noise.coarse)
    assert 0.6 * expected < std < 1.6 * expected
    assert np.median(seen) == pytest.approx(distance, rel=0.01)


def test_half_of_the_coarse_noise_stays_with_the_scene() -> None:
    camera = stereo(noise=StereoNoise(fine=0.0, speckles=0))
    first, second = (metres(camera.picture(facing(0.8))) for _ in range(2))
    both = (first > 0) & (second > 0)
    assert 0.3 < np.corrcoef(1 / first[both], 1 / second[both])[0, 1] < 0.7


def test_a_grazing_wall_is_noisier_and_has_more_holes() -> None:
    spread = []
    for cosine in (1.0, 0.05):
        depth = metres(stereo(noise=StereoNoise(light=0.45, speckles=0)).picture(facing(0.6, cosine=cosine)))
        spread.append((float(np.std(1 / depth[depth > 0])), float((depth == 0).mean())))
    assert spread[1][0] > 1.2 * spread[0][0]
    assert spread[1][1] > spread[0][1]


def test_holes_grow_with_range_darkness_and_on_water() -> None:
    dim = StereoNoise(light=0.45, speckles=0)
    near, far = (holes(facing(distance, cosine=0.1), dim) for distance in (0.6, 2.5))
    assert near < 0.5
    assert far > near
    assert holes(facing(0.6), StereoNoise(light=0.2, speckles=0)) > near + 0.1
    assert holes(facing(0.6, world.WATER)) > near + 0.2


def test_nearer_than_it_can_see_there_is_nothing() -> None:
    assert holes(facing(0.1)) == 1.0
    shared_from = int(LENS.fx * BASELINE_M / 0.6) - 1
    assert not stereo().picture(facing(0.6))[:, :shared_from].any(), "the left border has no partner in the other picture"


def test_speckle_stands_only_where_nothing_true_is_seen() -> None:
    dark = facing(0.1)
    assert holes(dark, StereoNoise(speckles=0)) == 1.0
    speckled = holes(dark, StereoNoise(speckles=300))
    assert 0.8 < speckled < 0.99
    few = stereo(noise=StereoNoise(speckles=0)).picture(facing(0.6))
    many = stereo(noise=StereoNoise(speckles=400)).picture(facing(0.6))
    true = few > 0
    assert np.array_equal(few[true], many[true])


def test_disparity_comes_in_steps() -> None:
    seen = np.unique(stereo().picture(facing(2.0)))
    seen = seen[(seen > 1500) & (seen < 2600)]
    steps = np.diff(LENS.fx * BASELINE_M / (seen / 1000.0)) * StereoNoise().steps
    assert np.median(np.abs(steps)) == pytest.approx(1.0, abs=0.2)


@pytest.mark.parametrize("scale", [-0.02, 0.03])
def test_a_cover_scales_every_distance(scale: float) -> None:
    plain, covered = (metres(stereo(2, window=window).picture(facing(0.8))) for window in (Window(), Window(scale)))
    assert np.median(covered[covered > 0]) / np.median(plain[plain > 0]) == pytest.approx(1 + scale, abs=0.003)


def test_dirt_on_the_window_hides_what_is_behind_it() -> None:
    depth = stereo(window=Window(smears=((0.5, 0.5, 0.1), (0.7, 0.3, 0.1), (0.3, 0.3, 0.08)))).picture(facing(0.6))
    assert not depth[238:243, 420:428].any()
    ghost = depth[140:148, 250:258].astype(float) / 1000
    assert ghost.max() < 0.3, "every third smear is taken for something near"


# --- time of flight ---


def time_of_flight(noise: TimeOfFlightNoise, seed: int = 1, window: Window | None = None) -> TimeOfFlightCamera:
    return TimeOfFlightCamera(TOF_LENS, noise, window or Window(), np.random.default_rng(seed))


def test_time_of_flight_is_settled_by_its_seed() -> None:
    first, again, other = (time_of_flight(TimeOfFlightNoise(), seed).picture(facing(0.6, lens=TOF_LENS)) for seed in (3, 3, 4))
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)


def test_multipath_makes_a_concave_wall_look_wider_and_leaves_a_flat_one() -> None:
    camera = time_of_flight(TimeOfFlightNoise(std=0.0005, multipath=0.03))
    wall, flat = (camera.picture(facing(0.8, kind, TOF_LENS)) for kind in (world.WALL, world.END))
    assert np.median(wall) / 1000 == pytest.approx(0.8 * 1.03, rel=0.005)
    assert np.median(flat) / 1000 == pytest.approx(0.8, rel=0.005)


def test_flying_pixels_lie_between_the_two_surfaces_of_an_edge() -> None:
    hits = facing(0.4, lens=TOF_LENS)
    hits.depth[:, hits.depth.shape[1] // 2 :] = 1.2
    depth = {
        share: time_of_flight(TimeOfFlightNoise(std=0.0002, flying=share)).picture(hits).astype(float) / 1000
        for share in (0.0, 0.9)
    }
    between = {share: ((d > 0.5) & (d < 1.1)).sum() for share, d in depth.items()}
    assert between[0.9] > between[0.0] + 50
    away = np.abs(np.arange(TOF_LENS.width) - TOF_LENS.width / 2) > 12
    assert not ((depth[0.9][:, away] > 0.5) & (depth[0.9][:, away] < 1.1)).any()


def test_time_of_flight_noise_grows_with_range() -> None:
    camera = time_of_flight(TimeOfFlightNoise(multipath=0.0))
    near, far = (float(np.std(camera.picture(facing(d, lens=TOF_LENS)))) for d in (0.4, 2.0))
    assert far > 3 * near


def test_the_stereo_camera_keeps_the_shape_of_a_pipe() -> None:
    """The residual to the true wall stays within the noise: nothing is shifted or turned over."""
    sewer, pose = VirtualSewer(circular(0.3), 20.0), Pose(0.02, -0.03, 0.1, 0.05, -0.03, 0.1)
    exact = sewer.cast(pose.position, pose.rotation, rays(LENS))
    coarse = sewer.cast(pose.position, pose.rotation, rays(LENS)[::2, ::2])
    depth = stereo().picture(coarse).astype(float) / 1000
    use = (depth > 0.25) & (exact.depth < 1.0) & (exact.material == world.WALL)
    residual = LENS.fx * BASELINE_M * (1 / depth[use] - 1 / exact.depth[use])
    assert use.mean() > 0.25
    assert abs(np.median(residual)) < 0.1
    assert 1.4826 * np.median(np.abs(residual)) < 0.6
