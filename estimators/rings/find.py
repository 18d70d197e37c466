"""Pipe joints in one picture: ellipses around the focus of expansion, found in the log-polar picture.

A ring at depth Z is centred at c + f e / Z (c the focus of expansion, e the pipe's axis as seen from the camera) and has the
radius f R / Z, so seen from c every ring of a picture leans to the same side by the same share e / R of its radius. In the
log-polar picture around c all rings are therefore copies of one curve, one shift apart: the lean is searched on a grid, the
evidence is summed along the curve, and each peak is refined to an upright ellipse.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Image = NDArray[np.float32]
Mask = NDArray[np.bool_]
_BORDER = 7
"""Reduced pixels at the picture's border that a grabber may have smeared."""
_PULL = 0.02
"""Pull of an ellipse towards square pixels, against the weight of its points: a short arc tells no aspect."""


@dataclass(frozen=True)
class Ring:
    """One joint in one picture: an ellipse with ``centre`` (u, v) and half axes ``across`` and ``upright`` (px).

    ``std`` (px) of its radius, ``support`` the share of the visible directions in which it is seen, ``strength`` 0..1 its mean
    evidence there.
    """

    centre: tuple[float, float]
    across: float
    upright: float
    std: float
    support: float
    strength: float

    @property
    def radius(self) -> float:
        """Geometric mean of both half axes (px): sqrt(fx fy) R / Z."""
        return float(np.sqrt(self.across * self.upright))

    @property
    def quality(self) -> float:
        """0..1."""
        return self.support * self.strength


@dataclass(frozen=True)
class RingConfig:
    """How rings are looked for."""

    width: int = 360
    """Pictures are reduced to about this width."""
    angles: int = 90
    radii: int = 160
    least_px: float = 7.0
    """Radius of the smallest ring, at the reduced width."""
    lean: float = 0.4
    """Largest lean searched: the camera's offset over the pipe's radius, and what the given centre is off."""
    lean_steps: int = 17
    evidence: float = 0.30
    """Mean evidence along a curve for it to be looked at."""
    support: float = 0.5
    """Share of the visible directions in which an accepted ring is seen."""
    quality: float = 0.45
    """Least product of support and strength of an accepted ring."""
    visible: float = 0.4
    """Share of the directions in which it must lie inside the picture."""
    tries: int = 16
    """Curves that are looked at closely, those with most evidence first: what a picture costs."""
    rounds: tuple[int, ...] = (6, 3)
    """How far from the curve each round of refinement looks, in bins."""
    most: int = 8
    """Rings a picture, the strongest."""


@dataclass(frozen=True)
class Polar:
    """Log-polar picture around ``middle`` (px of the reduced picture): ``evidence`` (A, R) 0..1 of a line across the radius,
    ``inside`` (A, R) where the picture is, at ``radii`` (R,) px and ``angle`` (A,) rad; ``step`` is the log of the ratio of
    neighbouring radii."""

    middle: tuple[float, float]
    evidence: Image
    inside: Mask
    radii: Image
    angle: Image
    step: float


def find(
    gray: NDArray[np.uint8],
    centre: tuple[float, float],
    config: RingConfig | None = None,
    lean: tuple[float, float] | None = None,
    aspect: float = 1.0,
) -> list[Ring]:
    """Rings of a picture (H, W) uint8 around ``centre`` (u, v) px, which may be off by a part of the smallest ring's radius.

    ``lean`` (2,), e / R as the pictures before had it, narrows the search to its neighbourhood. ``aspect`` is fx / fy as far as
    it is known (see ``RingMap.aspect``): with it rings are circles, and those of which an arc is seen are right. Largest radius
    first.
    """
    config = config or RingConfig()
    across = config.width / gray.shape[1]
    factor = across, across * aspect
    small = cv2.resize(gray, None, fx=factor[0], fy=factor[1], interpolation=cv2.INTER_AREA)
    middle = ((centre[0] + 0.5) * factor[0] - 0.5, (centre[1] + 0.5) * factor[1] - 0.5)
    polar = log_polar(np.asarray(small, np.float32), middle, config)
    leans = _leans(config, lean)
    found = [_refined(polar, leans[k], j, config) for k, j in _peaks(polar, leans, config)]
    rings = [_whole_size(ring, middle, factor) for ring in found if ring is not None]
    return _distinct(sorted(rings, key=lambda ring: -ring.quality))[: config.most]


