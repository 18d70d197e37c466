"""Fitting eq. 17 of the RADIUS paper to points that may lie on a wall: a search by samples, then a robust refinement.

The search counts angles and radii from the camera's axis, as the paper does, the refinement from the pipe's own, which it
finds. The noise of stereo is even in the disparity, not in the radius: residuals are therefore counted in pixels of disparity,
between where a pixel's ray meets the wall and what was measured there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimators.radial_profile.model import (
    CAMERA_AXIS,
    Array,
    Axis,
    design,
    design_towards,
    harmonics_of,
    parameters,
    profile_at,
    profile_rows,
    recentred,
)
from estimators.stereo.rig import StereoRig

MAX_HARMONICS = 8
"""The paper takes six about the camera's axis. The standard egg about its own differs by 2.6 mm in 400 from six harmonics, by
1.4 from eight."""
UNEVEN = 0.004
"""Share of the radius by which sound walls differ from any such profile: less than that is neither trusted nor held against
them."""
_SEARCH_HARMONICS = 2
_SPARE = 6
_BATCH = 100
_MAX_BATCHES = 6
_SEARCH_POINTS = 2000
_SEARCH_PX = 4.0
"""Residual of disparity at which a point no longer speaks for a sample, at 1920 pixels of width."""
_TUKEY = 4.7
_ROUNDS, _NEAR_ROUNDS, _WIDE = 8, 2, 4.0
_FREE_ROUNDS = 3
_TABLE = 1440
_SHAPE, _TWIST = 0.3, 0.003
"""What is known of pipes before one is seen (standard deviations, as shares of the radius): harmonic k of a profile is within
the first over k squared; and a profile stays what it is along the pipe, but for its size: within the second for each metre.
It matters where a part of the way around is not seen."""
_NEAREST_M, _FARTHEST_M = 0.02, 30.0


@dataclass(frozen=True)
class Wall:
    """A fitted wall. ``coefficients`` (2 + 4 K,) of eq. 17 in metres about ``axis``, for depths by ``rig``.

    ``covariance`` of the coefficients; ``noise_px`` the robust spread of the disparities about it; ``share`` of the points that
    follow it; ``depths`` (nearest, farthest) in metres of those that do.
    """

    coefficients: Array
    covariance: Array
    rig: StereoRig
    noise_px: float
    share: float
    depths: tuple[float, float]
    axis: Axis = CAMERA_AXIS

    @property
    def harmonics(self) -> int:
        """K."""
        return harmonics_of(self.coefficients)

    def profile(self, theta: NDArray[np.floating]) -> tuple[Array, Array]:
        """(constant, slope) of the radius over depth at angles of any shape, from a table of a quarter of a degree."""
        turns = np.mod(np.asarray(theta, dtype=np.float64) / (2 * np.pi), 1.0) * _TABLE
        low = turns.astype(np.int64)
        part = turns - low
        table: Array = np.arange(_TABLE + 1, dtype=np.float64) * (2 * np.pi / _TABLE)
        constant, slope = profile_at(self.coefficients, table)
        low = np.minimum(low, _TABLE - 1)
        return (
            constant[low] + part * (constant[low + 1] - constant[low]),
            slope[low] + part * (slope[low + 1] - slope[low]),
        )

    def radius(self, theta: NDArray[np.floating], z: NDArray[np.floating]) -> Array:
        """Radius (m) that the wall has at angles and depths about its axis."""
        constant, slope = self.profile(theta)
        return constant + slope * z

    def radius_std(self, theta: Array, z: Array) -> Array:
        """(Z, A): how well that radius (m) is known at depths (Z,) and angles (A,), by the covariance: badly where no wall
        was seen."""
        still, sloping = profile_rows(theta, self.harmonics)
        q, r, s = (
            np.einsum("ai,ij,aj->a", one, self.covariance, other)
            for one, other in ((still, still), (still, sloping), (sloping, sloping))
        )
        z = z[:, None]
        return np.asarray(np.sqrt(np.maximum(q + 2 * z * r + z * z * s, 0.0)), dtype=np.float64)

    def about(self, u: NDArray[np.floating], v: NDArray[np.floating], z: NDArray[np.floating]) -> tuple[Array, Array]:
        """(theta, radius) about the axis of points at depths ``z`` (m) on the rays (u, v) = (X/Z, Y/Z)."""
        x = (u - self.axis.right) * z - self.axis.x
        y = (v - self.axis.down) * z - self.axis.y
        return np.arctan2(y, x), np.hypot(x, y)

    def meet(self, u: NDArray[np.floating], v: NDArray[np.floating], z: NDArray[np.floating], steps: int = 3) -> Array:
        """Depths (m) at which the rays (u, v) = (X/Z, Y/Z) meet the wall, by Newton's method from the depths ``z``."""
        depth = np.asarray(z, dtype=np.float64)
        for _ in range(steps):
            theta, radius = self.about(u, v, depth)
            constant, slope = self.profile(theta)
            opening = _opening(self.axis, np.cos(theta), np.sin(theta), radius, slope, depth)
            depth = _nearer(depth, radius - constant - slope * depth, opening)
        return depth

    def first_guess(self, u: NDArray[np.floating], v: NDArray[np.floating]) -> Array:
        """Depths to begin from: where the rays would meet the wall if the camera stood on its axis."""
        away_u, away_v = u - self.axis.right, v - self.axis.down
        constant, slope = self.profile(np.arctan2(away_v, away_u))
        return np.asarray(np.clip(constant / np.maximum(np.hypot(away_u, away_v) - slope, 1e-3), _NEAREST_M, _FARTHEST_M))


