"""Following the wall: a coarse fit, the pictures resampled onto it, the small shift that is left matched there, and again.

The wall is nearly parallel to the optical axis, so that no window of the pictures has one disparity and the range to be
searched is wide (radius paper, section 4.2). On the predicted wall both troubles are gone.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from estimators.radial_profile.cone import Apex, apex, own_offset_std
from estimators.radial_profile.ends import Ends, wall_ends
from estimators.radial_profile.fit import MAX_HARMONICS, UNEVEN, Wall, WallPoints, refine_wall, search_wall
from estimators.radial_profile.model import CAMERA_AXIS, Axis
from estimators.stereo.coarse import CoarseMatch, coarse_match
from estimators.stereo.on_wall import (
    OUTSIDE,
    WINDOWS,
    EvenPair,
    RowMisfit,
    WallMatch,
    even_pair,
    gain_over,
    likeness_at,
    match_on_wall,
    row_misfit,
    sweep,
    windows_of,
)
from estimators.stereo.rig import StereoRig
from estimators.stereo.unrolled import ANGLES, ROWS, Floats, Unrolled, unroll

_COARSE_POINTS, _SHARED = 4000, 10
_BLOCKS, _BLOCK_SHARE, _FEWEST_BLOCKS = (90, 40), 0.3, 100
_COARSE_GRID = (360, 160)
_COARSE_HARMONICS, _FINE_HARMONICS = (2, 4, 6), (2, 4, 6, MAX_HARMONICS)
_ON_WALL = 0.05
"""A coarse point within this share of the radius lies on the wall when its ends are looked for."""
_EVERY = 4
_FEWEST_POINTS = 0.6
"""Points that a depth of the wall must have for each ray that aims at it."""
_MARGIN_ROWS = 12
"""Rows left out before each end: half of the large window and a little less, since it looks beyond."""
_LEAST_MATCHED, _LEAST_AGREED, _LEAST_TRUSTED, _LEAST_ON_WALL = 0.10, 0.25, 0.20, 0.55
_LEAST_AROUND = 0.5
_LEAST_LENGTH = 0.25
_TOLD = 0.25
"""Share of the band that must be in the picture at an angle for the wall to be fitted there: of less, the picture's edge leaves
the far end alone, and what closes the pipe passes for wall."""
_MOST_PASSES, _MOVED = 4, 0.05
"""Passes over the wall: coarse ones to find it, until an offset that is looked for moves its depths by no more than this share
of them, and a last one, fine, to measure it."""
_SEEN = 0.1
_HEARD = 0.5
"""How much of what the wall's own cone says against the rig's offset is added to that offset's deviation."""
_CONTRADICTION, _DOUBT = 5.0, 3.0
"""Deviations at which the rig's offset is not this pair's, and at which that cannot be told."""

REFUSALS = {
    "no_match": "The two pictures have too little in common: check that both cameras see the pipe, sharp and lit.",
    "no_wall": "Nothing in the pictures rises towards the camera like the wall of a pipe.",
    "too_short": "Too short a piece of the wall is seen: move back, or look along the pipe.",
    "too_smooth": "The wall shows too little texture: turn the projector on or add light.",
    "one_sided": "Less than half of the way around the pipe is seen: look along the pipe.",
    "not_smooth": "What is seen is no pipe of a smooth profile: too much lies off the best surface.",
}
"""Why a pair is refused, and what to do."""


class Refused(Exception):
    """No wall can be told from this pair. ``reason`` is one of REFUSALS."""

    def __init__(self, reason: str) -> None:
        super().__init__(REFUSALS[reason])
        self.reason = reason


