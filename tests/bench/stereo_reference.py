"""The whole published way of the RADIUS paper on one pair, as a baseline: its matching, its cloth filter, its band, its fit."""

from __future__ import annotations

import time
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from estimators.radial_profile.model import profile_at
from estimators.radial_profile.reference import reference_fit
from estimators.stereo.reference import reference_disparity

PAPER_BAND_PX = (109.7, 146.2)
"""The paper's fixed band, Z from 1.5 to 2.0 m at the focal length of its code (26 mm), as disparities: those do not depend on
it."""
BASELINE_M, PAPER_RANGE_PX_M = 0.029, 0.029 * 26.0 / 6.6 * 1920


@dataclass(frozen=True)
class ReferencePair:
    """``disparity`` (H, W) nan without a match; ``deviation`` (H, W) m, nan without a fit; ``score`` (m) eq. 18 in the band,
    None where nothing was fitted; ``seconds`` of processor time for matching, and for the rest."""

    disparity: NDArray[np.float32]
    deviation: NDArray[np.float32] | None
    score: float | None
    seconds: tuple[float, float]


def reference_pair(
    left: NDArray[np.uint8],
    right: NDArray[np.uint8],
    band_px: tuple[float, float] = PAPER_BAND_PX,
    disparity: NDArray[np.float32] | None = None,
) -> ReferencePair:
    """The reference on a pair (1200, 1920, 3). ``disparity``: what its matching found earlier, to save the time."""
    begun = time.process_time()
    if disparity is None:
        disparity = reference_disparity(left, right)
    matched = time.process_time()
    height, width = disparity.shape
    z = PAPER_RANGE_PX_M / disparity.astype(np.float64)
    focal = PAPER_RANGE_PX_M / BASELINE_M
    v, u = np.mgrid[0:height, 0:width]
    x, y = (u - width / 2) * z / focal, (v - height / 2) * z / focal
    r, theta = np.hypot(x, y), np.arctan2(y, x)
    usable = np.isfinite(disparity) & not_cloth(left)
    banded = usable & (disparity > band_px[0]) & (disparity < band_px[1])
    fit = reference_fit(r[banded], theta[banded], z[banded], np.random.default_rng(0))
    if fit is None:
        return ReferencePair(disparity, None, None, (matched - begun, time.process_time() - matched))
    deviation = np.full(disparity.shape, np.nan, np.float32)
    constant, slope = profile_at(fit.coefficients, theta[usable])
    deviation[usable] = r[usable] - constant - slope * z[usable]
    score = float(np.mean(np.maximum(-deviation[banded], 0.0)))
    return ReferencePair(disparity, deviation, score, (matched - begun, time.process_time() - matched))


def not_cloth(picture: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """False on the cloth that closes the far end: the flood fill of the published code, from the middle of the picture."""
    hsv = cv2.cvtColor(picture, cv2.COLOR_BGR2HSV)
    height, width = hsv.shape[:2]
    mask = np.zeros((height + 2, width + 2), np.uint8)
    rng = np.random.default_rng(0)
    seed = width // 2, height // 2
    for _ in range(50):
        flags = 8 | cv2.FLOODFILL_MASK_ONLY | (255 << 8)
        cv2.floodFill(hsv, mask, seed, (0,), (10, 10, 50), (10, 80, 50), flags)
        if np.count_nonzero(mask) >= 1000:
            break
        seed = width // 2 + int(rng.integers(-5, 5)), height // 2 + int(rng.integers(-5, 5))
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (21, 21))
    kept = cv2.morphologyEx(255 - mask[1:-1, 1:-1], cv2.MORPH_OPEN, kernel)
    return np.asarray(cv2.erode(kept, kernel) > 0)
