"""The pipe as a cylinder: Algorithm 1 of the diameter paper, made fast and robust.

Hypotheses come from pairs of oriented points (steps 3 and 4: the axis is orthogonal to both *normals*). What the paper
leaves open is used here: the wall is seen from inside, so the two normals meet at the axis, in front of both points and
equally far from them. That discards most pairs before anything is scored. The rest is scored in one batch by a truncated
loss whose width follows the camera's noise at each point, and the best are refined by robust least squares on the
distance to the *surface* (the difference of eq. 6 from r).
"""

from __future__ import annotations

import numpy as np

from estimators.cylinder.geometry import NORMAL_AGREEMENT, Array, Cylinder, noise_std, radial_agreement, wall_area
from estimators.cylinder.refinement import MAX_RADIUS_M, MIN_RADIUS_M, refine
from estimators.pointcloud import OrientedPoints

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
_REFINE_POINTS = 4000


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
        agree = radial_agreement(points, normals, start) > NORMAL_AGREEMENT - 0.1
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


def hypotheses(points: Array, normals: Array, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """Cylinders from random pairs: axes (H, 3), the axis point nearest to the camera (H, 3), radii (H,)."""
    i, j = rng.integers(0, len(points), (2, _PAIRS))
    across = np.cross(normals[i], normals[j])
    sine = np.linalg.norm(across, axis=1)
    good = np.flatnonzero((sine > 0.2) & (np.abs(across[:, 2]) > MIN_ORIENTATION * sine))
    i, j, across, sine = i[good], j[good], across[good], sine[good]
    p, n, p2, n2 = points[i], normals[i], points[j], normals[j]
    axis = across * (np.sign(across[:, 2]) / sine)[:, None]
    # The normals' closest approach, seen along the axis: p + s n = p2 + t n2 (+ anything along the axis).
    gap = p2 - p
    s = np.einsum("ij,ij->i", np.cross(gap, n2), across) / sine**2
    t = np.einsum("ij,ij->i", np.cross(gap, n), across) / sine**2
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
    fit *= agreement > NORMAL_AGREEMENT
    return np.asarray(fit.sum(axis=0), dtype=np.float32)


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
        agree = radial_agreement(cloud.points, cloud.normals, start) > NORMAL_AGREEMENT - 0.1
        start = refine(cloud.points.astype(np.float64), widening * sigma.astype(np.float64), start, agree, iterations=6)
    return start