def log_polar(small: Image, middle: tuple[float, float], config: RingConfig) -> Polar:
    """The evidence around ``middle`` of a reduced picture."""
    height, width = small.shape
    radii, angle, du, dv = _cells(config, round(0.62 * float(np.hypot(width, height))))
    u, v = np.float32(middle[0]) + du, np.float32(middle[1]) + dv
    left, top, right, bottom = _lit(small)
    inside = (u > left + _BORDER) & (u < right - 1 - _BORDER) & (v > top + _BORDER) & (v < bottom - 1 - _BORDER)
    seen = np.asarray(cv2.remap(small, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE), np.float32)
    # light falls off along the pipe: contrast counts, not difference; around the ring it changes slowly
    seen = np.log(seen + np.float32(6))
    wrapped = np.concatenate([seen[-2:], seen, seen[:2]])
    seen = np.asarray(cv2.blur(wrapped, (1, 5)), np.float32)[2:-2]
    # nothing outside the picture has a say: its border would outshine every joint
    mask = inside.astype(np.float32)
    line = np.abs(_smooth(seen, 1.0, mask) - _smooth(seen, 4.0, mask)) * mask
    usual = np.asarray(cv2.blur(line, (35, 9)), np.float32) / np.maximum(cv2.blur(mask, (35, 9)), np.float32(0.1))
    evidence = line / (np.float32(2.0) * usual + np.float32(0.012)) - np.float32(0.35)
    return Polar(
        middle,
        np.where(inside, np.clip(evidence, 0, 1), np.float32(0)),
        inside,
        radii,
        angle,
        float(np.log(radii[1] / radii[0])),
    )


