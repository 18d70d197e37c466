"""Fitting eq. 17 of the RADIUS paper to points that may lie on a wall: a search by samples, then a robust refinement.

The noise of stereo is even in the disparity, not in the radius: residuals are therefore counted in pixels of disparity. With
c + s Z the radius of eq. 17, a pixel at rho on the wall has Z = c / (rho / f - s), so that its disparity is
offset + f b (rho / f - s) / c.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimators.radial_profile.model import Array, design, harmonics_of, parameters, profile_at
from estimators.stereo.rig import StereoRig

MAX_HARMONICS = 6
_SEARCH_HARMONICS = 2
_SPARE = 6
_BATCH = 100
_MAX_BATCHES = 6
_SEARCH_POINTS = 2000
_SEARCH_PX = 4.0
"""Residual of disparity at which a point no longer speaks for a sample, at 1920 pixels of width."""
_TUKEY = 4.7
_ROUNDS, _WIDE = 14, 4.0
_TABLE = 1440
_SHRINK = 1e-8


@dataclass(frozen=True)
class Wall:
    """A fitted wall. ``coefficients`` (2 + 4 K,) of eq. 17 in metres, for depths by ``rig``.

    ``covariance`` of the coefficients; ``noise_px`` the robust spread of the disparities about it; ``share`` of the points that
    follow it; ``depths`` (nearest, farthest) in metres of those that do.
    """

    coefficients: Array
    covariance: Array
    rig: StereoRig
    noise_px: float
    share: float
    depths: tuple[float, float]

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
        """Radius (m) that the wall has at angles and depths."""
        constant, slope = self.profile(theta)
        return constant + slope * z

    def disparity(self, theta: NDArray[np.floating], rho_px: NDArray[np.floating]) -> Array:
        """Disparity (px) that the wall has where a pixel's ray meets it."""
        constant, slope = self.profile(theta)
        reach = rho_px / self.rig.focal_px - slope
        return (self.rig.offset_px or 0.0) + self.rig.range_px_m * reach / np.maximum(constant, 1e-3)


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
) -> Wall:
    """Robust refit from ``start`` by iterated reweighting (Tukey), with as many harmonics as the data pays for.

    ``harmonics`` are tried in turn, each from the one before; the one with the smallest Bayesian information criterion for
    ``independent`` points wins (neighbouring pixels share their noise, so there are fewer than points). Raises
    ``numpy.linalg.LinAlgError`` where nothing can be solved.
    """
    z = rig.depth(points.disparity)
    usable = np.isfinite(z)
    points, z = points.some(usable), z[usable]
    shift = points.disparity - (rig.offset_px or 0.0)
    r = points.rho_px * z / rig.focal_px
    rows = design(points.theta, z, max(harmonics))
    coefficients, scale = start, noise_px
    best: tuple[float, Wall] | None = None
    for count in harmonics:
        kept = np.zeros(parameters(count))
        kept[: min(len(coefficients), len(kept))] = coefficients[: len(kept)]
        coefficients, normal, residual = _reweighted(
            rows[:, : parameters(count)], r, shift, points, kept, scale, least_noise_px
        )
        inside = np.abs(residual) < _TUKEY * np.hypot(scale, points.noise_px)
        if np.count_nonzero(inside) < 3 * parameters(count):
            raise np.linalg.LinAlgError("no wall is left")
        scale = max(1.4826 * float(np.median(np.abs(residual[inside]))), least_noise_px)
        truncated = float(np.mean(np.minimum(residual**2, (_TUKEY * noise_px) ** 2)))
        information = independent * np.log(truncated + 1e-12) + parameters(count) * np.log(max(independent, 2.0))
        nearest, farthest = np.percentile(z[inside], [1, 99])
        wall = Wall(
            coefficients,
            np.asarray(np.linalg.inv(normal) * max(len(z) / independent, 1.0), dtype=np.float64),
            rig,
            scale,
            float(inside.mean()),
            (float(nearest), float(farthest)),
        )
        if best is None or information < best[0]:
            best = information, wall
    if best is None:
        raise ValueError("name at least one number of harmonics")
    return best[1]


def _reweighted(
    rows: Array, r: Array, shift: Array, points: WallPoints, coefficients: Array, scale: float, least: float
) -> tuple[Array, Array, Array]:
    """(coefficients, normal matrix, residuals in pixels) after some rounds of Tukey's weights.

    The depth in ``rows`` is the measured one, so that its noise flattens the slope by the square of noise over range: a
    thousandth where the disparities of the wall range over 25 pixels and err by 0.7.
    """
    count = harmonics_of(coefficients)
    spared = np.r_[0.0, 0.0, np.repeat(np.arange(1, count + 1) ** 4.0, 4)] if count else np.zeros(2)
    residual = _residual(rows, r, shift, coefficients)
    normal = np.eye(rows.shape[1])
    for turn in range(_ROUNDS):
        # from wide to narrow: a wall that bends away where fewer harmonics could not follow is not shut out at once
        spread = np.hypot(scale * max(_WIDE * (1 - turn / (_ROUNDS - 4)), 1.0), points.noise_px)
        tukey = np.clip(1.0 - (residual / (_TUKEY * spread)) ** 2, 0.0, 1.0) ** 2
        constant = np.maximum(_constant(rows, coefficients), 1e-3)
        weight = tukey * (shift / constant / spread) ** 2
        weighted = rows * weight[:, None]
        normal = weighted.T @ rows
        normal[np.diag_indices_from(normal)] += _SHRINK * spared * weight.sum() + 1e-12 * np.trace(normal)
        coefficients = np.asarray(np.linalg.solve(normal, weighted.T @ r), dtype=np.float64)
        residual = _residual(rows, r, shift, coefficients)
        inside = np.abs(residual) < _TUKEY * np.hypot(scale, points.noise_px)
        if not inside.any():
            break
        scale = max(1.4826 * float(np.median(np.abs(residual[inside]))), least)
    return coefficients, normal, residual


def _constant(rows: Array, coefficients: Array) -> Array:
    """The part of the radius that does not change with depth, at each row of the design."""
    still = np.r_[0, np.arange(2, len(coefficients)).reshape(-1, 4)[:, :2].ravel()]
    return np.asarray(rows[:, still] @ coefficients[still], dtype=np.float64)


def _residual(rows: Array, r: Array, shift: Array, coefficients: Array) -> Array:
    """Disparity of the wall less the measured one, in pixels."""
    constant = np.maximum(_constant(rows, coefficients), 1e-3)
    return np.asarray((r - rows @ coefficients) * shift / constant, dtype=np.float64)
