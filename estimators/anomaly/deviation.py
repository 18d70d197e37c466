"""The signed deviation of the wall, in metres: outwards positive, inwards negative, unrolled as angle by depth.

A ray that meets a deposit stops before it reaches the wall: its point belongs to the depth at which it stopped, and the wall
behind the deposit is hidden. Deviations are therefore put where their points lie (radius paper, section 4.5), not where their
rays aim.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from estimators.anomaly.parts import parts_around
from estimators.stereo.follow import FollowedWall
from estimators.stereo.on_wall import windows_of
from estimators.stereo.unrolled import Unrolled

Floats = NDArray[np.float32]

ANGLES, ROWS = 540, 240
_CLOSING_M, _CLOSING_SHARE, _CLOSING_ROWS = 0.001, 0.01, (14, 36)
"""What is off by so much (m, and share of the radius) and reaches to so many rows of the followed wall before the far end, but
not to more than the second number of them, may belong to what closes it: windows that reach beyond the end smear it so far."""
_KNOWN_SHARE = 0.015
"""Where the wall's own shape is known less well than this share of its radius (standard deviation), nothing is off it."""
_SMOOTHING = (5, 3)
_REACH = 0.75
"""Points farther off the wall than this share of its radius are no part of it."""


@dataclass(frozen=True)
class PointDeviations:
    """One value for each cell of the followed wall's grid (Z, A), nan where no depth can be trusted: ``depth`` (m) of the
    point, ``radius`` (m) and ``theta`` (rad) about the wall's axis, ``deviation`` (m) and its ``sigma`` (m)."""

    depth: Floats
    radius: Floats
    deviation: Floats
    sigma: Floats
    theta: Floats


@dataclass(frozen=True)
class DeviationMap:
    """The unrolled wall: ``theta`` (A,) rad about the wall's axis, ``depth`` (Z,) m; the rest is (Z, A).

    ``deviation`` (m) and ``sigma`` (m), of the match and of the wall's shape together, nan where nothing was measured; ``wall``
    what belongs to the wall between its ends; ``hidden`` wall that nothing was measured on although the rays about it were:
    something stands before it. ``area`` (m2) of each cell; ``radius`` (m) that the wall should have; ``gain`` by how much the
    patches agree better where they were found than if the wall stood where it should; ``patch`` (m2) the wall that the windows
    cover which measured it. ``centre`` (Z, 2): where the wall's axis stands at each depth, x and y from the camera's, m; None
    where that is the wall's.
    """

    theta: NDArray[np.float64]
    depth: NDArray[np.float64]
    deviation: Floats
    sigma: Floats
    wall: NDArray[np.bool_]
    hidden: NDArray[np.bool_]
    area: Floats
    radius: Floats
    gain: Floats
    patch: Floats
    centre: NDArray[np.float64] | None = None

    @property
    def points(self) -> NDArray[np.float64]:
        """(Z, A, 3) in the camera's frame (m): what was measured, and the wall as it should be where nothing was."""
        radius = self.radius + np.nan_to_num(self.deviation).astype(np.float64)
        centre = np.zeros((len(self.depth), 2)) if self.centre is None else self.centre
        x = centre[:, :1] + radius * np.cos(self.theta)
        y = centre[:, 1:] + radius * np.sin(self.theta)
        return np.stack([x, y, np.broadcast_to(self.depth[:, None], x.shape)], axis=-1)

    @property
    def measured(self) -> NDArray[np.bool_]:
        """Where there is a deviation."""
        return np.isfinite(self.deviation)


def point_deviations(followed: FollowedWall) -> PointDeviations:
    """Deviation of every trusted cell: measured radius less that of eq. 17 at the point's own angle and depth."""
    wall, grid = followed.wall, followed.grid
    shift = followed.disparity.astype(np.float64) - (wall.rig.offset_px or 0.0)
    usable = followed.usable & (shift > 0)
    depth = np.where(usable, wall.rig.range_px_m / np.where(shift > 0, shift, 1.0), np.nan)
    with np.errstate(invalid="ignore"):
        theta, radius = wall.about(grid.u, grid.v, depth)
        constant, slope = wall.profile(np.nan_to_num(theta))
        deviation = radius - (constant + slope * depth)
        deviation[np.abs(deviation) > _REACH * constant] = np.nan
        sigma = followed.match.sigma * constant / shift
    sigma[~np.isfinite(deviation)] = np.nan
    return PointDeviations(*(values.astype(np.float32) for values in (depth, radius, deviation, sigma, theta)))


