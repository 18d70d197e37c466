"""The first look at a pair: semi-global matching of small pictures, dense and rough, and which of it rises like a wall."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from estimators.stereo.rig import StereoRig

_WIDTH = 480
_HIGHEST_SHARE = 0.2
"""Largest disparity looked for, as a share of the width: a wall at one and a half radii in front of common stereo cameras."""
_BLOCK = 5
_SLOPE_WINDOW = 13
_RADII_M = (0.04, 1.6)
"""Pipes that stereo is asked to look into: the slope of the disparity along a picture's radius is baseline over radius."""


@dataclass(frozen=True)
class CoarseMatch:
    """Disparities of a small picture, in pixels of the large one. All arrays are (h, w).

    ``disparity`` is nan without a match; ``rho`` (px) and ``theta`` (rad) place each pixel about the principal point;
    ``rising`` marks pixels whose disparity grows outwards at a rate that a pipe's wall can have.
    """

    disparity: NDArray[np.float32]
    rho: NDArray[np.float32]
    theta: NDArray[np.float32]
    rising: NDArray[np.bool_]
    step_px: float


def coarse_match(left: NDArray[np.uint8], right: NDArray[np.uint8], rig: StereoRig) -> CoarseMatch:
    """Match a grey pair (H, W) at about ``_WIDTH`` pixels. No range is asked for: everything up to a fifth of the width."""
    factor = max(1, round(left.shape[1] / _WIDTH))
    size = left.shape[1] // factor, left.shape[0] // factor
    step = left.shape[1] / size[0]
    even = cv2.createCLAHE(4.0, (6, 10))  # light falls off steeply along a pipe: every part of it gets its own contrast
    small = [even.apply(cv2.resize(picture, size, interpolation=cv2.INTER_AREA)) for picture in (left, right)]
    search = int(np.ceil(_HIGHEST_SHARE * size[0] / 16)) * 16
    # OpenCV gives nothing within the search range of the left edge: a margin that nothing matches keeps those columns
    small = [
        cv2.copyMakeBorder(picture, 0, 0, search, 0, cv2.BORDER_CONSTANT, value=(grey,))
        for picture, grey in zip(small, (0, 255), strict=True)
    ]
    matcher = cv2.StereoSGBM.create(
        minDisparity=1,
        numDisparities=search,
        blockSize=_BLOCK,
        P1=8 * _BLOCK**2,
        P2=64 * _BLOCK**2,
        disp12MaxDiff=1,
        uniquenessRatio=5,
        speckleWindowSize=60,
        speckleRange=2,
        mode=cv2.StereoSGBM_MODE_SGBM_3WAY,
    )
    found = matcher.compute(small[0], small[1])[:, search:].astype(np.float32) / 16.0
    found[found < 1] = np.nan
    column = (np.arange(size[0], dtype=np.float32) + 0.5) * step - 0.5 - rig.intrinsics.ppx
    row = (np.arange(size[1], dtype=np.float32) + 0.5) * step - 0.5 - rig.intrinsics.ppy
    u, v = np.meshgrid(column, row * (rig.intrinsics.fx / rig.intrinsics.fy))
    rho = np.hypot(u, v)
    slope, sure = _radial_slope(found, u, v, rho)
    steepest, flattest = (rig.baseline_m / radius for radius in _RADII_M)
    rising = sure & np.isfinite(found) & (slope > flattest) & (slope < steepest)
    return CoarseMatch(found * step, rho, np.arctan2(v, u), rising, step)


def _radial_slope(
    disparity: NDArray[np.float32], u: NDArray[np.float32], v: NDArray[np.float32], rho: NDArray[np.float32]
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Growth of the disparity away from the principal point, by a plane through each neighbourhood, and where it is sure."""
    height, width = disparity.shape
    x = np.broadcast_to(np.arange(width, dtype=np.float32) - width / 2, disparity.shape)
    y = np.broadcast_to((np.arange(height, dtype=np.float32) - height / 2)[:, None], disparity.shape)
    known = np.isfinite(disparity).astype(np.float32)
    value = np.where(known > 0, disparity, 0).astype(np.float32)

    def total(values: NDArray[np.float32]) -> NDArray[np.float32]:
        window = (_SLOPE_WINDOW, _SLOPE_WINDOW)
        summed = cv2.boxFilter(values, cv2.CV_32F, window, normalize=False, borderType=cv2.BORDER_CONSTANT)
        return np.asarray(summed, dtype=np.float32)

    count = np.maximum(total(known), 1)
    mean_x, mean_y, mean_d = total(known * x) / count, total(known * y) / count, total(value) / count
    xx = total(known * x * x) / count - mean_x**2
    yy = total(known * y * y) / count - mean_y**2
    xy = total(known * x * y) / count - mean_x * mean_y
    xd = total(value * x) / count - mean_x * mean_d
    yd = total(value * y) / count - mean_y * mean_d
    determinant = xx * yy - xy**2 + 1e-3
    along_x, along_y = (yy * xd - xy * yd) / determinant, (xx * yd - xy * xd) / determinant
    slope = (along_x * u + along_y * v) / np.maximum(rho, 1)
    return slope.astype(np.float32), (count > 0.6 * _SLOPE_WINDOW**2) & (xx > 1) & (yy > 1)