@dataclass(frozen=True)
class FollowedWall:
    """The wall of a pair, and what was measured along it.

    ``wall`` is the last fit; ``grid`` the unrolled wall before it, on which ``match`` was made; ``disparity`` (Z, A) px as
    measured; ``ends`` what belongs to the wall; ``cone`` where its lines meet, as this pair alone tells it; ``gain`` (Z, A) by
    how much better the patches agree at the measured disparity than at the wall's own: what speaks for a deviation.
    ``unsure_scale`` where the rig's offset and the wall do not quite agree, so that no length across the pipe can be believed.
    """

    wall: Wall
    grid: Unrolled
    match: WallMatch
    disparity: Floats
    ends: Ends
    cone: Apex
    misfit: RowMisfit
    gain: Floats
    unsure_scale: bool

    @property
    def usable(self) -> NDArray[np.bool_]:
        """Cells (Z, A) with a trusted disparity within the wall's ends."""
        return self.match.trusted & self.ends.inside

    @property
    def coverage(self) -> float:
        """Share of the wall's pixels with a trusted depth. Each cell counts for the pixels that it covers."""
        return self._share(self.match.trusted)

    @property
    def rough(self) -> float:
        """Share of the wall's pixels whose depth only the largest window tells: what is smaller than that is flattened there
        and may not be seen."""
        return self._share(self.match.trusted & (self.match.window == len(WINDOWS) - 1))

    def _share(self, cells: NDArray[np.bool_]) -> float:
        visible = self.ends.inside & self.grid.seen
        pixels = self.grid.pixels
        return float(pixels[visible & cells].sum() / max(float(pixels[visible].sum()), 1e-9))


