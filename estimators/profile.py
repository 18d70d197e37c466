"""The cross-section around the fitted axis: a periodic Fourier curve, its diameters, ovality, and the chord of water."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimators.cylinder import CylinderFit, orthonormal_basis
from estimators.cylinder.refinement import tukey
from estimators.pointcloud import OrientedPoints

HARMONICS = 4
SAMPLES = 72
_SHRINK = 3e-4
"""Prior standard deviation ratio of the harmonics: keeps the curve from swinging where the wall is not seen."""


@dataclass(frozen=True)
class WaterChord:
    """A flat surface in the pipe, seen along the axis: water, or a platform. ``height`` is its distance below the axis
    (negative above)."""

    angle: float
    height: float
    depth: float
    width: float
    share: float


@dataclass(frozen=True)
class Profile:
    """Measured cross-section, metres and radians; angles are image angles atan2(v, u) around the axis.

    ``radii`` (SAMPLES,) at ``angles``, nan where no wall is seen. ``ovality`` after ASTM F1216: the larger of (maximum -
    mean) and
    (mean - minimum) diameter over the mean, nan below three quarters of coverage, as are the diameters that need both sides.
    """

    angles: NDArray[np.float64]
    radii: NDArray[np.float64]
    coverage: float
    minimum_diameter: float
    maximum_diameter: float
    mean_diameter: float
    ovality: float
    water: WaterChord | None


def cross_section(cloud: OrientedPoints, fit: CylinderFit) -> Profile:
    """Fit the cross-section of the wall around ``fit``'s axis by robust Fourier regression; see ``Profile``."""
    across, inward = _unrolled(cloud, fit)
    rho = np.hypot(across[:, 0], across[:, 1])
    water = _chord(across, inward, rho, fit.radius)
    wall = (rho > 0.6 * fit.radius) & (rho < 1.7 * fit.radius) & (-np.einsum("ij,ij->i", across, inward) > 0.8 * rho)
    if water is not None:
        down = np.array([np.cos(water.angle), np.sin(water.angle)])
        wall &= across @ down < water.height - 0.02 * fit.radius
    angle = np.arctan2(across[wall, 1], across[wall, 0])
    grid = np.linspace(-np.pi, np.pi, SAMPLES, endpoint=False) + np.pi / SAMPLES
    count = np.bincount(
        np.clip(((angle + np.pi) * (SAMPLES / (2 * np.pi))).astype(np.int64), 0, SAMPLES - 1), minlength=SAMPLES
    )
    seen = count >= 3
    coverage = float(seen.mean() * 2 * np.pi)
    curve = _fourier(angle, rho[wall], count, fit.radius, grid)
    radii = np.where(seen, curve, np.nan)
    diameters = curve + np.roll(curve, SAMPLES // 2)
    both = seen & np.roll(seen, SAMPLES // 2)
    nan = float("nan")
    mean = float(np.nanmean(radii) * 2) if seen.any() else nan
    low, high = (float(diameters[both].min()), float(diameters[both].max())) if both.sum() >= SAMPLES // 4 else (nan, nan)
    ovality = max(high - mean, mean - low) / mean if coverage >= 1.5 * np.pi else nan
    return Profile(grid, radii, coverage, low, high, mean, ovality, water)


def _unrolled(cloud: OrientedPoints, fit: CylinderFit) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Positions (N, 2) and normals (N, 2) across the axis, of points whose normal is across the axis too (within 30
    degrees)."""
    basis = orthonormal_basis(fit.axis)
    lengthwise = np.abs(cloud.normals @ fit.axis) < 0.5
    along = (cloud.points - fit.point) @ fit.axis
    chosen = lengthwise & (np.abs(along) < 0.5 * fit.length + 0.5 * fit.radius)
    return (cloud.points[chosen] - fit.point) @ basis, cloud.normals[chosen] @ basis


def _fourier(
    angle: NDArray[np.float64],
    rho: NDArray[np.float64],
    count: NDArray[np.int64],
    radius: float,
    grid: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Robust, lightly regularised Fourier regression of rho over angle, evaluated on ``grid``; every direction has the same
    say."""

    def design(theta: NDArray[np.float64]) -> NDArray[np.float64]:
        waves = [np.ones_like(theta)]
        for k in range(1, HARMONICS + 1):
            waves += [np.cos(k * theta), np.sin(k * theta)]
        return np.stack(waves, axis=1)

    if len(angle) < 20:
        return np.full(len(grid), radius)
    index = np.clip(((angle + np.pi) * (SAMPLES / (2 * np.pi))).astype(np.int64), 0, SAMPLES - 1)
    even = 1.0 / np.maximum(count[index], 5)
    matrix = design(angle)
    penalty = np.diag(_SHRINK * even.sum() * np.r_[0.0, np.repeat(np.arange(1, HARMONICS + 1) ** 2, 2)])
    residual = rho - radius
    for _ in range(4):
        scale = max(1.4826 * float(np.median(np.abs(residual))), 0.005 * radius)
        weighted = matrix * (even * tukey(residual / scale))[:, None]
        solution = np.linalg.solve(weighted.T @ matrix + penalty + 1e-9 * np.eye(matrix.shape[1]), weighted.T @ (rho - radius))
        residual = rho - radius - matrix @ solution
    return radius + design(grid) @ solution


def _chord(
    across: NDArray[np.float64], normals: NDArray[np.float64], rho: NDArray[np.float64], radius: float
) -> WaterChord | None:
    """The flat surface in the pipe, if one is seen: points well inside the wall that share one normal and one height."""
    length = np.linalg.norm(normals, axis=1)
    inside = (rho < 0.97 * radius) & (length > 0.5)
    if np.count_nonzero(inside) < 40:
        return None
    unit = normals[inside] / length[inside, None]
    best: tuple[int, float, float] | None = None
    for angle in np.arange(
        np.pi / 4, 3 * np.pi / 4 + 1e-9, np.pi / 36
    ):  # the box hangs on its rod: down is down in the picture
        down = np.array([np.cos(angle), np.sin(angle)])
        facing = -(unit @ down) > 0.966  # the surface looks back at the axis, within 15 degrees
        if np.count_nonzero(facing) < 40:
            continue
        height = (across[inside] @ down)[facing]
        middle = float(np.median(height))
        level = np.abs(height - middle) < 0.04 * radius
        if np.count_nonzero(level) > (0 if best is None else best[0]):
            best = int(np.count_nonzero(level)), float(angle), float(np.median(height[level]))
    if best is None:
        return None
    count, angle, height = best
    share = count / len(across)
    sideways = across[inside] @ np.array([-np.sin(angle), np.cos(angle)])
    flat = np.abs(across[inside] @ np.array([np.cos(angle), np.sin(angle)]) - height) < 0.04 * radius
    width = 2 * float(np.sqrt(max(radius**2 - height**2, 0.0)))
    spans = np.ptp(np.percentile(sideways[flat], [5, 95])) > 0.4 * width
    if share < 0.03 or not spans or not 0.0 < height < 0.95 * radius:
        return None
    return WaterChord(angle, height, radius - height, width, share)
