"""Flow fields whose centre is known by construction: a wall point moves by k rho (p - c), and what turning adds to it."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from estimators.flow import Flow
from estimators.foe import Foe, FoeConfig, Follower, _model, estimate, paper_foe, video_aspect

RATE = 4e-5


def field(
    centre: tuple[float, float],
    rate: float = RATE,
    shift: tuple[float, float] = (0.0, 0.0),
    slope: tuple[float, float] = (0.0, 0.0),
    noise: float = 0.0,
    seed: int = 0,
) -> Flow:
    """Flow of a 720 x 576 picture on a grid."""
    u, v = np.meshgrid(np.arange(20.0, 720, 40), np.arange(20.0, 576, 40))
    points = np.stack([u.ravel(), v.ravel()], axis=1)
    d = points - centre
    rho = np.hypot(*d.T)
    lean = 1 - (d @ np.array(slope)) / np.maximum(rho, 1e-6)
    motion = rate * (rho * lean)[:, None] * d + np.array(shift)
    motion = motion + noise * np.random.default_rng(seed).normal(size=motion.shape)
    return Flow(points, motion, len(points))


@settings(max_examples=30, deadline=None)
@given(u=st.floats(260, 460), v=st.floats(190, 390), rate=st.floats(1.5e-5, 1.5e-4), seed=st.integers(0, 99))
def test_finds_the_centre_of_a_clean_expansion(u: float, v: float, rate: float, seed: int) -> None:
    for found in (
        estimate(field((u, v), rate), np.random.default_rng(seed)),
        paper_foe(field((u, v), rate), np.random.default_rng(seed)),
    ):
        assert found is not None
        assert found.centre == pytest.approx([u, v], abs=0.5)


def test_driving_backwards_has_the_same_centre() -> None:
    found = estimate(field((340, 300), -RATE), np.random.default_rng(0))
    assert found is not None
    assert found.centre == pytest.approx([340, 300], abs=0.5)
    assert found.rate == pytest.approx(-RATE, rel=0.02)


def test_pitching_and_an_offset_move_the_papers_centre_and_not_ours() -> None:
    flow = field((380, 270), shift=(0.5, -0.6), slope=(0.1, -0.12), noise=0.05)
    ours, paper = (way(flow, np.random.default_rng(0)) for way in (estimate, paper_foe))
    assert ours is not None
    assert paper is not None
    assert np.hypot(*(ours.centre - [380, 270])) < 6
    assert np.hypot(*(paper.centre - [380, 270])) > 3 * np.hypot(*(ours.centre - [380, 270]))


def test_pixels_that_are_not_square() -> None:
    aspect = video_aspect(720, 576)
    assert aspect == pytest.approx(0.9375)
    assert video_aspect(1280, 720) == 1.0
    square = field((340, 300 * aspect), shift=(0.3, 0.2 * aspect), noise=0.02)
    stretch = np.array([1, 1 / aspect])
    flow = Flow(square.points * stretch, square.motion * stretch, len(square.points))
    found = estimate(flow, np.random.default_rng(0), FoeConfig(aspect=aspect))
    assert found is not None
    assert found.centre == pytest.approx([340, 300], abs=2)
    assert found.shift == pytest.approx((0.3, 0.2), abs=0.1)
    blind = estimate(flow, np.random.default_rng(0))
    assert blind is not None
    assert np.hypot(*(blind.centre - [340, 300])) > np.hypot(*(found.centre - [340, 300]))


def test_static_text_and_strays_do_not_count() -> None:
    flow = field((350, 290), noise=0.05)
    motion = flow.motion.copy()
    rng = np.random.default_rng(1)
    text = flow.points[:, 1] > 520
    stray = rng.random(len(motion)) < 0.2
    motion[text] = 0
    motion[stray] += rng.normal(0, 8, (int(stray.sum()), 2))
    found = estimate(Flow(flow.points, motion, len(motion)), np.random.default_rng(0))
    assert found is not None
    assert found.centre == pytest.approx([350, 290], abs=4)
    assert 0.5 < found.inlier_share < 0.85


def test_a_smooth_wall_in_a_noisy_picture_is_believed_less() -> None:
    quiet, loud = (
        [estimate(field((340, 300), 8e-5, noise=noise, seed=seed), np.random.default_rng(seed)) for seed in range(20)]
        for noise in (0.1, 0.8)
    )
    for found, noise in ((quiet, 0.1), (loud, 0.8)):
        assert all(foe is not None and foe.inlier_share > 0.9 for foe in found), noise
    errors = [foe.centre - [340, 300] for foe in loud if foe is not None]
    sizes = [e @ np.linalg.solve(foe.covariance, e) for e, foe in zip(errors, loud, strict=True) if foe is not None]
    assert 0.3 < np.mean(sizes) < 3
    assert np.trace(loud[0].covariance) > 10 * np.trace(quiet[0].covariance)  # type: ignore[union-attr]


def test_the_covariance_says_how_far_it_is_off() -> None:
    errors = []
    for seed in range(40):
        found = estimate(field((340, 300), noise=0.12, seed=seed), np.random.default_rng(seed))
        assert found is not None
        error = found.centre - [340, 300]
        errors.append(error @ np.linalg.solve(found.covariance, error))
    assert np.mean(errors) < 2.5  # 2 by definition, less since robust weights take the tails for less than they tell


def test_standing_turning_and_darkness_give_no_centre() -> None:
    rng = np.random.default_rng(0)
    assert estimate(field((350, 290), rate=1e-7), rng) is None
    turning = Flow(field((350, 290)).points, np.tile([6.0, 0.5], (len(field((350, 290)).points), 1)), 252)
    assert estimate(turning, rng) is None
    assert estimate(Flow(np.empty((0, 2)), np.empty((0, 2)), 250), rng) is None
    trembling = Flow(turning.points, rng.normal((0.3, 0.0), 0.17, turning.motion.shape), 252)
    for seed in range(10):
        assert estimate(trembling, np.random.default_rng(seed)) is None
    noise = Flow(turning.points, rng.normal(0, 5, turning.motion.shape), 252)
    assert estimate(noise, rng) is None


def test_jacobian() -> None:
    x = np.array([10.0, -5, 2e-5, 0.3, -0.2, 0.002, 0.1, -0.05])
    points = np.random.default_rng(0).normal(0, 150, (2, 6))
    _, jacobian = _model(points, x)
    for k, step in enumerate([1e-4, 1e-4, 1e-9, 1e-4, 1e-4, 1e-6, 1e-5, 1e-5]):
        h = np.zeros(8)
        h[k] = step
        numeric = (_model(points, x + h)[0] - _model(points, x - h)[0]) / (2 * step)
        assert jacobian[k] == pytest.approx(numeric, rel=1e-4, abs=1e-6)


def measured(u: float, v: float, std: float = 3.0) -> Foe:
    return Foe(np.array([u, v]), std**2 * np.eye(2), 0.9, 200)


def test_the_follower_keeps_up_with_a_drift() -> None:
    follower = Follower((360.0, 288.0))
    rng = np.random.default_rng(0)
    late = []
    for k in range(300):
        truth = np.array([360 + 0.2 * k, 288 - 0.1 * k])
        centre, _ = follower.update(measured(*(truth + rng.normal(0, 3, 2))), moving=True)
        late.append(np.array(centre) - truth)
    assert np.abs(np.mean(late[100:], axis=0)).max() < 0.7
    assert np.hypot(*np.array(late[100:]).T).mean() < 2.5


def test_the_follower_holds_while_the_crawler_stands() -> None:
    follower = Follower((360.0, 288.0))
    for k in range(60):
        follower.update(measured(340 + 0.3 * k, 300), moving=True)
    held = follower.centre
    for _ in range(100):
        follower.update(measured(10, 10), moving=False)
    assert follower.centre == held


def test_one_stray_is_left_out_and_a_new_place_is_taken_in_time() -> None:
    follower = Follower((360.0, 288.0))
    for _ in range(60):
        follower.update(measured(340, 300), moving=True)
    before = np.array(follower.centre)
    follower.update(measured(600, 100), moving=True)
    assert np.hypot(*(np.array(follower.centre) - before)) < 1
    for _ in range(40):
        follower.update(measured(420, 250), moving=True)
    assert follower.centre == pytest.approx((420, 250), abs=3)