@dataclass(frozen=True)
class WallPoints:
    """Points that may lie on a wall: angle (rad), distance from the principal point (px), disparity (px) and its noise (px)."""

    theta: Array
    rho_px: Array
    disparity: Array
    noise_px: Array

    def some(self, chosen: NDArray[np.intp] | NDArray[np.bool_]) -> WallPoints:
        """A part of them."""
        return WallPoints(self.theta[chosen], self.rho_px[chosen], self.disparity[chosen], self.noise_px[chosen])


def search_wall(points: WallPoints, rig: StereoRig, rng: np.random.Generator) -> tuple[Array, float] | None:
    """The wall that most points agree on, as (coefficients with two harmonics, share); None where there are too few points.

    Samples take one point from each of equal angular shares, so that every sample sees all around. A sample's cost is the
    truncated squared residual. Sampling ends when two batches in a row bring nothing better.
    """
    wanted = parameters(_SEARCH_HARMONICS) + _SPARE
    if len(points.theta) < 10 * wanted:
        return None
    chosen = rng.choice(len(points.theta), min(_SEARCH_POINTS, len(points.theta)), replace=False)
    some = points.some(chosen)
    z = rig.depth(some.disparity)
    usable = np.isfinite(z)
    some, z = some.some(usable), z[usable]
    if len(z) < 10 * wanted:
        return None
    r = some.rho_px * z / rig.focal_px
    shift = some.disparity - (rig.offset_px or 0.0)
    rows = design(some.theta, z, _SEARCH_HARMONICS)
    constant_rows = rows.copy()
    constant_rows[:, 1] = 0.0
    for k in range(1, _SEARCH_HARMONICS + 1):
        constant_rows[:, 4 * k : 4 * k + 2] = 0.0
    tolerance = _SEARCH_PX * rig.intrinsics.width / 1920
    strata = np.array_split(np.argsort(some.theta), wanted)
    best: tuple[float, Array] | None = None
    barren = 0
    for _ in range(_MAX_BATCHES):
        sample = np.stack([rng.choice(stratum, _BATCH) for stratum in strata], axis=1)
        weight = shift[sample][..., None]
        left = rows[sample] * weight
        normal = np.einsum("hij,hik->hjk", left, left)
        normal += 1e-9 * np.trace(normal, axis1=1, axis2=2)[:, None, None] * np.eye(normal.shape[1])
        right = np.einsum("hij,hi->hj", left, r[sample] * weight[..., 0])
        tried = np.linalg.solve(normal, right[..., None])[..., 0]
        constant = tried @ constant_rows.T
        with np.errstate(divide="ignore", invalid="ignore"):
            residual = (tried @ rows.T - r) * shift / np.where(constant > 0.02, constant, np.nan)
        cost = np.fmin(np.nan_to_num((residual / tolerance) ** 2, nan=1.0), 1.0).mean(axis=1)
        winner = int(np.argmin(cost))
        barren = 0 if best is None or cost[winner] < 0.97 * best[0] else barren + 1
        if best is None or cost[winner] < best[0]:
            best = float(cost[winner]), tried[winner]
        if barren == 2:
            break
    return None if best is None else (best[1], 1.0 - best[0])