def deviation_map(followed: FollowedWall, points: PointDeviations) -> DeviationMap:
    """The deviations where their points lie, as means over the cells of an even grid."""
    grid, wall, ends = followed.grid, followed.wall, followed.ends
    nearest, farthest = float(grid.depth[ends.first]), float(grid.depth[ends.last - 1])
    step = (farthest - nearest) / ROWS
    depth: NDArray[np.float64] = nearest + (np.arange(ROWS, dtype=np.float64) + 0.5) * step
    theta: NDArray[np.float64] = (np.arange(ANGLES, dtype=np.float64) + 0.5) * (2 * np.pi / ANGLES) - np.pi
    again, late = _along_each(grid, step)
    row = np.floor((points.depth[again] + late[:, None] - nearest) / step)
    measured = np.isfinite(points.deviation[again]) & (row >= 0) & (row < ROWS)
    turned = points.theta[again][measured].astype(np.float64) + np.pi
    column = np.floor(turned * (ANGLES / (2 * np.pi))).astype(np.int64) % ANGLES
    place = row[measured].astype(np.int64) * ANGLES + column
    cells = ROWS * ANGLES
    weight = 1.0 / np.maximum(points.sigma[again][measured].astype(np.float64), 1e-5) ** 2
    total = np.bincount(place, weight, cells)
    count = np.bincount(place, minlength=cells)
    value = np.bincount(place, weight * points.deviation[again][measured], cells)
    gain, patch = (
        np.divide(np.bincount(place, weight * values[again][measured], cells), total, out=np.zeros(cells), where=total > 0)
        .reshape(ROWS, ANGLES)
        .astype(np.float32)
        for values in (followed.gain, _patch_areas(followed))
    )
    # the cells of one window share their error: means over a few of them are no surer than one
    spread = np.sqrt(np.divide(count, total, out=np.full(cells, np.nan), where=total > 0))
    deviation = np.divide(value, total, out=np.full(cells, np.nan), where=total > 0).reshape(ROWS, ANGLES).astype(np.float32)
    sigma = spread.reshape(ROWS, ANGLES).astype(np.float32)
    inside, trusted = _resampled(followed, depth, theta)
    filled, filled_sigma = _small_gaps(deviation, sigma)
    deviation, sigma = (
        np.where(inside, filled, np.nan).astype(np.float32),
        np.where(inside, filled_sigma, np.nan).astype(np.float32),
    )
    hidden = inside & trusted & ~np.isfinite(deviation)
    least = _CLOSING_M + _CLOSING_SHARE * float(np.median(wall.coefficients[0]))
    closing = what_closes(deviation, inside, grid.row_of(depth), least)
    deviation[closing], sigma[closing] = np.nan, np.nan
    radius = wall.radius(theta, np.broadcast_to(depth[:, None], (ROWS, ANGLES)))
    shape_std = wall.radius_std(theta, depth)
    sigma = np.hypot(sigma, shape_std).astype(np.float32)
    unknown = shape_std > _KNOWN_SHARE * radius
    deviation[unknown], sigma[unknown] = np.nan, np.nan
    area = np.maximum(radius, 0.0) * (2 * np.pi / ANGLES) * step
    return DeviationMap(
        theta,
        depth,
        deviation,
        sigma,
        inside,
        hidden,
        area.astype(np.float32),
        radius.astype(np.float32),
        gain,
        patch,
        np.stack(wall.axis.at(depth), axis=1),
    )


def _patch_areas(followed: FollowedWall) -> Floats:
    """Wall (m2) that the window covers which answered for each cell (Z, A)."""
    grid = followed.grid
    cell = grid.cell[0] * grid.cell[1] * grid.depth * float(np.median(followed.wall.coefficients[0]))
    sizes = np.asarray([across * along for across, along in windows_of(grid)], dtype=np.float32)
    return np.asarray(sizes[followed.match.window] * cell[:, None].astype(np.float32), dtype=np.float32)


