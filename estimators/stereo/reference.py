"""The reference mode: semi-global matching with the settings of the RADIUS paper, section 5.2, at full resolution."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

SEARCH_PX = (20, 220)
"""Smallest and largest disparity that the paper looks for."""
_BLOCK, _P1, _P2, _UNIQUENESS = 7, 100, 10_000, 10


def reference_disparity(left: NDArray[np.uint8], right: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Disparity (H, W) in pixels of a rectified pair (H, W, 3), nan without a match (radius paper, section 4.2)."""
    lowest, highest = SEARCH_PX
    matcher = cv2.StereoSGBM.create(
        minDisparity=lowest,
        numDisparities=-(-(highest - lowest) // 16) * 16,  # OpenCV wants a multiple of 16
        blockSize=_BLOCK,
        P1=_P1,
        P2=_P2,
        disp12MaxDiff=0,
        preFilterCap=0,
        uniquenessRatio=_UNIQUENESS,
        speckleWindowSize=0,
        speckleRange=0,
        mode=cv2.StereoSGBM_MODE_HH,
    )
    disparity = matcher.compute(left, right).astype(np.float32) / 16.0
    disparity[(disparity < lowest) | (disparity > highest)] = np.nan
    return disparity
