import numpy as np
import pytest

from estimators.frame import FrameEstimate, estimate_frame
from estimators.recording import ErrorModel, combine
from tests.unit.estimators.analytic_scenes import D435, UNIT_M, cylinder, to_depth


@pytest.fixture(scope="module")
def frames() -> list[FrameEstimate]:
    return [estimate_frame(to_depth(cylinder(0.15, end_wall=1.5), 0.01, seed), D435, UNIT_M, seed) for seed in range(6)]


def test_median_mean_and_weighted_mean(frames: list[FrameEstimate]) -> None:
    recording = combine(frames)
    radii = np.array([frame.fit.radius for frame in frames if frame.fit])
    shares = np.array([frame.fit.inlier_share for frame in frames if frame.fit])
    assert recording.diameter == pytest.approx(2 * np.median(radii))
    assert recording.mean == pytest.approx(2 * radii.mean())
    assert recording.inlier_weighted_mean == pytest.approx(2 * (radii * shares).sum() / shares.sum())
    assert recording.radius_std == pytest.approx(radii.std(ddof=1))
    assert recording.proxies["radius"] == pytest.approx((radii.mean(), radii.std(ddof=1)))


def test_interval_holds_the_truth_and_the_scale_error(frames: list[FrameEstimate]) -> None:
    recording = combine(frames, ErrorModel(scale_std=0.005))
    low, high = recording.interval
    assert low < 0.3 < high
    assert high - low >= 2 * 1.96 * 0.005 * recording.diameter
    wider = combine(frames, ErrorModel(scale_std=0.02)).interval
    assert wider[1] - wider[0] > 2 * (high - low)


def test_one_frame_takes_its_spread_from_resampling() -> None:
    clean = to_depth(cylinder(0.2, end_wall=1.5), 0.003)
    patchy = np.where(np.random.default_rng(0).random((480, 848)) < 0.02, clean, 0).astype(np.uint16)
    patchy[200:260, 500:700] = clean[200:260, 500:700]
    good = combine([estimate_frame(clean, D435, UNIT_M, resamples=8)])
    poor = combine([estimate_frame(patchy, D435, UNIT_M, resamples=8)])
    assert good.radius_std < 0.001
    assert not poor.radius_std < 5 * good.radius_std


def test_nothing_fitted_is_said_and_not_invented() -> None:
    recording = combine([estimate_frame(np.zeros((480, 848), np.uint16), D435, UNIT_M)] * 3)
    assert (recording.frames, recording.fitted) == (3, 0)
    assert np.isnan(recording.diameter)
    assert np.isnan(recording.interval).all()
    assert combine([]).frames == 0


def test_sway_is_the_move_between_frames() -> None:
    still = [estimate_frame(to_depth(cylinder(0.2, end_wall=1.5)), D435, UNIT_M)] * 4
    moved = [estimate_frame(to_depth(cylinder(0.2, offset=(0.02 * k, 0), end_wall=1.5)), D435, UNIT_M) for k in range(4)]
    assert combine(still).sway == 0
    assert combine(moved).sway == pytest.approx(0.02, abs=0.002)
