"""Fixed ways of spoiling a depth frame: crops, holes and blur, to see whether the device knows that its estimate went wrong.

Settled before any estimator was run on them, and seeded by the frame's name, so that they are the same in every run.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Mapping
from types import MappingProxyType

import cv2
import numpy as np
from numpy.typing import NDArray

Depth = NDArray[np.uint16]
Degradation = Callable[[Depth, np.random.Generator], Depth]


def degrade(name: str, depth: Depth, frame_name: str) -> Depth:
    """A spoiled copy of ``depth`` (H, W) by the degradation ``name`` of DEGRADATIONS, seeded by both names."""
    rng = np.random.default_rng(zlib.crc32(f"{name} {frame_name}".encode()))
    return DEGRADATIONS[name](depth, rng)


def _crop(left: float, top: float, right: float, bottom: float) -> Degradation:
    """Only a part of the picture remains, in fractions of width and height: a dirty window, a box that sits too low."""

    def apply(depth: Depth, rng: np.random.Generator) -> Depth:
        height, width = depth.shape
        rows = slice(round(top * height), round(bottom * height))
        columns = slice(round(left * width), round(right * width))
        out = np.zeros_like(depth)
        out[rows, columns] = depth[rows, columns]
        return out

    return apply


def _random_window(share: float) -> Degradation:
    """A window of ``share`` of width and height remains, where chance puts it."""

    def apply(depth: Depth, rng: np.random.Generator) -> Depth:
        left, top = rng.uniform(0, 1 - share, size=2)
        return _crop(left, top, left + share, top + share)(depth, rng)

    return apply


def _holes(share: float, size: float) -> Degradation:
    """Blobs of about ``size`` of the height without depth, covering ``share`` of the picture: no texture, no light, drops."""

    def apply(depth: Depth, rng: np.random.Generator) -> Depth:
        noise = rng.standard_normal(depth.shape).astype(np.float32)
        field = cv2.GaussianBlur(noise, (0, 0), size * depth.shape[0] / 2)
        out = depth.copy()
        out[field < np.quantile(field, share)] = 0
        return out

    return apply


def _blur(sigma: float, along_rows_only: bool = False) -> Degradation:
    """Smear over ``sigma`` of the height: disparity (1/z) is averaged over what was measured, as stereo matching would do.

    Along rows only: the box is swung sideways while the picture is taken.
    """

    def apply(depth: Depth, rng: np.random.Generator) -> Depth:
        pixels = sigma * depth.shape[0]
        measured = (depth > 0).astype(np.float32)
        disparity = np.divide(1.0, depth, where=depth > 0, out=np.zeros(depth.shape, dtype=np.float32)).astype(np.float32)
        # a sigma of almost nothing across the rows leaves them apart
        across = 1e-3 if along_rows_only else pixels
        weight = cv2.GaussianBlur(measured, (0, 0), sigmaX=pixels, sigmaY=across)
        smeared = cv2.GaussianBlur(disparity, (0, 0), sigmaX=pixels, sigmaY=across)
        known = (weight > 0.3) & (smeared > 0)  # holes grow shut at their edges only, as in real frames
        out = np.zeros(depth.shape, dtype=np.float64)
        out[known] = weight[known] / smeared[known]
        return np.clip(np.rint(out), 0, np.iinfo(np.uint16).max).astype(np.uint16)

    return apply


DEGRADATIONS: Mapping[str, Degradation] = MappingProxyType(
    {
        "crop left half": _crop(0.0, 0.0, 0.5, 1.0),
        "crop lower third": _crop(0.0, 0.67, 1.0, 1.0),
        "crop upper right quarter": _crop(0.5, 0.0, 1.0, 0.5),
        "crop window 25 %": _random_window(0.25),
        "crop window 12 %": _random_window(0.12),
        "holes 60 %": _holes(0.60, 0.10),
        "holes 90 %": _holes(0.90, 0.05),
        "holes 98 %": _holes(0.98, 0.03),
        "blur 1 %": _blur(0.01),
        "blur 4 %": _blur(0.04),
        "blur sideways 6 %": _blur(0.06, along_rows_only=True),
    }
)