def refine_wall(
    points: WallPoints,
    start: Array,
    rig: StereoRig,
    harmonics: tuple[int, ...],
    noise_px: float,
    independent: float,
    least_noise_px: float = 0.05,
    axis: Axis | None = None,
    near: bool = False,
) -> Wall:
    """Robust refit from ``start`` (about ``axis``, or the camera's) by iterated reweighting (Tukey), with as many harmonics as
    the data pays for.

    ``harmonics`` are tried in turn, each from ``start`` or from the one before, whichever has more; the one with the smallest
    Bayesian information criterion for ``independent`` points wins (neighbouring pixels share their noise, so there are fewer
    than points). ``near``: the start is this wall already but for its last digits, so nothing is searched from wide weights.
    Raises ``numpy.linalg.LinAlgError`` where nothing can be solved.
    """
    z = rig.depth(points.disparity)
    usable = np.isfinite(z)
    points, z = points.some(usable), z[usable]
    rays = _Rays(points, z, rig)
    began = recentred(start, axis or CAMERA_AXIS)
    before, scale = began, noise_px
    best: tuple[float, Wall] | None = None
    for count in harmonics:
        coefficients, about = before if harmonics_of(before[0]) > harmonics_of(start) else began
        kept = np.zeros(parameters(count))
        kept[: min(len(coefficients), len(kept))] = coefficients[: len(kept)]
        fit = _reweighted(rays, kept, about, scale, least_noise_px, max(len(z) / independent, 1.0), near)
        inside = np.abs(fit.residual) < _TUKEY * rays.spread(scale)
        if np.count_nonzero(inside) < 3 * parameters(count):
            raise np.linalg.LinAlgError("no wall is left")
        scale = max(1.4826 * float(np.median(np.abs(fit.residual[inside]))), least_noise_px)
        truncated = float(np.mean(np.minimum((fit.residual / rays.spread(noise_px)) ** 2, _TUKEY**2)))
        information = independent * np.log(truncated + 1e-12) + parameters(count) * np.log(max(independent, 2.0))
        nearest, farthest = np.percentile(z[inside], [1, 99])
        wall = Wall(
            fit.coefficients,
            np.asarray(np.linalg.inv(fit.normal) * max(len(z) / independent, 1.0), dtype=np.float64),
            rig,
            scale,
            float(inside.mean()),
            (float(nearest), float(farthest)),
            fit.axis,
        )
        before = recentred(fit.coefficients, fit.axis)
        if best is None or information < best[0]:
            best = information, wall
    if best is None:
        raise ValueError("name at least one number of harmonics")
    return best[1]


class _Rays:
    """Points as rays with a measured depth, shift (disparity less offset) and its noise."""

    def __init__(self, points: WallPoints, z: Array, rig: StereoRig) -> None:
        self.u = points.rho_px * np.cos(points.theta) / rig.focal_px
        self.v = points.rho_px * np.sin(points.theta) / rig.focal_px
        self.z, self.range = z, rig.range_px_m
        self.shift = rig.range_px_m / z
        self.noise = np.hypot(points.noise_px, UNEVEN * self.shift)

    def spread(self, scale: float) -> Array:
        """Deviation (px) that a point of the wall may show where the wall's own is ``scale``."""
        return np.asarray(np.hypot(scale, self.noise), dtype=np.float64)


@dataclass(frozen=True)
class _Fit:
    coefficients: Array
    axis: Axis
    normal: Array
    residual: Array


@dataclass(frozen=True)
class _Linear:
    """The wall linearised at depths on its rays: ``rows`` of eq. 17, the ``gap`` (m) by which the points lie beyond it, and the
    disparity (px) that a metre of radius means there."""

    rows: Array
    gap: Array
    opening: Array
    per_metre: Array


def _linear(rays: _Rays, z: Array, coefficients: Array, axis: Axis) -> _Linear:
    x, y = (rays.u - axis.right) * z - axis.x, (rays.v - axis.down) * z - axis.y
    radius = np.maximum(np.hypot(x, y), 1e-6)
    cosine, sine = x / radius, y / radius
    rows = design_towards(cosine, sine, z, harmonics_of(coefficients))
    slopes = np.r_[1, np.arange(2, len(coefficients)).reshape(-1, 4)[:, 2:].ravel()].astype(np.intp)
    slope = (rows[:, slopes] @ coefficients[slopes]) / z
    opening = _opening(axis, cosine, sine, radius, slope, z)
    return _Linear(rows, radius - rows @ coefficients, opening, rays.range / (z * z) / opening)


