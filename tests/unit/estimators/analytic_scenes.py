"""Depth pictures with a closed form, made without the virtual sewer: what an estimator must read off them can be derived by
hand."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from estimators.pinhole import Intrinsics, rays

D435 = Intrinsics(848, 480, 421.139, 421.139, 426.176, 237.017)
SMALL = Intrinsics(424, 240, 210.5, 210.5, 213.1, 118.5)
UNIT_M = 0.001


def to_depth(z: NDArray[np.float64], noise: float = 0.0, seed: int = 0) -> NDArray[np.uint16]:
    """Millimetres as a camera sends them; ``noise`` is the standard deviation of 1/Z in 1/m, shared by 4 x 4 pixels."""
    rng = np.random.default_rng(seed)
    rows, cols = z.shape
    coarse = rng.normal(0.0, 1.0, (rows // 4 + 1, cols // 4 + 1))
    fine = np.kron(coarse, np.ones((4, 4)))[:rows, :cols]
    with np.errstate(divide="ignore", invalid="ignore"):
        noisy = 1.0 / (1.0 / z + noise * fine)
    return np.where(np.isfinite(noisy) & (noisy > 0.1) & (noisy < 10), noisy / UNIT_M, 0).round().astype(np.uint16)


def cylinder(
    radius: float,
    intrinsics: Intrinsics = D435,
    offset: tuple[float, float] = (0.0, 0.0),
    tilt: tuple[float, float] = (0.0, 0.0),
    end_wall: float = np.inf,
) -> NDArray[np.float64]:
    """Depth (H, W) of the inside of a cylinder: |P(ray z - c)| = radius solved for z. ``tilt`` is the axis's (x, y) slope,
    ``offset`` its
    place at z = 0; a wall across the view closes it at ``end_wall``."""
    grid = rays(intrinsics).astype(np.float64)
    axis = np.array([tilt[0], tilt[1], 1.0])
    axis /= np.linalg.norm(axis)
    ray = np.concatenate([grid, np.ones((*grid.shape[:2], 1))], axis=2)
    ray_across = ray - (ray @ axis)[..., None] * axis
    centre = np.array([offset[0], offset[1], 0.0])
    centre_across = centre - (centre @ axis) * axis
    a = (ray_across**2).sum(axis=2)
    b = ray_across @ centre_across
    c = centre_across @ centre_across - radius**2
    with np.errstate(divide="ignore", invalid="ignore"):
        z = (b + np.sqrt(b * b - a * c)) / a
    return np.minimum(np.where(np.isfinite(z), z, np.inf), end_wall)


def plane(normal: tuple[float, float, float], distance: float, intrinsics: Intrinsics = D435) -> NDArray[np.float64]:
    """Depth (H, W) of the plane n . P = distance; infinite where it is behind."""
    grid = rays(intrinsics).astype(np.float64)
    n = np.array(normal) / np.linalg.norm(normal)
    slope = grid[..., 0] * n[0] + grid[..., 1] * n[1] + n[2]
    with np.errstate(divide="ignore"):
        z = distance / slope
    return np.where(z > 0, z, np.inf)


def cone(radius: float, taper: float, intrinsics: Intrinsics = D435) -> NDArray[np.float64]:
    """Depth (H, W) inside a cone about the z axis whose radius is ``radius`` at z = 0 and shrinks by ``taper`` a metre."""
    grid = rays(intrinsics).astype(np.float64)
    return radius / (np.hypot(grid[..., 0], grid[..., 1]) + taper)


def ellipse(a: float, b: float, end_wall: float = 1.6) -> NDArray[np.float64]:
    """Depth (H, W) inside a straight pipe about the z axis with half axes ``a`` (across) and ``b`` (upright)."""
    grid = rays(D435).astype(np.float64)
    with np.errstate(divide="ignore"):
        return np.minimum(1 / np.hypot(grid[..., 0] / a, grid[..., 1] / b), end_wall)
