"""Pictures of two plain cameras, turned until the rows of both show the same line of sight."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.stereo.base import StereoFrame
from estimators.pinhole import Intrinsics, LensPair, matrix_of, rectified

Picture = NDArray[np.uint8]


@dataclass(frozen=True)
class Calibrated:
    """The lenses, and how well they are known: a disparity to ``offset_std_px`` after the rectification, the baseline to
    ``scale_std`` (relative)."""

    lenses: LensPair
    offset_std_px: float
    scale_std: float


class Rectifier:
    """Rectifies the pictures of one calibrated pair. ``intrinsics`` and ``baseline_m`` are those of the rectified pair."""

    def __init__(self, calibrated: Calibrated) -> None:
        self._calibrated = calibrated
        lenses = calibrated.lenses
        found = rectified(lenses)
        self.intrinsics, self.baseline_m = found.intrinsics, found.baseline_m
        self._maps = [
            _maps(lens, turn, found.intrinsics) for lens, turn in zip((lenses.left, lenses.right), found.turns, strict=True)
        ]

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) of the pictures, before and after."""
        return self.intrinsics.size

    def frame(self, left: Picture, right: Picture, monotonic_ns: int, number: int, source: str) -> StereoFrame:
        """The rectified pair of two pictures as the lenses threw them, both of ``size``."""
        turned = [
            np.asarray(cv2.remap(image, *maps, cv2.INTER_LINEAR), dtype=np.uint8)
            for image, maps in zip((left, right), self._maps, strict=True)
        ]
        return StereoFrame(
            left=turned[0],
            right=turned[1],
            intrinsics=self.intrinsics,
            baseline_m=self.baseline_m,
            offset_px=0.0,
            monotonic_ns=monotonic_ns,
            number=number,
            source=source,
            offset_std_px=self._calibrated.offset_std_px,
            scale_std=self._calibrated.scale_std,
        )


def _maps(lens: Intrinsics, turn: NDArray[np.float64], new: Intrinsics) -> tuple[NDArray[np.int16], NDArray[np.uint16]]:
    """For cv2.remap: where each pixel of the rectified picture is taken from."""
    coeffs = np.asarray(lens.coeffs, dtype=np.float64)
    places = cv2.initUndistortRectifyMap(matrix_of(lens), coeffs, turn, matrix_of(new), new.size, cv2.CV_16SC2)
    return np.asarray(places[0], dtype=np.int16), np.asarray(places[1], dtype=np.uint16)
