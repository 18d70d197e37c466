"""From an OAK's factory calibration, or from what a frame says of itself, to pyrealsense2's intrinsics and extrinsics."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np

from drivers.depth.depthai_rs.names import distortion

log = logging.getLogger(__name__)

FIT_TOLERANCE_PX = 0.5


@dataclass
class intrinsics:
    """As pyrealsense2's: pixels, and five coefficients k1, k2, p1, p2, k3."""

    width: int
    height: int
    fx: float
    fy: float
    ppx: float
    ppy: float
    model: distortion = distortion.none
    coeffs: list[float] = field(default_factory=lambda: [0.0] * 5)


@dataclass
class extrinsics:
    """As pyrealsense2's: ``rotation`` is 3 x 3 column by column, ``translation`` in metres; p_to = R p_from + t."""

    rotation: list[float]
    translation: list[float]


def rectified_intrinsics(matrix: Sequence[Sequence[float]], size: tuple[int, int]) -> intrinsics:
    """Of a picture the device has rectified: StereoDepth's depth and infrared, time of flight. Its distortion is zero."""
    width, height = size
    return intrinsics(width, height, float(matrix[0][0]), float(matrix[1][1]), float(matrix[0][2]), float(matrix[1][2]))


def lens_intrinsics(
    matrix: Sequence[Sequence[float]], size: tuple[int, int], coefficients: Sequence[float], model_name: str
) -> intrinsics:
    """Of a picture as the lens throws it: colour, and infrared that has not been rectified.

    ``coefficients`` are OAK's, in OpenCV's order: up to 14 of the rational model for "Perspective", 4 for "Fisheye".
    pyrealsense2 has five and no rational model, so a rational lens is fitted with a plain one: good enough to look at, and no
    depth is ever measured through it, since both kinds of depth come rectified. Raises RuntimeError for any other model.
    """
    found = rectified_intrinsics(matrix, size)
    if not any(coefficients):
        return found
    if model_name == "Fisheye":
        found.model, found.coeffs = distortion.kannala_brandt4, [*map(float, coefficients[:4]), 0.0]
        return found
    if model_name != "Perspective":
        raise RuntimeError(f"Camera model {model_name} has no counterpart")
    if any(coefficients[5:]):
        fitted, residual_px = plain_coefficients(coefficients, found)
        if residual_px > FIT_TOLERANCE_PX:
            log.warning("five distortion coefficients describe this lens to %.1f pixels only", residual_px)
    else:
        fitted = [float(value) for value in [*coefficients, 0.0, 0.0, 0.0, 0.0, 0.0][:5]]
    found.model, found.coeffs = distortion.brown_conrady, fitted
    return found


def plain_coefficients(rational: Sequence[float], pixels: intrinsics) -> tuple[list[float], float]:
    """k1, k2, p1, p2, k3 of the plain Brown-Conrady lens nearest to a rational one, and the largest residual in pixels.

    Brown-Conrady is linear in its coefficients, so one least-squares solution over a grid of the picture is the best there is.
    """
    u, v = np.meshgrid(np.linspace(0, pixels.width - 1, 48), np.linspace(0, pixels.height - 1, 32))
    bent = np.stack([(u.ravel() - pixels.ppx) / pixels.fx, (v.ravel() - pixels.ppy) / pixels.fy], axis=1)
    coefficients = np.asarray(rational, dtype=np.float64)
    rays = _straightened(bent, coefficients)
    # where OpenCV's iteration has not found the ray of a pixel, the pixel teaches nothing
    projected, _ = cv2.projectPoints(
        np.column_stack([rays, np.ones(len(rays))]), np.zeros(3), np.zeros(3), np.eye(3), coefficients
    )
    sound = np.abs(projected.reshape(-1, 2) - bent).max(axis=1) < 1e-6
    if sound.sum() < 100:
        return [0.0] * 5, float("inf")
    rays, bent = rays[sound], bent[sound]
    x, y = rays[:, 0], rays[:, 1]
    r2 = x * x + y * y
    rows_x = np.stack([x * r2, x * r2**2, 2 * x * y, r2 + 2 * x * x, x * r2**3], axis=1)
    rows_y = np.stack([y * r2, y * r2**2, r2 + 2 * y * y, 2 * x * y, y * r2**3], axis=1)
    design, wanted = np.vstack([rows_x, rows_y]), np.concatenate([bent[:, 0] - x, bent[:, 1] - y])
    solution = np.linalg.lstsq(design, wanted, rcond=None)[0]
    residual = np.abs(design @ solution - wanted).max() * max(pixels.fx, pixels.fy)
    return [float(value) for value in solution], float(residual)


def _straightened(bent: Any, coefficients: Any) -> Any:
    criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-12)
    return cv2.undistortPoints(bent[:, None, :], np.eye(3), coefficients, criteria=criteria).reshape(-1, 2)


def stated_intrinsics(frame: Any, size: tuple[int, int]) -> intrinsics | None:
    """What a dai.ImgFrame says of the pin-hole that made it, or None where it says nothing that could be true.

    Luxonis names the frame's transformation the first source of the intrinsics of what was produced, calibration the second.
    """
    transformation = frame.getTransformation()
    if not transformation.isValid():
        return None
    matrix = transformation.getIntrinsicMatrix()
    stated = rectified_intrinsics(matrix, size)
    numbers = np.array([stated.fx, stated.fy, stated.ppx, stated.ppy])
    # a transformation nobody filled in holds the unit matrix: a focal length of one pixel
    if not np.all(np.isfinite(numbers)) or min(stated.fx, stated.fy) < 10 or tuple(transformation.getSize()) != size:
        return None
    return stated


def between(calibration: Any, source: Any, target: Any, source_rectification: Any | None) -> extrinsics:
    """From the frame of one camera socket to that of another, from the factory calibration (kept there in centimetres).

    ``source_rectification`` (3, 3) is what the device turned the source's picture by, None where it is as the lens throws it.
    """
    matrix = np.asarray(calibration.getCameraExtrinsics(source, target), dtype=np.float64)
    rotation = matrix[:3, :3]
    if source_rectification is not None:
        rotation = rotation @ np.asarray(source_rectification, dtype=np.float64).T
    return extrinsics([float(v) for v in rotation.T.ravel()], [float(v) / 100.0 for v in matrix[:3, 3]])


def beside(calibration: Any, left: Any, right: Any, *, to_left: bool) -> extrinsics:
    """Between the two pictures of a rectified pair: nothing but a step sideways as long as the baseline."""
    step = np.asarray(calibration.getCameraExtrinsics(left, right), dtype=np.float64)[:3, 3] / 100.0
    baseline = float(np.linalg.norm(step))
    return extrinsics([1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0], [baseline if to_left else -baseline, 0.0, 0.0])
