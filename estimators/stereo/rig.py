"""The geometry of a rectified pair: depth from disparity (radius paper, eqs. 4, 8 and 9), and its inverse."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from estimators.pinhole import Intrinsics


@dataclass(frozen=True)
class StereoRig:
    """A rectified pair of cameras. ``intrinsics`` are those of the left (reference) picture, in pixels, without distortion.

    ``offset_px`` is what has to be taken off a disparity before it tells depth: pictures that were shifted sideways, or axes
    that are not quite parallel. None where nobody has measured it: then every pair finds its own, from a wall that must not
    come out conical. ``offset_std_px`` and ``scale_std`` (relative) are how well offset and baseline are known.
    ``known_shift_px``: where both were told by one pipe of known size, the disparity (less the offset) of its wall, at which
    their errors cancel.
    """

    intrinsics: Intrinsics
    baseline_m: float
    offset_px: float | None = 0.0
    offset_std_px: float = 0.0
    scale_std: float = 0.0
    known_shift_px: float | None = None

    def __post_init__(self) -> None:
        if not self.baseline_m > 0:
            raise ValueError(f"the baseline must be positive, got {self.baseline_m} m")
        if self.intrinsics.model != "none" and any(self.intrinsics.coeffs):
            raise ValueError("a rectified pair has no lens distortion left")

    @property
    def focal_px(self) -> float:
        """Focal length along the rows, the direction of the disparity."""
        return self.intrinsics.fx

    @property
    def range_px_m(self) -> float:
        """Focal length times baseline: disparity (px) times depth (m)."""
        return self.intrinsics.fx * self.baseline_m

    def with_offset(self, offset_px: float, std_px: float = 0.0) -> StereoRig:
        """The same rig with another disparity offset."""
        return replace(self, offset_px=offset_px, offset_std_px=std_px, known_shift_px=None)

    def relative_std(self, depth_m: float) -> float:
        """How well any length across the pipe at a depth is known, as a share of it."""
        shift = self.range_px_m / depth_m
        known = 0.0 if self.known_shift_px is None else 1.0 / self.known_shift_px
        return float(np.hypot(self.offset_std_px * abs(1.0 / shift - known), self.scale_std))

    def depth(self, disparity: NDArray[np.float64]) -> NDArray[np.float64]:
        """Depth Z (m) of disparities (px), nan at and behind infinity (radius paper, eq. 4)."""
        shift = disparity - (self.offset_px or 0.0)
        behind = np.full(np.shape(shift), np.nan)
        return np.asarray(np.divide(self.range_px_m, shift, out=behind, where=shift > 0), dtype=np.float64)

    def tangents(self, x: NDArray[np.float64], y: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(X/Z, Y/Z) of pixel positions of the left picture."""
        camera = self.intrinsics
        return (x - camera.ppx) / camera.fx, (y - camera.ppy) / camera.fy
