"""Pictures that are moved by a known amount: what the flow must say is known to the pixel."""

import cv2
import numpy as np
import pytest

from estimators.flow import FlowConfig, Tracker, flow


def picture(seed: int = 0, shape: tuple[int, int] = (288, 360)) -> np.ndarray:
    noise = np.random.default_rng(seed).normal(size=shape).astype(np.float32)
    smooth = cv2.GaussianBlur(noise, (0, 0), 3)
    return np.clip(128 + 40 * smooth / smooth.std(), 0, 255).astype(np.uint8)


def moved(image: np.ndarray, matrix: list[list[float]]) -> np.ndarray:
    size = (image.shape[1], image.shape[0])
    return np.asarray(cv2.warpAffine(image, np.array(matrix, np.float32), size, borderMode=cv2.BORDER_REFLECT), np.uint8)


@pytest.mark.parametrize("shift", [(0.0, 0.0), (1.5, -0.75), (9.0, 4.0)])
def test_a_shifted_picture(shift: tuple[float, float]) -> None:
    image = picture()
    found = flow(image, moved(image, [[1, 0, shift[0]], [0, 1, shift[1]]]))
    inner = (np.abs(found.points - [180, 144]) < [150, 110]).all(axis=1)
    assert np.median(found.motion[inner], axis=0) == pytest.approx(shift, abs=0.05)
    assert inner.sum() > 100


def test_an_expanding_picture_moves_away_from_its_centre() -> None:
    image = picture()
    zoom = 1.02
    found = flow(image, moved(image, [[zoom, 0, 180 * (1 - zoom)], [0, zoom, 144 * (1 - zoom)]]))
    expected = (found.points - [180, 144]) * (zoom - 1) / (1 + (zoom - 1) / 2)  # at points half way
    assert np.median(np.hypot(*(found.motion - expected).T)) < 0.06


def test_a_picture_without_texture_or_without_a_likeness_gives_little() -> None:
    flat = np.full((288, 360), 90, np.uint8)
    assert len(flow(flat, flat).points) == 0
    strangers = flow(picture(0), picture(1))
    assert len(strangers.points) < 0.5 * strangers.tried


def shifted(image: np.ndarray, u: float, v: float = 0.0) -> np.ndarray:
    return moved(image, [[1, 0, u], [0, 1, v]])


def test_the_tracker_waits_for_motion_and_speaks_in_pixels_of_the_whole_picture() -> None:
    image = picture(shape=(576, 720))
    tracker = Tracker(FlowConfig(least=2.0, patience=5))
    assert tracker.step(image) is None
    spans = []
    for k in range(1, 13):  # 2 px a picture: every second one is compared
        found = tracker.step(shifted(image, 2.2 * k, -k))
        if found is not None:
            spans.append(found.span)
            assert np.median(found.motion, axis=0) == pytest.approx([2.2 * found.span, -found.span], abs=0.1)
            assert found.points[:, 0].max() > 600
    assert spans == [2] * 6


def test_the_tracker_is_back_within_its_patience_when_a_standing_camera_moves() -> None:
    image = picture(shape=(576, 720))
    tracker = Tracker(FlowConfig(least=2.0, patience=3))
    assert tracker.step(image) is None
    assert tracker.step(shifted(image, 0.2)) is None
    assert tracker.step(shifted(image, 6.0)) is None
    found = tracker.step(shifted(image, 12.0))
    assert found is not None
    assert found.span == 3
    assert np.median(found.motion, axis=0) == pytest.approx([12.0, 0.0], abs=0.1)


def test_the_tracker_does_not_wait_where_most_points_are_lost() -> None:
    image, rng = picture(shape=(576, 720)), np.random.default_rng(0)
    tracker = Tracker(FlowConfig(least=4.0, patience=5))
    noisy = [np.clip(90 + 0.04 * image + rng.normal(0, 30, image.shape), 0, 255).astype(np.uint8) for _ in range(4)]
    found = [tracker.step(one) for one in noisy]
    assert found[0] is None
    assert all(flow is not None and flow.span == 1 and len(flow.points) < 0.85 * flow.tried for flow in found[1:])


@pytest.mark.parametrize("shape", [(192, 240), (720, 1280)])
def test_small_and_large_pictures_are_tracked_in_their_own_pixels(shape: tuple[int, int]) -> None:
    image, tracker = picture(shape=shape), Tracker()
    assert tracker.step(image) is None
    found = tracker.step(shifted(image, 9.0, 4.0))
    assert found is not None
    assert np.median(found.motion, axis=0) == pytest.approx([9.0, 4.0], abs=0.15)
    assert 120 < found.tried < 260
    assert np.median(found.points, axis=0) == pytest.approx([shape[1] / 2, shape[0] / 2], rel=0.1)


def test_the_tracker_does_not_wait_for_ever_and_takes_another_size() -> None:
    image = picture(shape=(576, 720))
    tracker = Tracker(FlowConfig(patience=3))
    steps = [tracker.step(image) for _ in range(4)]
    assert [step is None for step in steps] == [True, True, True, False]
    assert tracker.step(picture(shape=(480, 640))) is None
