"""The pipe as a cylinder: Algorithm 1 of the diameter paper, made fast and robust.

Hypotheses come from pairs of oriented points (steps 3 and 4: the axis is orthogonal to both *normals*). What the paper
leaves open is used here: the wall is seen from inside, so the two normals meet at the axis, in front of both points and
equally far from them. That discards most pairs before anything is scored. The rest is scored in one batch by a truncated
loss whose width follows the camera's noise at each point, and the best are refined by robust least squares on the
distance to the *surface* (the difference of eq. 6 from r).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimators.pointcloud import OrientedPoints

MIN_RADIUS_M, MAX_RADIUS_M = 0.05, 0.65
"""r_min and r_max of Algorithm 1; the upper one leaves room for the error of a 1100 mm pipe."""
MIN_ORIENTATION = 0.75
"""Smallest eq. 9 of a pipe that is looked into: 41 degrees off. It keeps the chamber, a standing cylinder, from passing for
the pipe."""
_MAX_FRONTAL = 0.7
"""Largest |n_z| of a wall point: sin(41 degrees) and some noise. End walls, bends and covers face the camera and are left
out."""
_PAIRS = 16000
_HYPOTHESES = 500
_POOL = 900
_FINALISTS = 12
_FEWEST = 12
"""Points without which five parameters are not worth fitting."""
_REFINE_POINTS = 4000
_NORMAL_AGREEMENT = 0.8
DISPARITY_STD = 0.012
"""Noise of inverse depth in 1/m, on the walls of the shared recordings: about a quarter of a pixel of disparity at 848 x
480."""
WALL_FLOOR_M = 0.0015
"""Roughness of a sound wall and what the lens model leaves over."""
Array = NDArray[np.float32]


@dataclass(frozen=True)
class Cylinder:
    """Unit ``axis`` (3,) pointing away from the camera, ``point`` (3,) of the axis next to the seen wall, ``radius``;
    metres."""

    axis: NDArray[np.float64]
    point: NDArray[np.float64]
    radius: float


def noise_std(points: Array, normals: Array) -> Array:
    """Standard deviation (N,) of the distance to the surface: q = 1/Z is off by DISPARITY_STD, the wall by WALL_FLOOR_M."""
    ray_slope = np.abs(np.einsum("ij,ij->i", points, normals)) / points[:, 2]
    return np.asarray(np.hypot(WALL_FLOOR_M, ray_slope * points[:, 2] ** 2 * DISPARITY_STD), dtype=np.float32)


def hypotheses(points: Array, normals: Array, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """Cylinders from random pairs: axes (H, 3), the axis point nearest to the camera (H, 3), radii (H,)."""
    i, j = rng.integers(0, len(points), (2, _PAIRS))
    p, n, p2, n2 = points[i], normals[i], points[j], normals[j]
    axis = np.cross(n, n2)
    sine = np.linalg.norm(axis, axis=1)
    good = sine > 0.2
    p, n, p2, n2, axis, sine = (array[good] for array in (p, n, p2, n2, axis, sine))
    axis /= sine[:, None]
    axis *= np.sign(axis[:, 2:] + 1e-12)
    good = axis[:, 2] > MIN_ORIENTATION
    p, n, p2, n2, axis, sine = (array[good] for array in (p, n, p2, n2, axis, sine))
    # The normals' closest approach, seen along the axis: p + s n = p2 + t n2 (+ anything along the axis).
    gap = p2 - p
    s = np.einsum("ij,ij->i", np.cross(gap, n2), np.cross(n, n2)) / sine**2
    t = np.einsum("ij,ij->i", np.cross(gap, n), np.cross(n, n2)) / sine**2
    radius = 0.5 * (s + t)
    good = (s > 0) & (t > 0) & (np.abs(s - t) < 0.3 * radius) & (radius > MIN_RADIUS_M) & (radius < MAX_RADIUS_M)
    p, n, p2, n2, axis, radius = (array[good][:_HYPOTHESES] for array in (p, n, p2, n2, axis, radius))
    centre = 0.5 * (p + n * radius[:, None] + p2 + n2 * radius[:, None])
    centre -= np.einsum("ij,ij->i", centre, axis)[:, None] * axis
    return axis, centre, radius


def score(points: Array, normals: Array, sigma: Array, axes: Array, centres: Array, radii: Array) -> Array:
    """Truncated-loss score (H,) of cylinders: each point counts up to 1, less with distance and with a normal off the radial.

    ``centres`` must be the axis points nearest to the camera (orthogonal to ``axes``).
    """
    along = points @ axes.T
    rho2 = np.einsum("ij,ij->i", points, points)[:, None] - along * along - 2 * (points @ centres.T)
    rho2 += np.einsum("ij,ij->i", centres, centres)[None, :]
    rho = np.sqrt(np.maximum(rho2, 1e-8))
    inward = (normals @ centres.T) + along * (normals @ axes.T) - np.einsum("ij,ij->i", points, normals)[:, None]
    agreement = inward / rho
    width = np.minimum(3.0 * sigma[:, None], 0.15 * radii[None, :])
    fit = 1.0 - ((rho - radii[None, :]) / width) ** 2
    np.maximum(fit, 0.0, out=fit)
    fit *= agreement > _NORMAL_AGREEMENT
    return np.asarray(fit.sum(axis=0), dtype=np.float32)


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
    if len(points) < _FEWEST:
        return start
    for _ in range(iterations):
        residual, jacobian, basis, point = linearise(points, axis, point, radius)
        weight = tukey(residual / sigma) / sigma**2
        if np.count_nonzero(weight) < _FEWEST:
            break
        weighted = jacobian * weight[:, None]
        normal_matrix = weighted.T @ jacobian + np.diag([1e-3, 1e-3, 1e-3, 1e-3, 1e-3])
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
    offset = points - point
    along = offset @ axis
    middle = float(along.mean())
    anchor = point + middle * axis
    along = along - middle
    radial = offset @ basis
    rho = np.maximum(np.hypot(radial[:, 0], radial[:, 1]), 1e-9)
    unit = radial / rho[:, None]
    jacobian = np.concatenate([-unit * along[:, None], -unit, -np.ones((len(points), 1))], axis=1)
    return rho - radius, jacobian, basis, anchor


def orthonormal_basis(axis: NDArray[np.float64]) -> NDArray[np.float64]:
    """Two unit vectors (3, 2) orthogonal to ``axis``: to the right and downwards in the picture, as far as that is possible."""
    x, y, z = (float(value) for value in axis)
    across = max(float(np.hypot(y, z)), 1e-12)
    right = (across, -x * y / across, -x * z / across)  # x with its share along the axis taken out
    down = (0.0, z / across, -y / across)  # axis x right
    return np.array([right, down]).T


def tukey(scaled: NDArray[np.float64], limit: float = 4.0) -> NDArray[np.float64]:
    """Tukey's biweight of residuals in standard deviations."""
    return np.asarray(np.maximum(1.0 - (scaled / limit) ** 2, 0.0) ** 2)


