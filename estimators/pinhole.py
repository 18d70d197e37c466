"""The pin-hole camera: intrinsics, lens distortion, viewing rays (diameter paper, eqs. 1 and 2)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

DISTORTION_MODELS = ("none", "brown_conrady", "modified_brown_conrady", "inverse_brown_conrady")


@dataclass(frozen=True)
class Intrinsics:
    """Pin-hole intrinsics of one image stream, in pixels.

    ``model`` is one of DISTORTION_MODELS; ``coeffs`` are k1, k2, p1, p2, k3 as in OpenCV and librealsense.
    """

    width: int
    height: int
    fx: float
    fy: float
    ppx: float
    ppy: float
    model: str = "none"
    coeffs: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        if self.width < 1 or self.height < 1:
            raise ValueError(f"image size must be positive, got {self.width} x {self.height}")
        if not (self.fx > 0 and self.fy > 0):
            raise ValueError(f"focal lengths must be positive, got fx={self.fx}, fy={self.fy}")
        if self.model not in DISTORTION_MODELS:
            raise ValueError(f"unknown distortion model {self.model!r}, known: {', '.join(DISTORTION_MODELS)}")
        if not np.all(np.isfinite([self.fx, self.fy, self.ppx, self.ppy, *self.coeffs])):
            raise ValueError("intrinsics must be finite numbers")

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) in pixels."""
        return self.width, self.height


@lru_cache(maxsize=16)
def rays(intrinsics: Intrinsics) -> NDArray[np.float32]:
    """Viewing ray of every pixel: (height, width, 2) of (X/Z, Y/Z), distortion removed. Read-only, computed once per
    intrinsics."""
    v, u = np.mgrid[0 : intrinsics.height, 0 : intrinsics.width]
    pixels = np.stack([u.ravel(), v.ravel()], axis=1).astype(np.float64)
    grid = deproject_pixels(pixels, intrinsics).reshape(intrinsics.height, intrinsics.width, 2).astype(np.float32)
    grid.flags.writeable = False
    return grid


def deproject_pixels(pixels: NDArray[np.float64], intrinsics: Intrinsics) -> NDArray[np.float64]:
    """Rays (N, 2) of (X/Z, Y/Z) for pixel coordinates (N, 2) of (u, v).

    Brown-Conrady is inverted by OpenCV's iteration; inverse Brown-Conrady is librealsense's closed form,
    whose coefficients map the distorted point to the undistorted one directly.
    """
    x = (pixels[:, 0] - intrinsics.ppx) / intrinsics.fx
    y = (pixels[:, 1] - intrinsics.ppy) / intrinsics.fy
    if intrinsics.model == "none" or not any(intrinsics.coeffs):
        return np.stack([x, y], axis=1)
    if intrinsics.model == "inverse_brown_conrady":
        return np.stack(_distort(x, y, intrinsics.coeffs), axis=1)
    criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 40, 1e-9)
    points = np.stack([x, y], axis=1)[:, None, :]
    undistorted = cv2.undistortPoints(points, np.eye(3), np.asarray(intrinsics.coeffs), criteria=criteria)
    return np.asarray(undistorted, dtype=np.float64).reshape(-1, 2)


def project_rays(rays_xy: NDArray[np.float64], intrinsics: Intrinsics) -> NDArray[np.float64]:
    """Pixel coordinates (N, 2) of rays (N, 2) of (X/Z, Y/Z): the inverse of ``deproject_pixels``."""
    x, y = rays_xy[:, 0], rays_xy[:, 1]
    if intrinsics.model == "inverse_brown_conrady" and any(intrinsics.coeffs):
        target_x, target_y = x, y
        for _ in range(40):  # fixed point: the closed form runs the other way
            mapped_x, mapped_y = _distort(x, y, intrinsics.coeffs)
            x, y = x + (target_x - mapped_x), y + (target_y - mapped_y)
    elif intrinsics.model != "none":
        x, y = _distort(x, y, intrinsics.coeffs)
    return np.stack([x * intrinsics.fx + intrinsics.ppx, y * intrinsics.fy + intrinsics.ppy], axis=1)


@dataclass(frozen=True)
class LensPair:
    """Two cameras side by side, as their lenses throw the pictures. A point is p_right = ``rotation`` p_left + ``translation``:
    (3, 3) row by row, and metres."""

    left: Intrinsics
    right: Intrinsics
    rotation: tuple[float, ...]
    translation: tuple[float, float, float]

    def __post_init__(self) -> None:
        turned = np.asarray(self.rotation, dtype=np.float64)
        if turned.shape != (9,) or not np.allclose(turned.reshape(3, 3) @ turned.reshape(3, 3).T, np.eye(3), atol=1e-6):
            raise ValueError("the rotation between two cameras must be a rotation of nine numbers")
        x, y, z = self.translation
        if not -x > 2 * max(abs(y), abs(z)):
            raise ValueError("the right camera must stand to the right of the left one, and at its height")
        if self.left.size != self.right.size:
            raise ValueError("both pictures of a pair must be of one size")


@dataclass(frozen=True)
class Rectified:
    """How a LensPair's pictures are turned until the rows of both show the same line of sight. ``intrinsics`` are those of both
    pictures; ``turns`` (3, 3) those of the left and of the right camera; a disparity of zero is infinitely far."""

    intrinsics: Intrinsics
    baseline_m: float
    turns: tuple[NDArray[np.float64], NDArray[np.float64]]


def rectified(pair: LensPair) -> Rectified:
    """Bouguet's rectification as OpenCV has it, cut to what both lenses see."""
    turn_left, turn_right, new_left, new_right = cv2.stereoRectify(
        matrix_of(pair.left),
        np.asarray(pair.left.coeffs),
        matrix_of(pair.right),
        np.asarray(pair.right.coeffs),
        pair.left.size,
        np.asarray(pair.rotation).reshape(3, 3),
        np.asarray(pair.translation)[:, None],
        flags=cv2.CALIB_ZERO_DISPARITY,
        alpha=0,
    )[:4]
    focal = float(new_left[0, 0])
    intrinsics = Intrinsics(*pair.left.size, focal, focal, float(new_left[0, 2]), float(new_left[1, 2]))
    return Rectified(intrinsics, float(-new_right[0, 3] / focal), (np.asarray(turn_left), np.asarray(turn_right)))


def matrix_of(intrinsics: Intrinsics) -> NDArray[np.float64]:
    """The (3, 3) camera matrix."""
    return np.array([[intrinsics.fx, 0.0, intrinsics.ppx], [0.0, intrinsics.fy, intrinsics.ppy], [0.0, 0.0, 1.0]])


def _distort(
    x: NDArray[np.float64], y: NDArray[np.float64], coeffs: tuple[float, ...]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    k1, k2, p1, p2, k3 = (*coeffs, 0.0, 0.0, 0.0, 0.0, 0.0)[:5]
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    return (
        x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
        y * radial + 2 * p2 * x * y + p1 * (r2 + 2 * y * y),
    )