def follow_wall(left: NDArray[np.uint8], right: NDArray[np.uint8], rig: StereoRig, rng: np.random.Generator) -> FollowedWall:
    """Find the wall in a rectified grey pair (H, W). Raises Refused. Without an offset in ``rig``, or where it contradicts the
    wall, the pair finds its own: the rig of the wall that is found tells."""
    coarse = coarse_match(left, right, rig)
    points = _coarse_points(coarse, rig, rng)
    wall = _coarse_wall(points, rig, rng)
    own_offset = rig.offset_px is None
    if own_offset:
        wall = _coarse_again(points, reread(wall, rig.with_offset(apex(wall, _angles(coarse)).offset_px)))
        rig = wall.rig
    nearest, farthest = _coarse_band(coarse, wall)
    height, width = left.shape
    pair = even_pair(left, right)
    misfit = RowMisfit()
    earlier: tuple[Wall, Unrolled, Floats] | None = None
    coarse_passes = 1
    for turn in range(_MOST_PASSES):
        last = turn == coarse_passes
        grid = pair.shown(unroll(wall, nearest, farthest, *((ANGLES, ROWS) if last else (ANGLES // 2, ROWS // 2))))
        start = _from_coarse(coarse, grid) if earlier is None else _carried(*earlier, grid)
        start = _better_start(pair, grid, start, misfit, width, height)
        if last:
            half = unroll(wall, nearest, farthest, ANGLES // 2, ROWS // 2)
            known = cv2.resize(start, (ANGLES // 2, ROWS // 2), interpolation=cv2.INTER_AREA)
            rough = _from_coarse(coarse, half, smooth=3)
            swept = sweep(pair, half, np.asarray(known, np.float32), misfit, width, height, rig.offset_px or 0.0, (rough,))
            start = np.asarray(cv2.resize(swept, (ANGLES, ROWS), interpolation=cv2.INTER_LINEAR), dtype=np.float32)
        match = match_on_wall(pair, grid, start, misfit, width, height, rig.offset_px or 0.0)
        if turn == 0:
            misfit = row_misfit(pair, grid, match.shift, misfit, width, height)
            match = match_on_wall(pair, grid, match.shift, misfit, width, height, rig.offset_px or 0.0)
        disparity = grid.disparity + match.shift
        ends = _ends(grid, match, disparity, wall)
        before = wall
        counts = _FINE_HARMONICS if turn == 0 else tuple(k for k in _FINE_HARMONICS if 0 <= k - wall.harmonics <= 2)
        wall = _fine_wall(grid, match, disparity, ends, wall, counts)
        cone = apex(wall, grid.theta[(match.trusted & ends.inside).any(axis=0)])
        if last:
            break
        if not own_offset and _contradiction(cone, wall, match, ends) > _CONTRADICTION:
            if turn == 0:  # the first look is a rough one: it does not overrule a calibration
                coarse_passes = 2
            else:
                own_offset = True
        if own_offset:  # a better offset: the same disparities, read as other depths
            std = own_offset_std(cone, wall, around(match, ends))
            wall = _with_offset(wall, cone.offset_px, std, grid, match, disparity, ends)
            moved = abs(cone.offset_px - (rig.offset_px or 0.0)) * float(np.mean(wall.depths)) / rig.range_px_m
            coarse_passes = min(coarse_passes + int(moved > _MOVED), _MOST_PASSES - 1)
            rig = wall.rig
        nearest, farthest = _wider(wall, before, grid, ends)
        earlier = before, grid, disparity
    visible = ends.inside & grid.seen
    trusted = visible & match.trusted
    if trusted.any(axis=0).mean() < _LEAST_AROUND:
        raise Refused("one_sided" if visible.any(axis=0).mean() < _LEAST_AROUND else "too_smooth")
    if trusted.sum() < _LEAST_TRUSTED * visible.sum():
        raise Refused("too_smooth")
    if wall.share < _LEAST_ON_WALL:
        raise Refused("not_smooth")
    length = grid.depth[ends.last - 1] - grid.depth[ends.first]
    if length < _LEAST_LENGTH * float(np.median(wall.radius(grid.theta, np.full(len(grid.theta), np.mean(wall.depths))))):
        raise Refused("too_short")
    own = _met(wall, grid)[0] - grid.disparity
    gain = gain_over(own, pair, grid, match, misfit, width, height)
    unsure = not own_offset and _contradiction(cone, wall, match, ends) > _DOUBT
    if not own_offset:  # what this wall says of the offset is no calibration, yet it is heard
        heard = float(np.hypot(rig.offset_std_px, _HEARD * (cone.offset_px - (rig.offset_px or 0.0))))
        wall = replace(wall, rig=rig.with_offset(rig.offset_px or 0.0, heard))
    return FollowedWall(wall, grid, match, disparity, ends, cone, misfit, gain, unsure)


def around(match: WallMatch, ends: Ends) -> float:
    """Share of the way around the pipe at which a tenth of the band or more was measured."""
    return float(np.mean((match.trusted & ends.inside).sum(axis=0) > _SEEN * (ends.last - ends.first)))


def _contradiction(cone: Apex, wall: Wall, match: WallMatch, ends: Ends) -> float:
    """How many deviations more conical the rig's offset makes this wall than a pipe is."""
    own = own_offset_std(cone, wall, around(match, ends))
    return abs(cone.offset_px - (wall.rig.offset_px or 0.0)) / float(np.hypot(own, wall.rig.offset_std_px))


def _met(wall: Wall, grid: Unrolled) -> tuple[Floats, Floats]:
    """Disparity (Z, A) px at which the rays of a grid, unrolled on a wall near by, meet ``wall``, and the angle (rad) about its
    axis less the grid's. Both walls are smooth: solved for every fourth cell either way."""
    rows, columns = grid.u.shape
    size = columns // _EVERY, rows // _EVERY
    u, v, there = (
        np.asarray(cv2.resize(np.ascontiguousarray(values), size, interpolation=cv2.INTER_AREA), dtype=np.float64)
        for values in (grid.u, grid.v, grid.disparity)
    )
    offset = wall.rig.offset_px or 0.0
    depth = wall.meet(u, v, wall.rig.range_px_m / np.maximum(there - offset, 1e-3), 3)
    theta = grid.theta.reshape(-1, _EVERY).mean(axis=1)
    turned = np.angle(np.exp(1j * (wall.about(u, v, depth)[0] - theta)))
    moved = offset + wall.rig.range_px_m / depth - there
    full = [
        np.asarray(cv2.resize(values.astype(np.float32), (columns, rows), interpolation=cv2.INTER_LINEAR), dtype=np.float32)
        for values in (moved, turned)
    ]
    return full[0] + grid.disparity, full[1]


def _angles(coarse: CoarseMatch) -> NDArray[np.float64]:
    """Angles at which something rises, a degree apart."""
    counts = np.bincount(((coarse.theta[coarse.rising] + np.pi) * (180 / np.pi)).astype(np.int64).clip(0, 359), minlength=360)
    return np.asarray((np.flatnonzero(counts > 5) + 0.5) * (np.pi / 180) - np.pi, dtype=np.float64)


def _coarse_points(coarse: CoarseMatch, rig: StereoRig, rng: np.random.Generator) -> WallPoints:
    """Some of what rises like a wall."""
    rising = np.flatnonzero(coarse.rising.ravel())
    if np.isfinite(coarse.disparity).mean() < _LEAST_MATCHED:
        raise Refused("no_match")
    if len(rising) < 0.02 * coarse.rising.size:
        raise Refused("no_wall")
    chosen = rng.choice(rising, min(_COARSE_POINTS, len(rising)), replace=False)
    theta, rho, disparity = (
        values.ravel()[chosen].astype(np.float64) for values in (coarse.theta, coarse.rho, coarse.disparity)
    )
    return WallPoints(theta, rho, disparity, np.full(len(theta), 0.3 * rig.intrinsics.width / 1920))


def _coarse_wall(points: WallPoints, rig: StereoRig, rng: np.random.Generator) -> Wall:
    found = search_wall(points, rig, rng)
    if found is None or found[1] < _LEAST_AGREED:
        raise Refused("no_wall")
    # in steps: each fit shows the next one which points belong to the wall
    return _coarse_fit(points, found[0], rig, _COARSE_HARMONICS)


def _coarse_again(points: WallPoints, wall: Wall) -> Wall:
    """The coarse wall under another offset: eq. 17 fits it as well, so nothing has to be searched again."""
    return _coarse_fit(points, wall.coefficients, wall.rig, (wall.harmonics,), wall.axis, near=True)


def _coarse_fit(
    points: WallPoints,
    start: NDArray[np.float64],
    rig: StereoRig,
    counts: tuple[int, ...],
    axis: Axis = CAMERA_AXIS,
    near: bool = False,
) -> Wall:
    unit = rig.intrinsics.width / 1920
    try:
        return refine_wall(points, start, rig, counts, 3.0 * unit, len(points.theta) / _SHARED, 0.7 * unit, axis, near)
    except np.linalg.LinAlgError as error:
        raise Refused("no_wall") from error


def _coarse_band(coarse: CoarseMatch, wall: Wall) -> tuple[float, float]:
    """The depths (m) between which the coarse disparities lie on the coarse wall, a little widened."""
    nearest, farthest = wall.depths
    nearest, farthest = 0.7 * nearest, 1.5 * farthest
    grid = unroll(wall, nearest, farthest, *_COARSE_GRID)
    away = _from_coarse(coarse, grid, 1.0)
    known = np.isfinite(away) & grid.seen
    unit = wall.rig.intrinsics.width / 1920
    shift = grid.disparity - (wall.rig.offset_px or 0.0)
    on = known & (np.abs(away) < _ON_WALL * shift + 2.0 * unit)
    ends = wall_ends(on, known & ~on, grid.seen, 2)
    if ends is None:
        raise Refused("no_wall")
    first, last = float(grid.depth[ends.first]), float(grid.depth[ends.last - 1])
    spare = 0.08 * (last - first)
    return max(first - spare, nearest), min(last + spare, farthest)


def _from_coarse(coarse: CoarseMatch, grid: Unrolled, reach: float = 0.6, smooth: int = 9) -> Floats:
    """Where to begin on the wall: what the coarse match saw there, as a shift (px); 0 where it saw nothing (nan for reach 1).

    ``reach``: a coarse shift beyond this share of the disparity is none.
    """
    half = np.float32((coarse.step_px - 1) / 2)
    x, y = ((values - half) / np.float32(coarse.step_px) for values in (grid.x, grid.y))
    seen = cv2.remap(coarse.disparity, x, y, cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT, borderValue=(float("nan"),))
    shift = np.asarray(seen - grid.disparity, dtype=np.float32)
    if reach >= 1.0:
        return shift
    shift[~(np.abs(shift) < reach * grid.disparity)] = 0.0
    return np.asarray(cv2.blur(shift, (smooth, smooth)), dtype=np.float32)


def _better_start(pair: EvenPair, grid: Unrolled, start: Floats, misfit: RowMisfit, width: int, height: int) -> Floats:
    """``start`` where the patches agree better there than on the predicted wall, else 0: a wrong coarse match is not
    followed."""
    there, here = (likeness_at(pair, grid, tried, misfit, width, height) for tried in (start, np.zeros_like(start)))
    return np.where(there > here, start, 0.0).astype(np.float32)


def _carried(wall: Wall, grid: Unrolled, disparity: Floats, other: Unrolled) -> Floats:
    """Shifts (px) on another unrolled wall that mean the disparities measured on ``grid``, which was unrolled on ``wall``."""
    met, turned = _met(wall, other)
    depth = wall.rig.range_px_m / (met - np.float32(wall.rig.offset_px or 0.0))
    row = grid.row_of(depth).astype(np.float32)
    column = ((other.theta + turned + np.pi) / grid.cell[1] - 0.5).astype(np.float32)
    shift = cv2.remap(disparity, column, row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE) - other.disparity
    beyond = (row < 0) | (row > len(grid.depth) - 1)
    return np.where(beyond, 0.0, shift).astype(np.float32)


def _ends(grid: Unrolled, match: WallMatch, disparity: Floats, wall: Wall) -> Ends:
    """The wall's ends from the points at their own depths: behind the last of them, and before the first, there are none.

    (By the rays alone a cloth at the far end would pass for wall a little way beyond, since it is nearly where the wall would
    be.)
    """
    known = match.trusted
    rig, shape = wall.rig, disparity.shape
    unit = rig.intrinsics.width / 1920
    allowed = 3.0 * np.hypot(max(wall.noise_px, 0.4 * unit), UNEVEN * (grid.disparity - (rig.offset_px or 0.0)))
    on = known & (np.abs(disparity - _met(wall, grid)[0]) < allowed)
    row = np.floor(grid.row_of(rig.depth(disparity.astype(np.float64))) + 0.5)
    lands = known & (row >= 0) & (row < shape[0])
    column = np.broadcast_to(np.arange(shape[1]), shape)

    def landed(chosen: NDArray[np.bool_]) -> Floats:
        place = row[chosen].astype(np.int64) * shape[1] + column[chosen]
        return np.bincount(place, minlength=disparity.size).reshape(shape).astype(np.float32)

    points_on, points_off = landed(lands & on), landed(lands & ~on)
    window = (31, 5) if grid.fineness == 1.0 else (15, 3)
    missing = cv2.blur(known.astype(np.float32), window) * _FEWEST_POINTS - cv2.blur(points_on + points_off, window)
    ends = wall_ends(points_on, points_off + np.maximum(missing, 0) * 2, grid.seen, round(_MARGIN_ROWS * grid.fineness))
    if ends is None:
        smooth = np.count_nonzero(known) < _LEAST_TRUSTED * np.count_nonzero(match.state != OUTSIDE)
        raise Refused("too_smooth" if smooth else "no_wall")
    return ends


def _fine_wall(
    grid: Unrolled,
    match: WallMatch,
    disparity: Floats,
    ends: Ends,
    start: Wall,
    counts: tuple[int, ...],
    near: bool = False,
) -> Wall:
    """The wall through the means of blocks of cells, each about a window: what their cells know beyond that they share."""
    told = grid.seen[ends.first : ends.last].mean(axis=0) >= _TOLD
    trusted = (match.trusted & ends.inside & told).astype(np.float32)
    if np.count_nonzero(trusted) < 500 * grid.fineness**2:
        raise Refused("too_smooth")
    share = _block_means(trusted)
    full = share > _BLOCK_SHARE
    if np.count_nonzero(full) < _FEWEST_BLOCKS:
        raise Refused("too_smooth")
    sizes = [across * along for across, along in windows_of(grid)]
    known = np.asarray([sizes[0] / size for size in sizes], dtype=np.float32)[match.window]
    u, v, measured, noise, own = (
        (_block_means(trusted * values)[full] / share[full]).astype(np.float64)
        for values in (grid.u, grid.v, disparity, match.sigma, known)
    )
    points = WallPoints(np.arctan2(v, u), np.hypot(u, v) * start.rig.focal_px, measured, noise)
    independent = float(np.sum(own))
    unit = start.rig.intrinsics.width / 1920
    try:
        return refine_wall(
            points,
            start.coefficients,
            start.rig,
            counts,
            max(start.noise_px, 0.5 * unit),
            independent,
            0.1 * unit,
            start.axis,
            near,
        )
    except np.linalg.LinAlgError as error:
        raise Refused("no_wall") from error


def _block_means(values: Floats) -> Floats:
    return np.asarray(cv2.resize(values, _BLOCKS, interpolation=cv2.INTER_AREA), dtype=np.float32)


def _with_offset(
    wall: Wall,
    offset_px: float,
    std_px: float,
    grid: Unrolled,
    match: WallMatch,
    disparity: Floats,
    ends: Ends,
) -> Wall:
    """The wall again under another offset."""
    start = reread(wall, wall.rig.with_offset(offset_px, std_px))
    return _fine_wall(grid, match, disparity, ends, start, (wall.harmonics,), near=True)


def reread(wall: Wall, rig: StereoRig) -> Wall:
    """The same disparities of a wall as depths by another offset: with Z' = f b / (d - o) the same cone has the radius
    c + (s + c error / (f b)) Z, see cone.py."""
    turn = ((rig.offset_px or 0.0) - (wall.rig.offset_px or 0.0)) / wall.rig.range_px_m
    constant, slope = _split(wall.coefficients)
    old = wall.axis
    axis = replace(old, right=old.right + old.x * turn, down=old.down + old.y * turn)
    return replace(wall, coefficients=_joined(constant, slope + constant * turn), rig=rig, axis=axis)


def _split(coefficients: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    waves = coefficients[2:].reshape(-1, 4)
    return np.r_[coefficients[0], waves[:, :2].ravel()], np.r_[coefficients[1], waves[:, 2:].ravel()]


def _joined(constant: NDArray[np.float64], slope: NDArray[np.float64]) -> NDArray[np.float64]:
    waves = np.concatenate([constant[1:].reshape(-1, 2), slope[1:].reshape(-1, 2)], axis=1)
    return np.asarray(np.r_[constant[0], slope[0], waves.ravel()], dtype=np.float64)


def _wider(wall: Wall, before: Wall, grid: Unrolled, ends: Ends) -> tuple[float, float]:
    """The band of the next pass: what was wall, and a tenth more at either end. Depths of ``before`` are read as ``wall``'s."""
    old, new = before.rig, wall.rig
    depth = np.array([grid.depth[ends.first], grid.depth[ends.last - 1]])
    first, last = new.depth((old.offset_px or 0.0) + old.range_px_m / depth)
    spare = 0.1 * (last - first)
    return max(float(first - spare), 0.05), float(last + spare)
