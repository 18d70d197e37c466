"""How well a cloud supports a cylinder: the proxies of the paper and what else tells a pipe from what only looks like one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimators.cylinder.geometry import NORMAL_AGREEMENT, Array, Cylinder, inliers, noise_std, radial_agreement, wall_area
from estimators.cylinder.refinement import FEWEST_POINTS, linearise, tukey
from estimators.cylinder.roundness import mean_radius
from estimators.pointcloud import OrientedPoints

_SECTORS = 36


@dataclass(frozen=True)
class CylinderFit:
    """A cylinder and how well the cloud supports it.

    ``radius_std`` (m) comes from the covariance of the fit, with points in one patch of wall taken as one witness.
    ``inlier_share`` and ``mse`` (m^2, the square that eq. 7 is called for) are the paper's proxies, ``orientation`` is eq. 9.
    ``inlier_count`` is the number of points on the wall, ``coverage`` (rad) the angle around the axis in which wall is seen,
    ``length`` (m) the wall seen along the axis, ``area`` see ``wall_area``, ``inside`` the share of points that stand free in
    the pipe between wall and axis. ``taper`` is the change of radius along the axis (m per m; 0 for a pipe, not for a cone),
    ``out_of_round`` the standard deviation of the radius around the axis over the radius (0 for a circle). ``mean_shift`` and
    ``mean_std`` (m) say how far the mean radius of a wall that need not be round is from ``radius``, see ``roundness``.
    """

    axis: NDArray[np.float64]
    point: NDArray[np.float64]
    radius: float
    radius_std: float
    inlier_share: float
    inlier_count: int
    mse: float
    orientation: float
    coverage: float
    length: float
    area: float
    inside: float
    taper: float
    out_of_round: float
    mean_shift: float
    mean_std: float

    @property
    def cylinder(self) -> Cylinder:
        """The bare geometry."""
        return Cylinder(self.axis, self.point, self.radius)


def assess(cloud: OrientedPoints, cylinder: Cylinder) -> CylinderFit | None:
    """Statistics of ``cylinder`` on the whole ``cloud``; None where fewer than a dozen points lie on it."""
    sigma = noise_std(cloud.points, cloud.normals)
    on_wall = inliers(cloud.points, cloud.normals, sigma, cylinder)
    if np.count_nonzero(on_wall) < FEWEST_POINTS:
        return None
    points = cloud.points[on_wall].astype(np.float64)
    residual, jacobian, basis, anchor = linearise(points, cylinder.axis, cylinder.point, cylinder.radius)
    offset = points - anchor
    along = offset @ cylinder.axis
    across = offset @ basis
    angle = np.arctan2(across[:, 1], across[:, 0])
    sector = np.floor(angle * (_SECTORS / (2 * np.pi))).astype(np.int64)
    patch = np.floor(angle * (12 / np.pi)).astype(np.int64) + 1000 * np.floor(along * (2 / cylinder.radius)).astype(np.int64)
    weight = tukey(residual / sigma[on_wall]) / sigma[on_wall] ** 2
    everything = cloud.points - anchor
    depth_in_pipe = everything @ cylinder.axis
    rho = np.linalg.norm(everything - depth_in_pipe[:, None] * cylinder.axis, axis=1)
    facing = radial_agreement(cloud.points, cloud.normals, cylinder) > NORMAL_AGREEMENT
    free = rho < cylinder.radius - np.minimum(3 * sigma, 0.15 * cylinder.radius)
    low, high = np.percentile(along, [2, 98])
    within = (depth_in_pipe > low) & (depth_in_pipe < high)
    like_wall = within & facing & (rho > 0.6 * cylinder.radius) & (rho < 1.7 * cylinder.radius)
    shift, shift_std = mean_radius(cloud.points[facing], sigma[facing], cylinder)
    _, sector_count = np.unique(sector, return_counts=True)
    return CylinderFit(
        axis=cylinder.axis,
        point=anchor + 0.5 * (low + high) * cylinder.axis,
        radius=cylinder.radius,
        radius_std=_clustered_radius_std(residual, jacobian, weight, patch),
        inlier_share=float(on_wall.mean()),
        inlier_count=int(on_wall.sum()),
        mse=float(np.mean(residual**2)),
        orientation=float(cylinder.axis[2]),
        coverage=float(np.count_nonzero(sector_count >= 3) * (2 * np.pi / _SECTORS)),
        length=float(high - low),
        area=wall_area(cloud.points, cloud.normals, sigma, cylinder),
        inside=float(np.mean(free & within)),
        taper=_taper(cloud.points[facing], sigma[facing], cylinder, anchor),
        out_of_round=_out_of_round((everything @ basis)[like_wall], rho[like_wall]) / cylinder.radius,
        mean_shift=shift,
        mean_std=shift_std,
    )


def _out_of_round(across: NDArray[np.float64], rho: NDArray[np.float64]) -> float:
    """Standard deviation (m) of the wall's distance from the axis, around the pipe; 0 with fewer than three directions.

    Directions of 10 degrees speak by their medians, so that noise counts little, each with the weight of its points.
    """
    sector = np.floor(np.arctan2(across[:, 1], across[:, 0]) * (_SECTORS / (2 * np.pi))).astype(np.int64)
    order = np.lexsort((rho, sector))
    _, first, count = np.unique(sector[order], return_index=True, return_counts=True)
    if len(count) < 3:
        return 0.0
    medians = 0.5 * (rho[order[first + (count - 1) // 2]] + rho[order[first + count // 2]])
    return float(np.sqrt(np.average((medians - np.average(medians, weights=count)) ** 2, weights=count)))


def _taper(points: Array, sigma: Array, cylinder: Cylinder, anchor: NDArray[np.float64]) -> float:
    """Change of radius along the axis (m per m) of the ``points`` (N, 3) that face it, by one robust step with a sixth
    parameter and with room for a wall that is not parallel."""
    points64 = points.astype(np.float64)
    residual, jacobian, _, middle = linearise(points64, cylinder.axis, anchor, cylinder.radius)
    jacobian = np.concatenate([jacobian, -((points64 - middle) @ cylinder.axis)[:, None]], axis=1)
    spread = np.maximum(3.0 * sigma, 0.05 * cylinder.radius)
    correction = np.zeros(6)
    for _ in range(3):
        left = residual + jacobian @ correction
        weighted = jacobian * (tukey(left / spread) / spread**2)[:, None]
        correction = -np.linalg.pinv(weighted.T @ jacobian) @ (weighted.T @ residual)
    return float(correction[5])


def _clustered_radius_std(
    residual: NDArray[np.float64], jacobian: NDArray[np.float64], weight: NDArray[np.float64], patch: NDArray[np.int64]
) -> float:
    """Standard deviation of the radius by the cluster-robust sandwich: neighbouring errors of a depth camera are not
    independent."""
    gradient = jacobian * (weight * residual)[:, None]
    _, cluster = np.unique(patch, return_inverse=True)
    count = int(cluster.max()) + 1
    sums = np.stack([np.bincount(cluster, gradient[:, k], count) for k in range(5)], axis=1)
    bread = np.linalg.pinv((jacobian * weight[:, None]).T @ jacobian)
    inflation = count / max(count - 5, 1)
    covariance = bread @ (sums.T @ sums) @ bread * inflation
    return float(np.sqrt(max(covariance[4, 4], 0.0)))