def radial_agreement(points: Array, normals: Array, cylinder: Cylinder) -> Array:
    """Cosine (N,) between each normal and the direction to the axis: 1 on the wall of a pipe seen from inside."""
    offset = points - cylinder.point
    radial = offset - (offset @ cylinder.axis)[:, None] * cylinder.axis
    rho = np.maximum(np.linalg.norm(radial, axis=1), 1e-9)
    return np.asarray(-np.einsum("ij,ij->i", normals, radial) / rho, dtype=np.float32)


def search(cloud: OrientedPoints, rng: np.random.Generator, known: Cylinder | None = None) -> Cylinder | None:
    """The cylinder that most of the wall agrees on, or None where no two points could be the wall of a pipe.

    ``known`` competes with the hypotheses: what is best is then found again where it still is, so that only the data differ
    between searches.
    """
    cloud = cloud.take(np.abs(cloud.normals[:, 2]) < _MAX_FRONTAL)
    if len(cloud) < 30:
        return None
    pool = rng.permutation(len(cloud))[:_POOL]
    points, normals = cloud.points[pool], cloud.normals[pool]
    axes, centres, radii = hypotheses(points, normals, rng)
    if len(radii) == 0:
        return None
    sigma = noise_std(points, normals)
    scores = score(points, normals, sigma, axes, centres, radii)
    points64, sigma64 = points.astype(np.float64), sigma.astype(np.float64)
    refined = []
    for k in np.argsort(scores)[::-1][:_FINALISTS]:
        start = Cylinder(axes[k].astype(np.float64), centres[k].astype(np.float64), float(radii[k]))
        agree = radial_agreement(points, normals, start) > _NORMAL_AGREEMENT - 0.1
        finalist = refine(points64, sigma64 * 1.5, start, agree, iterations=5)
        if finalist.axis[2] > MIN_ORIENTATION and MIN_RADIUS_M < finalist.radius < MAX_RADIUS_M:
            refined.append(finalist)
    if not refined:
        return None
    refined.sort(key=lambda cylinder: -wall_area(points, normals, sigma, cylinder))
    thinned = cloud if len(cloud) <= _REFINE_POINTS else cloud.take(rng.permutation(len(cloud))[:_REFINE_POINTS])
    sigma = noise_std(thinned.points, thinned.normals)
    starts = _distinct(refined)[:3] + ([] if known is None else [known])
    finals = [_polish(thinned, sigma, start) for start in starts]
    return max(finals, key=lambda cylinder: wall_area(thinned.points, thinned.normals, sigma, cylinder))