def _opening(axis: Axis, cosine: Array, sine: Array, radius: Array, slope: Array, z: Array) -> Array:
    """By how many metres a ray leaves the wall, for each metre that it goes on in depth. (The turn of the ray about the axis is
    left out: it matters where a profile that is not round is seen from far off its axis, and there by a few hundredths.)"""
    return np.asarray(np.maximum((radius + axis.x * cosine + axis.y * sine) / z - slope, 1e-3), dtype=np.float64)


def _nearer(z: Array, gap: Array, opening: Array) -> Array:
    """One step of Newton's along the rays, no more than to half or to twice the depth."""
    return np.asarray(np.clip(np.clip(z - gap / opening, 0.5 * z, 2.0 * z), _NEAREST_M, _FARTHEST_M), dtype=np.float64)


def _known(coefficients: Array) -> tuple[Array, Array]:
    """(precision (P,), pull (P,)) of what is known of pipes, for a step away from ``coefficients``."""
    precision, wanted = np.zeros(len(coefficients)), coefficients.copy()
    radius = max(float(coefficients[0]), 1e-3)
    for k in range(2, harmonics_of(coefficients) + 1):
        still, sloping = slice(4 * k - 2, 4 * k), slice(4 * k, 4 * k + 2)
        precision[still], wanted[still] = (k * k / (_SHAPE * radius)) ** 2, 0.0
        precision[sloping], wanted[sloping] = (1.0 / (_TWIST * radius)) ** 2, coefficients[still] * coefficients[1] / radius
    return precision, precision * (wanted - coefficients)


def _reweighted(rays: _Rays, coefficients: Array, axis: Axis, scale: float, least: float, shared: float, near: bool) -> _Fit:
    """Some rounds of Tukey's weights. First the points at their measured depths, from wide weights to narrow ones, which finds
    its way from far; but its depths err together with its radii, which biases it by the noise squared. So the last rounds
    (Gauss and Newton) take each ray where it meets the wall, and the noise is in the disparity alone. ``shared``: how many
    points know as much as one."""
    at = _linear(rays, rays.z, coefficients, axis)
    residual = at.gap * at.per_metre
    normal = np.eye(len(coefficients))

    def solve(residual: Array, wide: float) -> tuple[Array, Array, float]:
        spread = rays.spread(scale * wide)
        tukey = np.clip(1.0 - (residual / (_TUKEY * spread)) ** 2, 0.0, 1.0) ** 2
        weight = tukey * (at.per_metre / spread) ** 2
        weighted = at.rows * weight[:, None]
        normal = weighted.T @ at.rows
        precision, pull = _known(coefficients)
        normal[np.diag_indices_from(normal)] += shared * precision + 1e-12 * np.trace(normal)
        step = np.linalg.solve(normal, weighted.T @ (residual / at.per_metre) + shared * pull)
        return np.asarray(step, dtype=np.float64), normal, float(weight.sum())

    for turn in range(_NEAR_ROUNDS if near else _ROUNDS):
        # from wide to narrow: a wall that bends away where fewer harmonics could not follow is not shut out at once
        step, normal, total = solve(residual, 1.0 if near else max(_WIDE * (1 - turn / (_ROUNDS - 3)), 1.0))
        if total <= 0:
            break
        coefficients, axis = recentred(coefficients + step, axis)
        at = _linear(rays, rays.z, coefficients, axis)
        residual = at.gap * at.per_metre
        scale = _scale(residual, rays, scale, least)
    z = rays.z
    for _ in range(_FREE_ROUNDS):
        z = _nearer(z, at.gap, at.opening)
        at = _linear(rays, z, coefficients, axis)
        residual = rays.range / z - rays.shift
        scale = _scale(residual, rays, scale, least)
        step, normal, total = solve(residual, 1.0)
        if total <= 0:
            break
        coefficients = coefficients + step
        at = _linear(rays, z, coefficients, axis)
    z = _nearer(z, at.gap, at.opening)
    return _Fit(coefficients, axis, normal, np.asarray(rays.range / z - rays.shift, dtype=np.float64))


def _scale(residual: Array, rays: _Rays, scale: float, least: float) -> float:
    inside = np.abs(residual) < _TUKEY * rays.spread(scale)
    if not inside.any():
        return scale
    return max(1.4826 * float(np.median(np.abs(residual[inside]))), least)
