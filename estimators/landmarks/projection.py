"""The cylinder-to-image projection and its inverse (CCTV paper, eqs. 4, 5, 12, 19 to 21), with a camera off the pipe's axis."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

NEAREST = 0.02
"""A landmark nearer than this ahead of the camera (m) is beside it: it has no picture."""


@dataclass(frozen=True)
class PipeCamera:
    """``fx``, ``fy`` (px), interior ``radius`` of the pipe (m), size of the picture (px). Where only the product f*R is known,
    take radius 1 and f = f*R: chainages stay metric, lengths on the wall come in radii."""

    fx: float
    fy: float
    radius: float
    width: int
    height: int


@dataclass(frozen=True)
class View:
    """Where the camera is in one frame: ``position`` along the pipe (m), ``centre`` (2,) the focus of expansion (px), and
    ``axis`` (2,), the pipe's axis as seen from the camera, to the right and down (m): minus the camera's offset.

    The paper's eq. 5 takes ``axis`` as zero; a ring at depth Z is centred at ``centre + f axis / Z``.
    """

    position: float
    centre: tuple[float, float]
    axis: tuple[float, float] = (0.0, 0.0)


def project(camera: PipeCamera, view: View, states: Array) -> Array:
    """Pixels (n, 2) of landmarks (n, 2) of [chainage (m), image angle (rad)]; nan for those not ahead of the camera (eq. 5)."""
    depth = states[:, 0] - view.position
    depth = np.where(depth > NEAREST, depth, np.nan)
    x = view.axis[0] + camera.radius * np.cos(states[:, 1])
    y = view.axis[1] + camera.radius * np.sin(states[:, 1])
    pixels = np.empty((len(states), 2))
    pixels[:, 0], pixels[:, 1] = view.centre[0] + camera.fx * x / depth, view.centre[1] + camera.fy * y / depth
    return pixels


def jacobian(camera: PipeCamera, view: View, states: Array) -> Array:
    """d pixel / d state (n, 2, 2) of ``project`` (eq. 12)."""
    depth = states[:, 0] - view.position
    depth = np.where(depth > NEAREST, depth, np.nan)
    cos, sin = np.cos(states[:, 1]), np.sin(states[:, 1])
    x, y = view.axis[0] + camera.radius * cos, view.axis[1] + camera.radius * sin
    found = np.empty((len(states), 2, 2))
    found[:, 0, 0], found[:, 1, 0] = -camera.fx * x / depth**2, -camera.fy * y / depth**2
    found[:, 0, 1], found[:, 1, 1] = -camera.fx * camera.radius * sin / depth, camera.fy * camera.radius * cos / depth
    return found


def back_project(camera: PipeCamera, view: View, pixels: Array) -> Array:
    """States (n, 2) of pixels (n, 2) on the wall (eqs. 19 to 21); nan at the focus of expansion itself.

    The ray (a, b) per metre of depth meets the wall where |depth (a, b) - axis| = R; seen from outside the pipe's axis the
    equation is quadratic in depth, with one root ahead for a camera inside the pipe.
    """
    a = (pixels[:, 0] - view.centre[0]) / camera.fx
    b = (pixels[:, 1] - view.centre[1]) / camera.fy
    rho2 = a * a + b * b
    with np.errstate(divide="ignore", invalid="ignore"):
        along = a * view.axis[0] + b * view.axis[1]
        free = camera.radius**2 - view.axis[0] ** 2 - view.axis[1] ** 2
        depth = (along + np.sqrt(along**2 + rho2 * free)) / rho2
        angle = np.arctan2(b * depth - view.axis[1], a * depth - view.axis[0])
    bad = ~(rho2 > 1e-12)
    return np.stack([np.where(bad, np.nan, view.position + depth), np.where(bad, np.nan, angle)], axis=1)


def clock_hour(angle: float) -> float:
    """Clock position of an image angle (rad): 12 at the crown, 3 to the right; in (0, 12]."""
    hour = (3.0 + np.degrees(angle) / 30.0) % 12.0
    return float(hour) if hour > 1e-9 else 12.0
