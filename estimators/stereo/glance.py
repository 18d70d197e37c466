"""A glance at a pair while somebody aims: light, focus, how much matches, and whether the camera stands in the pipe's middle.

A tenth of the cost of following the wall, and rough: it tells what to do, it measures nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from estimators.stereo.coarse import coarse_match
from estimators.stereo.rig import StereoRig

_SECTORS = 36
_LEAST_IN_SECTOR = 12
_NEAR_SHARE = 0.16
"""Disparities beyond this share of the width are at the end of what is looked for."""
_WIDTH = 480
_WHITE = 245


@dataclass(frozen=True)
class Glance:
    """``light`` is the grey value of the picture's bright tenth, ``white`` the share without drawing. ``focus``: how steep the
    steepest edges are against those of the picture seen from four times as far, about 1 in focus. ``texture``: grey values of
    fine structure. ``matched``: share of pixels with a match, ``near`` the share of those at the end of the search.
    ``around``: share of the way around at which something rises like a wall; ``radius`` (m) of that wall and ``aside`` where
    the camera stands in it, right and down in radii; nan where less than half of it is seen.
    """

    light: float
    white: float
    focus: float
    texture: float
    matched: float
    near: float
    around: float
    radius: float
    aside: tuple[float, float]


def glance(left: NDArray[np.uint8], right: NDArray[np.uint8], rig: StereoRig) -> Glance:
    """Look at a rectified grey pair (H, W)."""
    small = cv2.resize(left, (_WIDTH, max(1, round(left.shape[0] * _WIDTH / left.shape[1]))), interpolation=cv2.INTER_AREA)
    fine = np.abs(small.astype(np.float32) - cv2.GaussianBlur(small.astype(np.float32), (0, 0), 2.0))
    coarse = coarse_match(left, right, rig)
    found = np.isfinite(coarse.disparity)
    matched = float(found.mean())
    near = float((coarse.disparity[found] > _NEAR_SHARE * left.shape[1]).mean()) if found.any() else 0.0
    shift = coarse.disparity - np.float32(rig.offset_px or 0.0)
    wall = coarse.rising & (shift > 0.5)
    sector = ((coarse.theta[wall] + np.pi) * (_SECTORS / (2 * np.pi))).astype(int) % _SECTORS
    # along a wall parallel to the axis rho = f r / Z and the shift is f b / Z: their ratio tells r in every direction
    reach = rig.baseline_m * coarse.rho[wall] / shift[wall]
    radii = [
        float(np.median(reach[sector == k])) if int((sector == k).sum()) >= _LEAST_IN_SECTOR else np.nan
        for k in range(_SECTORS)
    ]
    known = np.isfinite(radii)
    radius, aside = _middle(np.asarray(radii)[known], _angles()[known])
    return Glance(
        light=float(np.percentile(small, 90)),
        white=float((small > _WHITE).mean()),
        focus=_focus(left),
        texture=float(np.median(fine)),
        matched=matched,
        near=near,
        around=float(known.mean()),
        radius=radius,
        aside=aside,
    )


def _angles() -> NDArray[np.float64]:
    return np.asarray((np.arange(_SECTORS, dtype=np.float64) + 0.5) * (2 * np.pi / _SECTORS) - np.pi)


def _middle(radii: NDArray[np.float64], angles: NDArray[np.float64]) -> tuple[float, tuple[float, float]]:
    """Radius and place of the camera from the distance to the wall in every direction: r = R - right cos - down sin."""
    if len(radii) < _SECTORS // 2:
        return float("nan"), (float("nan"), float("nan"))
    rows = np.stack([np.ones_like(angles), -np.cos(angles), -np.sin(angles)], axis=1)
    weight = np.ones(len(radii))
    for _ in range(5):
        solution = np.linalg.lstsq(rows * weight[:, None], radii * weight, rcond=None)[0]
        residual = np.abs(radii - rows @ solution)
        weight = 1.0 / np.sqrt(1.0 + (residual / max(1.5 * float(np.median(residual)), 1e-4)) ** 2)
    radius = float(solution[0])
    if radius <= 0:
        return float("nan"), (float("nan"), float("nan"))
    return radius, (float(solution[1]) / radius, float(solution[2]) / radius)


def _focus(picture: NDArray[np.uint8]) -> float:
    far = cv2.resize(picture, (picture.shape[1] // 4, picture.shape[0] // 4), interpolation=cv2.INTER_AREA)
    return _steepest(picture) / max(_steepest(np.asarray(far, dtype=np.uint8)), 1e-3)


def _steepest(picture: NDArray[np.uint8]) -> float:
    even = cv2.GaussianBlur(picture.astype(np.float32), (0, 0), 1.0)
    across, down = (cv2.Sobel(even, cv2.CV_32F, *way, ksize=1, scale=0.5) for way in ((1, 0), (0, 1)))
    return float(np.percentile(np.hypot(across, down), 99.5))
