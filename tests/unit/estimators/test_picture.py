import cv2
import numpy as np

from estimators.picture import picture_quality


def scene(seed: int = 0) -> np.ndarray:
    """A lit, textured wall."""
    rng = np.random.default_rng(seed)
    texture = cv2.resize(rng.uniform(60, 200, (120, 160)).astype(np.float32), (640, 480), interpolation=cv2.INTER_LINEAR)
    return cv2.cvtColor(texture.astype(np.uint8), cv2.COLOR_GRAY2BGR)


def test_a_sharp_lit_picture_is_good() -> None:
    assert picture_quality(scene()).good


def test_blur_darkness_glare_and_dirt_are_named() -> None:
    sharp = scene()
    assert "blur" in picture_quality(cv2.GaussianBlur(sharp, (0, 0), 15)).reasons
    assert "dark" in picture_quality(sharp // 30).reasons
    assert "bright" in picture_quality(np.where(np.arange(480)[:, None, None] < 300, 255, sharp).astype(np.uint8)).reasons
    smeared = sharp.copy()
    smeared[:, 400:] = cv2.GaussianBlur(sharp, (0, 0), 40)[:, 400:]
    assert "dirt" in picture_quality(smeared).reasons


def test_grey_pictures_serve_too() -> None:
    assert picture_quality(cv2.cvtColor(scene(), cv2.COLOR_BGR2GRAY)).good