def _distinct(cylinders: list[Cylinder]) -> list[Cylinder]:
    """The cylinders without those that refining would make the same as one before: 3 % in radius, 3 degrees in direction."""
    kept: list[Cylinder] = []
    for one in cylinders:
        if all(abs(one.radius / other.radius - 1) > 0.03 or one.axis @ other.axis < 0.9986 for other in kept):
            kept.append(one)
    return kept


def _polish(cloud: OrientedPoints, sigma: Array, start: Cylinder) -> Cylinder:
    """Refine with a wide loss first and the camera's own noise last, so that the way in does not depend on the start."""
    for widening in (2.0, 1.0):
        agree = radial_agreement(cloud.points, cloud.normals, start) > _NORMAL_AGREEMENT - 0.1
        start = refine(cloud.points.astype(np.float64), widening * sigma.astype(np.float64), start, agree, iterations=6)
    return start


def inliers(points: Array, normals: Array, sigma: Array, cylinder: Cylinder) -> NDArray[np.bool_]:
    """Points (N,) on the wall: within 3 sigma of the surface and with a normal to the axis."""
    offset = points - cylinder.point
    radial = offset - (offset @ cylinder.axis)[:, None] * cylinder.axis
    rho = np.linalg.norm(radial, axis=1)
    width = np.minimum(3.0 * sigma, 0.15 * cylinder.radius)
    agree = -np.einsum("ij,ij->i", normals, radial) > _NORMAL_AGREEMENT * rho
    return np.asarray((np.abs(rho - cylinder.radius) < width) & agree)


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


@dataclass(frozen=True)
class CylinderFit:
    """A cylinder and how well the cloud supports it.

    ``radius_std`` (m) comes from the covariance of the fit, with points that lie in one patch of wall taken as one witness.
    ``inlier_share`` and ``mse`` (m^2, the square that eq. 7 is called for) are the paper's proxies, ``orientation`` is eq. 9,
    ``coverage``
    (rad) the angle around the axis where wall is seen, ``length`` (m) the wall seen along the axis, ``area`` see ``wall_area``,
    ``inside`` the share of points that stand free in the pipe between the wall and the axis, ``taper`` the
    change of radius along the axis (m per m; 0 for a pipe, not for a cone), ``roundness`` the share on the cylinder of all
    that faces its axis, ``inlier_count`` the points on
    the wall.
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
    roundness: float

    @property
    def cylinder(self) -> Cylinder:
        """The bare geometry."""
        return Cylinder(self.axis, self.point, self.radius)


_SECTORS = 36


def assess(cloud: OrientedPoints, cylinder: Cylinder) -> CylinderFit | None:
    """Statistics of ``cylinder`` on the whole ``cloud``; None where fewer than a dozen points lie on it."""
    sigma = noise_std(cloud.points, cloud.normals)
    on_wall = inliers(cloud.points, cloud.normals, sigma, cylinder)
    if np.count_nonzero(on_wall) < _FEWEST:
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
    free = rho < cylinder.radius - np.minimum(3 * sigma, 0.15 * cylinder.radius)
    low, high = np.percentile(along, [2, 98])
    within = (depth_in_pipe > low) & (depth_in_pipe < high)
    facing = radial_agreement(cloud.points, cloud.normals, cylinder) > _NORMAL_AGREEMENT
    like_wall = within & facing & (rho > 0.6 * cylinder.radius) & (rho < 1.7 * cylinder.radius)
    _, sector_count = np.unique(sector, return_counts=True)
    return CylinderFit(
        axis=cylinder.axis,
        point=anchor,
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
        taper=_taper(cloud, cylinder, anchor, sigma),
        roundness=float(on_wall[like_wall].mean()) if like_wall.any() else 0.0,
    )


def _taper(cloud: OrientedPoints, cylinder: Cylinder, anchor: NDArray[np.float64], sigma: Array) -> float:
    """Change of radius along the axis (m per m), by one robust step with a sixth parameter and with room for a wall that is
    not parallel."""
    near = radial_agreement(cloud.points, cloud.normals, cylinder) > _NORMAL_AGREEMENT
    points = cloud.points[near].astype(np.float64)
    residual, jacobian, _, middle = linearise(points, cylinder.axis, anchor, cylinder.radius)
    jacobian = np.concatenate([jacobian, -((points - middle) @ cylinder.axis)[:, None]], axis=1)
    spread = np.maximum(3.0 * sigma[near], 0.05 * cylinder.radius)
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
