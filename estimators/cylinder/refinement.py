"""Robust least squares on the distance to the surface: the difference of eq. 6 from r."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from estimators.cylinder.geometry import Cylinder, orthonormal_basis

MIN_RADIUS_M, MAX_RADIUS_M = 0.05, 0.65
"""r_min and r_max of Algorithm 1; the upper one leaves room for the error of a 1100 mm pipe."""
FEWEST_POINTS = 12
"""Points without which five parameters are not worth fitting."""


def refine(
    points: NDArray[np.float64],
    sigma: NDArray[np.float64],
    start: Cylinder,
    candidate: NDArray[np.bool_],
    iterations: int = 8,
) -> Cylinder:
    """Robust least squares (Tukey weights on distance to the surface / sigma) from ``start``; only ``candidate`` points take
    part."""
    axis, point, radius = start.axis, start.point, start.radius
    points, sigma = points[candidate], sigma[candidate]
    if len(points) < FEWEST_POINTS:
        return start
    precision = sigma**-2
    for _ in range(iterations):
        residual, jacobian, basis, point = linearise(points, axis, point, radius)
        weight = tukey(residual / sigma) * precision
        if np.count_nonzero(weight) < FEWEST_POINTS:
            break
        weighted = jacobian * weight[:, None]
        normal_matrix = weighted.T @ jacobian + 1e-3 * np.eye(5)
        step = -np.linalg.solve(normal_matrix, weighted.T @ residual)
        step[:2] = np.clip(step[:2], -0.2, 0.2)
        axis = axis + basis @ step[:2]
        axis /= np.linalg.norm(axis)
        point = point + basis @ step[2:4]
        radius = float(np.clip(radius + step[4], 0.5 * MIN_RADIUS_M, 1.5 * MAX_RADIUS_M))
        if np.abs(step).max() < 1e-6:
            break
    return Cylinder(axis * np.sign(axis[2] + 1e-12), point, radius)


def linearise(
    points: NDArray[np.float64], axis: NDArray[np.float64], point: NDArray[np.float64], radius: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Distance to the surface (N,), its Jacobian (N, 5) by two tilts, two shifts and the radius, their basis (3, 2), and the
    anchor.

    The anchor is ``point`` moved along the axis to the middle of the points, where tilt and shift are least correlated.
    """
    basis = orthonormal_basis(axis)
    along, right, down = np.ascontiguousarray(((points - point) @ np.column_stack([axis, basis])).T)
    middle = float(along.mean())
    rho = np.maximum(np.sqrt(right * right + down * down), 1e-9)
    rows = np.empty((5, len(points)))  # one row a parameter: each is written and read in one go
    rows[2], rows[3], rows[4] = -right / rho, -down / rho, -1.0
    np.multiply(rows[2:4], along - middle, out=rows[:2])
    return rho - radius, rows.T, basis, point + middle * axis


def tukey(scaled: NDArray[np.float64], limit: float = 4.0) -> NDArray[np.float64]:
    """Tukey's biweight of residuals in standard deviations."""
    return np.asarray(np.maximum(1.0 - (scaled / limit) ** 2, 0.0) ** 2)
