"""What the fitted wall means to a lining engineer: width, height, ovality, and the circle or standard egg nearest to it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimators.radial_profile.fit import Wall
from estimators.radial_profile.model import Array, design

_STEPS = 720
_CIRCLE, _EGG = "circle", "egg"
_ALIKE = 0.02
"""Root mean square distance of a profile from a named shape, as a share of its width, up to which it is called so."""
_SPAN = np.radians(35.0)
"""How far the wall has to be seen to both sides of where a width or a height ends: what is not seen may reach farther."""
Z95 = 1.96


@dataclass(frozen=True)
class Extent:
    """A length (m) with its standard deviation."""

    value: float
    std: float

    @property
    def interval(self) -> tuple[float, float]:
        """95 %."""
        return self.value - Z95 * self.std, self.value + Z95 * self.std


@dataclass(frozen=True)
class Shape:
    """Cross-section across the pipe at ``depth`` (m), all in metres.

    ``width`` and ``height`` are None where one of their two ends was not seen; ``seen_height`` is how much of the height was.
    ``name`` is "circle", "egg" or "free"; ``fitted_width`` and ``fitted_height`` are those of the named shape (nan for "free").
    ``outline`` (N, 2) x, y about the camera's axis, nan where nothing was seen. ``ovality`` after ASTM F1216, nan without a
    full width and height.
    """

    depth: float
    width: Extent | None
    height: Extent | None
    seen_height: float
    name: str
    fitted_width: float
    fitted_height: float
    ovality: float
    outline: Array


def shape_of(wall: Wall, seen: NDArray[np.bool_], theta: Array) -> Shape:
    """The cross-section at the middle depth of ``wall``; ``seen`` (A,) tells at which angles ``theta`` about its axis it was
    measured.

    What the rig does not know of its offset and baseline moves every radius alike, and is part of each interval.
    """
    depth = 0.5 * (wall.depths[0] + wall.depths[1])
    angle: Array = (np.arange(_STEPS, dtype=np.float64) + 0.5) * (2 * np.pi / _STEPS) - np.pi
    nearest = np.abs(np.angle(np.exp(1j * (angle[:, None] - theta[None, ::4])))).argmin(axis=1) * 4
    known = seen[np.minimum(nearest, len(seen) - 1)]
    rows = design(angle, np.full(_STEPS, depth), wall.harmonics)
    radius = rows @ wall.coefficients
    tilt = _lean(wall)
    place = np.stack([radius * np.cos(angle) * tilt[0], radius * np.sin(angle) * tilt[1]], axis=1)
    middle = np.array([wall.axis.x + wall.axis.right * depth, wall.axis.y + wall.axis.down * depth])
    common = wall.rig.relative_std(depth)

    def extent(axis: int) -> Extent | None:
        ends = [int(np.argmax(place[:, axis])), int(np.argmin(place[:, axis]))]
        if not all(_seen_around(angle, known, direction) for direction in ((0.0, np.pi), (np.pi / 2, -np.pi / 2))[axis]):
            return None
        wave = (np.cos, np.sin)[axis](angle[ends])
        gradient = (rows[ends] * wave[:, None] * tilt[axis] * np.array([[1.0], [-1.0]])).sum(axis=0)
        value = float(place[ends[0], axis] - place[ends[1], axis])
        own = float(gradient @ wall.covariance @ gradient)
        return Extent(value, float(np.sqrt(max(own, 0.0) + (common * value) ** 2)))

    width, height = extent(0), extent(1)
    outline = np.where(known[:, None], place + middle, np.nan)
    visible = place[known]
    seen_height = float(np.ptp(visible[:, 1])) if len(visible) else 0.0
    name, fitted_width, fitted_height = _named_shape(visible)
    ovality = float("nan")
    if width is not None and height is not None:
        across = np.hypot(*(place + place[(np.arange(_STEPS) + _STEPS // 2) % _STEPS] * -1).T)
        mean = float(across.mean())
        ovality = max(float(across.max()) - mean, mean - float(across.min())) / mean
    return Shape(depth, width, height, seen_height, name, fitted_width, fitted_height, ovality, outline)


def _lean(wall: Wall) -> tuple[float, float]:
    """By how much a cut at one depth is wider and higher than one across the pipe, which leans against the camera's axis."""
    if wall.harmonics < 1:
        return 1.0, 1.0
    right, down = wall.axis.right + wall.coefficients[4], wall.axis.down + wall.coefficients[5]
    return float(np.cos(np.arctan(right))), float(np.cos(np.arctan(down)))


def _seen_around(angle: Array, known: NDArray[np.bool_], direction: float) -> bool:
    near = np.abs(np.angle(np.exp(1j * (angle - direction)))) < _SPAN
    return bool(known[near].mean() > 0.9)


def egg(count: int = 360) -> Array:
    """Outline (count, 2) of the standard egg of width 1 and height 1.5, y down, about the centre of its upper half circle."""
    y = np.linspace(-0.5, 1.0, count // 2)
    # half circle of 1/2 above, sides of radius 3/2 about the far springing, invert of 1/4 about (0, 3/4)
    side = np.sqrt(np.maximum(2.25 - np.maximum(y, 0.0) ** 2, 0.0)) - 1.0
    foot = np.sqrt(np.maximum(0.0625 - (y - 0.75) ** 2, 0.0))
    x = np.where(y < 0, np.sqrt(np.maximum(0.25 - y * y, 0.0)), np.where(y < 0.9, side, foot))
    return np.concatenate([np.stack([x, y], axis=1), np.stack([-x[::-1], y[::-1]], axis=1)])


def _named_shape(points: Array) -> tuple[str, float, float]:
    """(name, width, height) of the circle or egg that fits the outline; "free" where neither does."""
    nan = float("nan")
    if len(points) < 60:
        return "free", nan, nan
    some = points[:: max(1, len(points) // 180)]
    rows = np.c_[some, np.ones(len(some))]
    middle_x, middle_y, rest = np.linalg.lstsq(rows, (some**2).sum(axis=1), rcond=None)[0]
    radius = float(np.sqrt(max(rest + 0.25 * (middle_x**2 + middle_y**2), 0.0)))
    off_circle = float(np.sqrt(np.mean((np.hypot(some[:, 0] - middle_x / 2, some[:, 1] - middle_y / 2) - radius) ** 2)))
    if radius > 0 and off_circle < 0.5 * _ALIKE * 2 * radius:
        return _CIRCLE, 2 * radius, 2 * radius
    width, off_egg = _fit_egg(some, radius)
    if off_egg < _ALIKE * width:
        return _EGG, width, 1.5 * width
    return "free", nan, nan


def _fit_egg(points: Array, radius: float) -> tuple[float, float]:
    """(width, rms distance) of the standard egg through ``points``, by closest points and similarity, upright."""
    outline = egg()
    width = float(np.ptp(points[:, 0])) or 2 * radius
    centre = np.array([points[:, 0].mean(), points[:, 1].min() + 0.5 * width])
    distance = np.inf
    for _ in range(40):
        placed = centre + width * outline
        gaps = ((points[:, None] - placed[None]) ** 2).sum(axis=2)
        match = outline[gaps.argmin(axis=1)]
        distance = float(np.sqrt(gaps.min(axis=1).mean()))
        mean_match, mean_point = match.mean(axis=0), points.mean(axis=0)
        spread = float(((match - mean_match) ** 2).sum())
        if spread <= 0:
            break
        width = float(((match - mean_match) * (points - mean_point)).sum() / spread)
        centre = mean_point - width * mean_match
    return width, distance