def _along_each(grid: Unrolled, step: float) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """(row, metres behind its middle) of every place to put: a row of the followed wall that is longer than those of the map,
    ``step`` (m), counts in each of them that it covers."""
    length = grid.depth * grid.cell[0]
    times = np.ceil(length / step).astype(np.intp)
    row = np.repeat(np.arange(len(length)), times)
    turn = np.arange(len(row)) - np.repeat(np.cumsum(times) - times, times)
    return row, ((turn + 0.5) / times[row] - 0.5) * length[row]


def smoothed(found: DeviationMap) -> tuple[Floats, Floats]:
    """Deviation and sigma as weighted means over a few cells, around the pipe without a seam."""
    reach = _SMOOTHING[0]
    known = found.measured
    weight = np.where(known, 1.0 / np.maximum(np.nan_to_num(found.sigma, nan=1.0), 1e-5) ** 2, 0.0).astype(np.float32)
    padded = [
        np.concatenate([values[:, -reach:], values, values[:, :reach]], axis=1)
        for values in (weight, weight * np.nan_to_num(found.deviation), known.astype(np.float32))
    ]
    total, value, count = (cv2.blur(values, _SMOOTHING, borderType=cv2.BORDER_REPLICATE)[:, reach:-reach] for values in padded)
    with np.errstate(divide="ignore", invalid="ignore"):
        mean = np.where(known & (total > 0), value / total, np.nan).astype(np.float32)
        spread = np.where(known & (total > 0), np.sqrt(count / total), np.nan).astype(np.float32)
    return mean, spread


def _resampled(followed: FollowedWall, depth: NDArray[np.float64], theta: NDArray[np.float64]) -> tuple[NDArray[np.bool_], ...]:
    """What of the map lies in the picture between the wall's ends, and where its rays were trusted."""
    grid = followed.grid
    row = np.clip(np.round(grid.row_of(depth)).astype(int), 0, len(grid.depth) - 1)
    column = np.clip(((np.arange(len(theta)) + 0.5) * len(grid.theta) / len(theta)).astype(int), 0, len(grid.theta) - 1)
    pick = np.ix_(row, column)
    return (followed.ends.inside & grid.seen)[pick], followed.match.trusted[pick]


def what_closes(deviation: Floats, inside: NDArray[np.bool_], row: NDArray[np.float64], least: float) -> NDArray[np.bool_]:
    """Cells off the wall that reach to its far end: whatever closes the pipe there (a manhole, a cloth, a bend) looks like a
    deposit by its rim, or by its noise like a loss, and cannot be told from one. It is no measurement of the wall.
    ``row`` (Z,): the row of the followed wall at each depth."""
    last = inside.shape[0] - 1 - np.argmax(inside[::-1], axis=0)
    before_end = row[last] - row[:, None]
    closing = np.zeros(inside.shape, dtype=np.bool_)
    for sign in (-1.0, 1.0):
        off = sign * np.nan_to_num(deviation) > least
        labels = parts_around(off)[0]
        reaching = np.unique(labels[(before_end < _CLOSING_ROWS[0]) & off])
        longer = np.unique(labels[(before_end > _CLOSING_ROWS[1]) & off])
        closing |= np.isin(labels, np.setdiff1d(reaching, longer)) & off
    return closing


def _small_gaps(deviation: Floats, sigma: Floats) -> tuple[Floats, Floats]:
    """Cells that no point fell into although their neighbours' did: the mean of those, on walls that rays graze."""
    known = np.isfinite(deviation).astype(np.float32)
    window = (3, 5)
    share = cv2.blur(known, window, borderType=cv2.BORDER_REPLICATE)
    both = []
    for values in (deviation, sigma):
        mean = cv2.blur(np.nan_to_num(values), window, borderType=cv2.BORDER_REPLICATE) / np.maximum(share, 1e-3)
        both.append(np.where(known > 0, values, np.where(share > 0.34, mean, np.nan)).astype(np.float32))
    return both[0], both[1]