def _lit(small: Image) -> tuple[int, int, int, int]:
    """(left, top, right, bottom) px of the picture without the black borders that a grabber adds."""
    height, width = small.shape
    across, down = (np.quantile(small, 0.8, axis=k) > 16 for k in (0, 1))
    if not across[width // 4 : -width // 4].any() or not down[height // 4 : -height // 4].any():
        return 0, 0, width, height
    left, top = (min(int(np.argmax(lit)), len(lit) // 8) for lit in (across, down))
    right, bottom = (len(lit) - min(int(np.argmax(lit[::-1])), len(lit) // 8) for lit in (across, down))
    return left, top, right, bottom


def _smooth(values: Image, bins: float, mask: Image) -> Image:
    """Smoothed along the radius, over what ``mask`` lets through."""
    total, weight = (cv2.GaussianBlur(one, (0, 0), sigmaX=bins, sigmaY=1e-3) for one in (values * mask, mask))
    return np.asarray(total / np.maximum(weight, np.float32(1e-3)), np.float32)


@lru_cache(maxsize=4)
def _cells(config: RingConfig, reach: int) -> tuple[Image, Image, Image, Image]:
    """Log-spaced radii (R,), angles (A,), and offsets (A, R) of the log-polar cells from their centre."""
    radii = np.geomspace(0.7 * config.least_px, reach, config.radii).astype(np.float32)
    angle = (np.arange(config.angles, dtype=np.float32) + np.float32(0.5)) * np.float32(2 * np.pi / config.angles)
    return radii, angle, np.cos(angle)[:, None] * radii, np.sin(angle)[:, None] * radii


@lru_cache(maxsize=64)
def _leans(config: RingConfig, lean: tuple[float, float] | None) -> Array:
    """Leans (K, 2) to try."""
    spacing = 2 * config.lean / (config.lean_steps - 1)
    steps = np.linspace(-config.lean, config.lean, config.lean_steps) if lean is None else spacing * np.arange(-1, 2)
    grid = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    return np.asarray(grid[np.hypot(*grid.T) <= 1.05 * config.lean]) if lean is None else grid + np.asarray(lean)


def _curve(leans: Array, angle: Image) -> Array:
    """Log of the radius (K, A) of a unit circle centred at each lean, seen from the origin."""
    along = leans[:, :1] * np.cos(angle) + leans[:, 1:] * np.sin(angle)
    across2 = (leans**2).sum(axis=1, keepdims=True) - along**2
    return np.asarray(np.log(along + np.sqrt(np.maximum(1 - across2, 0.05))))


def _peaks(polar: Polar, leans: Array, config: RingConfig) -> list[tuple[int, int]]:
    """(index of the lean, radius bin) of the curves with most evidence, no two of them at the same radius."""
    angles, bins = polar.evidence.shape
    shift = np.rint(_curve(leans, polar.angle) / polar.step).astype(np.int64)
    # room beyond both ends, so that a shifted row is one slice of a longer one
    room = int(np.abs(shift).max())
    wide = np.zeros((2, angles, bins + 2 * room), np.float32)
    wide[0, :, room : room + bins] = cv2.blur(polar.evidence, (5, 1)) * np.float32(2)  # the grid of leans is coarse
    wide[1, :, room : room + bins] = polar.inside
    rows = np.lib.stride_tricks.sliding_window_view(wide, bins, axis=2)  # (2, A, 2 room + 1, R)
    total = np.stack([rows[:, np.arange(angles), room + one].sum(axis=1) for one in shift])  # (K, 2, R)
    mean = np.where(total[:, 1] >= config.visible * angles, total[:, 0] / np.maximum(total[:, 1], 1), 0)
    best = mean.max(axis=0)
    chosen: list[tuple[int, int]] = []
    taken = np.zeros(bins, bool)
    for j in np.argsort(-best):
        if best[j] < config.evidence or len(chosen) >= config.tries:
            break
        if not taken[j]:
            chosen.append((int(np.argmax(mean[:, j])), int(j)))
            taken[max(j - 2, 0) : j + 3] = True
    return chosen


def _refined(polar: Polar, lean: Array, start: int, config: RingConfig) -> Ring | None:
    """An upright ellipse through the strongest evidence near the curve; None where too few directions have any. The centre is
    relative to ``polar.middle``."""
    curve = start + _curve(lean[None], polar.angle)[0] / polar.step
    ring: Ring | None = None
    for reach in config.rounds:  # each round looks nearer to what the one before has found
        ring = _fitted(polar, curve, reach, config)
        if ring is None:
            return None
        curve = _seen_from_middle(ring, polar)
    return None if ring is None or ring.support < config.support or ring.quality < config.quality else ring


def _seen_from_middle(ring: Ring, polar: Polar) -> Array:
    """Radius bin (A,) of an ellipse in each direction."""
    a, b = np.cos(polar.angle) / ring.across, np.sin(polar.angle) / ring.upright
    u, v = ring.centre[0] / ring.across, ring.centre[1] / ring.upright
    square, along = a * a + b * b, a * u + b * v
    radius = (along + np.sqrt(np.maximum(along**2 + square * (1 - u * u - v * v), 1e-9))) / square
    return np.asarray(np.log(np.maximum(radius, 1e-3) / polar.radii[0]) / polar.step, np.float64)


def _fitted(polar: Polar, curve: Array, reach: int, config: RingConfig) -> Ring | None:
    """One round: the strongest evidence within ``reach`` bins of ``curve`` (A,), and the ellipse through it."""
    angles, bins = polar.evidence.shape
    row = np.arange(angles)
    offsets = np.arange(-reach, reach + 1)
    near = np.rint(curve).astype(np.int64)[:, None] + offsets
    valid = (near >= 1) & (near < bins - 1)
    near = np.clip(near, 1, bins - 2)
    strength = np.where(valid, polar.evidence[row[:, None], near], 0) * np.exp(-0.5 * (offsets / (0.6 * reach)) ** 2)
    peak = near[row, strength.argmax(axis=1)]
    here, before, after = (polar.evidence[row, peak + k].astype(np.float64) for k in (0, -1, 1))
    bend = np.minimum(before - 2 * here + after, -1e-6)
    radius = polar.radii[0] * np.exp((peak + np.clip(0.5 * (before - after) / bend, -0.5, 0.5)) * polar.step)
    place = np.clip(np.rint(curve).astype(np.int64), 0, bins - 1)
    visible = polar.inside[row, place] & (curve > 0) & (curve < bins - 1)
    strong = visible & (here > 0.25)
    if np.count_nonzero(visible) < config.visible * angles or np.count_nonzero(strong) < 0.3 * angles:
        return None
    points = np.stack([radius * np.cos(polar.angle), radius * np.sin(polar.angle)], axis=1)
    ellipse = _ellipse(points, np.where(strong, here, 0), float(np.median(radius[strong])))
    if ellipse is None:
        return None
    centre, axes, off = ellipse
    mean = float(np.sqrt(axes[0] * axes[1]))
    agree = strong & (np.abs(off) < 0.6 + 0.015 * mean)
    odd = not 0.75 < axes[0] / axes[1] < 1.33 or np.hypot(*centre) > 0.6 * mean or mean < config.least_px
    if odd or np.count_nonzero(agree) < 0.25 * angles:
        return None
    spread = float(np.std(off[agree])) * float(np.sqrt(4 / np.count_nonzero(agree)))
    std = float(np.hypot(spread, 0.15 + 0.003 * mean))
    support = np.count_nonzero(agree) / np.count_nonzero(visible)
    middle = float(centre[0]), float(centre[1])
    return Ring(middle, float(axes[0]), float(axes[1]), std, float(support), float(here[agree].mean()))


def _ellipse(points: Array, weight: Array, scale: float) -> tuple[Array, Array, Array] | None:
    """Centre (2,), half axes (2,) and distances (n,) from the upright ellipse through weighted ``points``, by re-weighted least
    squares with a mild pull to a circle."""
    x, y = (points / scale).T
    design = np.stack([y * y - x * x, x, y, np.ones_like(x)], axis=1)
    off = np.zeros(len(x))
    pull = np.diag([_PULL * weight.sum(), 0, 0, 0])
    centre, axes = np.zeros(2), np.ones(2)
    for _ in range(6):
        robust = weight / (1 + (off / (0.02 * scale + 0.5)) ** 2) ** 2
        weighted = design * robust[:, None]
        # x^2 (1 - q) + y^2 q + ... with q = 1/2 for a circle
        rhs = weighted.T @ (-0.5 * (x * x + y * y))
        q, a, b, c = np.linalg.solve(weighted.T @ design + pull + 1e-9 * np.eye(4), rhs)
        p, q = 0.5 - q, 0.5 + q
        if p <= 0.1 or q <= 0.1:
            return None
        centre = np.array([-a / (2 * p), -b / (2 * q)])
        level = p * centre[0] ** 2 + q * centre[1] ** 2 - c
        if level <= 0:
            return None
        axes = np.sqrt(level / np.array([p, q]))
        unit = (np.stack([x, y], axis=1) - centre) / axes
        rho = np.hypot(*unit.T)
        off = (rho - 1) * float(np.sqrt(axes[0] * axes[1])) * scale
    return centre * scale, axes * scale, off


def _whole_size(ring: Ring, middle: tuple[float, float], factor: tuple[float, float]) -> Ring:
    u, v = ((m + c + 0.5) / f - 0.5 for m, c, f in zip(middle, ring.centre, factor, strict=True))
    std = ring.std / float(np.sqrt(factor[0] * factor[1]))
    return Ring((u, v), ring.across / factor[0], ring.upright / factor[1], std, ring.support, ring.strength)


def _distinct(rings: list[Ring]) -> list[Ring]:
    """Of rings that are one another's double, the stronger; both edges of one joint are one."""
    kept: list[Ring] = []
    for ring in rings:
        if all(abs(np.log(ring.radius / other.radius)) > 0.06 + 2 / other.radius for other in kept):
            kept.append(ring)
    return sorted(kept, key=lambda ring: -ring.radius)


def dark_centre(gray: NDArray[np.uint8]) -> tuple[float, float]:
    """(u, v) px of the dark at the end of the pipe: where to look for rings while no flow has told the focus of expansion."""
    factor = 90 / gray.shape[1]
    small = np.asarray(cv2.resize(gray, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA), np.float32)
    smooth = np.asarray(cv2.GaussianBlur(small, (0, 0), 1.5), np.float32)
    height, width = smooth.shape
    v, u = np.mgrid[:height, :width]
    # a dark corner is no pipe
    away = np.hypot((u - width / 2) / width, (v - height / 2) / height)
    value = smooth + np.float32(120) * np.maximum(away - 0.25, 0).astype(np.float32)
    # the very darkest: a shadow or water in the invert is dark too, and would pull the middle down
    dark = value <= np.quantile(value, 0.004)
    return float((u[dark].mean() + 0.5) / factor - 0.5), float((v[dark].mean() + 0.5) / factor - 0.5)
