"""The first of the paper's visual questions, measured: is the colour picture good enough to judge by (sharp, lit, clean)?"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

_WIDTH = 320
MIN_SHARPNESS = 2.0
"""Variance of the Laplacian over the noise of a 320 pixel wide picture, in its sharpest quarter."""
DARK, BRIGHT = 12.0, 235.0
MAX_DARK, MAX_BRIGHT = 0.85, 0.35
MAX_DIRT = 0.25


@dataclass(frozen=True)
class PictureQuality:
    """``sharpness``: grey levels of fine structure; ``dark`` and ``bright``: shares of pixels without drawing; ``dirt``:
    share of the picture
    that is milky (neither dark nor structured) although the rest is sharp. ``reasons``: blur, dark, bright, dirt."""

    sharpness: float
    dark: float
    bright: float
    dirt: float
    reasons: tuple[str, ...]

    @property
    def good(self) -> bool:
        """Whether nothing speaks against the picture."""
        return not self.reasons


def picture_quality(bgr: NDArray[np.uint8]) -> PictureQuality:
    """Measure a colour picture (h, w, 3) or grey one (h, w), uint8."""
    grey = cv2.cvtColor(bgr, cv2.COLOR_BGR2GRAY) if bgr.ndim == 3 else bgr
    height = max(1, round(grey.shape[0] * _WIDTH / grey.shape[1]))
    small = cv2.resize(grey, (_WIDTH, height), interpolation=cv2.INTER_AREA)
    detail = np.abs(cv2.Laplacian(cv2.GaussianBlur(small, (3, 3), 0), cv2.CV_32F))
    blocks = cv2.resize(detail, (_WIDTH // 16, max(1, height // 16)), interpolation=cv2.INTER_AREA)
    light = cv2.resize(small.astype(np.float32), (blocks.shape[1], blocks.shape[0]), interpolation=cv2.INTER_AREA)
    sharpness = float(np.percentile(blocks, 75))
    dark, bright = float((small < DARK).mean()), float((small > BRIGHT).mean())
    milky = (blocks < 0.25 * MIN_SHARPNESS) & (light > 60) & (light < BRIGHT)
    dirt = float(milky.mean())
    checks = (
        ("dark", dark > MAX_DARK),
        ("bright", bright > MAX_BRIGHT),
        ("blur", sharpness < MIN_SHARPNESS),
        ("dirt", sharpness >= MIN_SHARPNESS and dirt > MAX_DIRT),
    )
    return PictureQuality(sharpness, dark, bright, dirt, tuple(name for name, failed in checks if failed))
