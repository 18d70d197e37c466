"""A cylinder, what lies on it, and how much of its wall is seen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimators.pointcloud import OrientedPoints

DISPARITY_STD = 0.012
"""Noise of inverse depth in 1/m, on the walls of the shared recordings: about a quarter of a pixel of disparity at 848 x
480."""
WALL_FLOOR_M = 0.0015
"""Roughness of a sound wall and what the lens model leaves over."""
NORMAL_AGREEMENT = 0.8
Array = NDArray[np.float32]


@dataclass(frozen=True)
class Cylinder:
    """Unit ``axis`` (3,) pointing away from the camera, ``point`` (3,) of the axis, ``radius``;
    metres."""

    axis: NDArray[np.float64]
    point: NDArray[np.float64]
    radius: float


def orthonormal_basis(axis: NDArray[np.float64]) -> NDArray[np.float64]:
    """Two unit vectors (3, 2) orthogonal to ``axis``: to the right and downwards in the picture, as far as that is possible."""
    x, y, z = (float(value) for value in axis)
    across = max(float(np.hypot(y, z)), 1e-12)
    right = (across, -x * y / across, -x * z / across)  # x with its share along the axis taken out
    down = (0.0, z / across, -y / across)  # axis x right
    return np.array([right, down]).T


def noise_std(points: Array, normals: Array) -> Array:
    """Standard deviation (N,) of the distance to the surface: q = 1/Z is off by DISPARITY_STD, the wall by WALL_FLOOR_M."""
    ray_slope = np.abs(np.einsum("ij,ij->i", points, normals)) / points[:, 2]
    return np.asarray(np.hypot(WALL_FLOOR_M, ray_slope * points[:, 2] ** 2 * DISPARITY_STD), dtype=np.float32)


def radial_agreement(points: Array, normals: Array, cylinder: Cylinder) -> Array:
    """Cosine (N,) between each normal and the direction to the axis: 1 on the wall of a pipe seen from inside."""
    rho, inward = _radially(points, normals, cylinder)
    return np.asarray(inward / np.maximum(rho, 1e-9), dtype=np.float32)


def inliers(points: Array, normals: Array, sigma: Array, cylinder: Cylinder) -> NDArray[np.bool_]:
    """Points (N,) on the wall: within 3 sigma of the surface and with a normal to the axis."""
    rho, inward = _radially(points, normals, cylinder)
    width = np.minimum(3.0 * sigma, 0.15 * cylinder.radius)
    return np.asarray((np.abs(rho - cylinder.radius) < width) & (inward > NORMAL_AGREEMENT * rho))


def _radially(points: Array, normals: Array, cylinder: Cylinder) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Distance from the axis (N,), and that times the cosine between each normal and the direction to the axis (N,)."""
    offset = points - cylinder.point
    along = offset @ cylinder.axis
    rho = np.sqrt(np.maximum(np.einsum("ij,ij->i", offset, offset) - along * along, 0.0))
    return rho, along * (normals @ cylinder.axis) - np.einsum("ij,ij->i", normals, offset)


def wall_points(cloud: OrientedPoints, cylinder: Cylinder) -> NDArray[np.bool_]:
    """``inliers`` of a whole cloud."""
    return inliers(cloud.points, cloud.normals, noise_std(cloud.points, cloud.normals), cylinder)


def wall_area(points: Array, normals: Array, sigma: Array, cylinder: Cylinder) -> float:
    """Area of wall seen, in squares of the radius: patches of 15 degrees by r/4 that hold inliers, a patch counting more up
    to four.

    Unlike a count of inliers it does not let a dense blob (end wall, deposit, speckle) outvote a wall that is seen thinly.
    """
    on_wall = inliers(points, normals, sigma, cylinder)
    offset = points[on_wall] - cylinder.point
    across = offset @ orthonormal_basis(cylinder.axis)
    sector = np.floor(np.arctan2(across[:, 1], across[:, 0]) * (12 / np.pi)).astype(np.int64)
    ring = np.floor((offset @ cylinder.axis) * (4 / cylinder.radius)).astype(np.int64)
    _, count = np.unique(sector + 1000 * ring, return_counts=True)
    return float(np.minimum(count, 4).sum() / 4 * (np.pi / 12) * 0.25)
