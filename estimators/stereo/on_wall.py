"""Matching on the predicted wall: both pictures are resampled onto it, and only the small shift that is left is looked for.

On the unrolled wall the expected shift is near zero and texture has one scale, so that a window means the same patch of wall
everywhere. The shift along the rows is found by least squares on brightness (Lucas and Kanade) over windows of three sizes:
the smallest where the texture carries it, a larger one where it does not. Least squares also says how well it is known: sigma =
noise / sqrt(sum of squared gradients), with the noise from what is left between the pictures.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from estimators.stereo.unrolled import Floats, Unrolled

NORMAL_WIDTH = 960
"""Width (px) of the pictures that are resampled: texture finer than that is noise in common lenses."""
_EVEN_WINDOW = 31
_DARK = 4.0
_BLANK = 3.0
"""Rows and columns at a picture's edge with nothing brighter than this hold no picture."""
WINDOWS = (17, 5), (27, 11), (41, 21)
"""Windows, in cells of the finest grid: around the pipe, along it. The smallest whose texture carries the shift answers. They
are short along it: a camera that looks along the wall sees what is as long as wide foreshortened, most of all a hole."""
_SMOOTHING = 5, 3
"""Cells over which the pictures are smoothed where the largest windows are asked whether the wall is here or there. They tell
it where noise is as strong as texture: white noise falls to a quarter, texture, which is as coarse as the wall is smooth,
hardly."""
_MEDIAN = 3
_ITERATIONS = 2
_SWEEP = (0.03, 0.06, 0.09, 0.12, 0.16, 0.2, 0.25, 0.3, -0.03, -0.06, -0.09, -0.12)
"""Shares by which a disparity is tried to be larger or smaller than the wall's. In these steps texture moves by about its
grain: both grow as the wall comes nearer."""
_CLEARLY, _MARGIN = 0.4, (0.12, 0.5)
"""By how much the correlation of patches must be better there: so much over the root of their independent pixels."""
_PLAIN = 0.3
"""Mean square of an evened patch below which it tells little: noise on an even grey is alike by chance."""
_STEP_PX = 2.0
_REACH_PX = 4.0
TRUST_PX = 1.0
"""Largest sigma of a trusted disparity, at 1920 pixels of width."""
_TRUST_SHARE = 0.02
"""Largest sigma of a trusted disparity as a share of it (less the offset), which is that of the radius it tells."""
_ALIKE = 0.5, 0.4, 0.3
"""Smallest correlation of the two patches of a trusted match, for each window: noise alone, moved to where it fits best,
reaches half of it."""
_TEXTURE = 0.6
"""Mean square of an evened patch that is texture rather than noise on an even grey."""
_INDEPENDENT = 0.12
"""Noise that neighbouring pixels do not share, as a share of the pixels: demosaicing, compression and resampling spread it. So
that the deviations of a smooth test pipe are as large as their sigmas say."""

TRUSTED, OUTSIDE, SMOOTH, OCCLUDED = range(4)
"""What became of a cell: a trusted shift; not in both pictures; too little texture (many shifts fit as well); none fits."""


@dataclass(frozen=True)
class EvenPair:
    """Both pictures (h, w) at about ``NORMAL_WIDTH``, every neighbourhood at mean 0 and deviation 1, and the right one's
    gradients. ``step`` is the width of a pixel in pixels of the original; ``part`` the rows and columns that hold a picture in
    both."""

    left: Floats
    right: Floats
    along: Floats
    down: Floats
    step: float
    part: tuple[slice, slice]

    def shown(self, grid: Unrolled) -> Unrolled:
        """``grid`` with nothing seen in the margins."""
        seen = grid.seen.copy()
        for place, within in zip((grid.y, grid.x), self.part, strict=True):
            seen &= (place >= self.step * within.start) & (place < self.step * within.stop)
        return replace(grid, seen=seen)


@dataclass(frozen=True)
class WallMatch:
    """Shifts on an unrolled wall, all (Z, A): ``shift`` (px, measured less predicted disparity), its ``sigma`` (px), ``alike``
    the correlation of the patches, ``window`` which of WINDOWS answered, and ``state`` (TRUSTED, OUTSIDE, SMOOTH, OCCLUDED)."""

    shift: Floats
    sigma: Floats
    alike: Floats
    window: NDArray[np.uint8]
    state: NDArray[np.uint8]

    @property
    def trusted(self) -> NDArray[np.bool_]:
        """Where a shift can be believed."""
        return np.asarray(self.state == TRUSTED, dtype=np.bool_)


@dataclass(frozen=True)
class RowMisfit:
    """How far the right picture sits too low, in pixels: a + b x + c y + d x y, with x and y in half widths off the centre.

    Rectification leaves some pixels, more where the two lenses magnify differently; matching along rows cannot see them.
    """

    terms: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)

    def at(self, x: Floats, y: Floats, width: int, height: int) -> Floats:
        """Pixels at positions of the left picture."""
        u, v = (x - width / 2) / (width / 2), (y - height / 2) / (width / 2)
        a, b, c, d = self.terms
        return np.asarray(a + b * u + c * v + d * u * v, dtype=np.float32)


def even_pair(left: NDArray[np.uint8], right: NDArray[np.uint8]) -> EvenPair:
    """Prepare a grey pair (H, W)."""
    factor = max(1, round(left.shape[1] / NORMAL_WIDTH))
    size = left.shape[1] // factor, left.shape[0] // factor

    small = [cv2.resize(picture, size, interpolation=cv2.INTER_AREA).astype(np.float32) for picture in (left, right)]
    part = _pictured(np.minimum(*small))

    def even(whole: Floats) -> Floats:
        evened, grey = np.zeros_like(whole), np.ascontiguousarray(whole[part])
        window = (_EVEN_WINDOW, _EVEN_WINDOW)
        mean = cv2.blur(grey, window)
        variance = np.maximum(cv2.blur(grey * grey, window) - mean * mean, 0) + _DARK**2
        evened[part] = (grey - mean) / np.sqrt(variance)
        return evened

    one, other = (even(picture) for picture in small)
    along = cv2.Sobel(other, cv2.CV_32F, 1, 0, ksize=3, scale=1 / 8)
    down = cv2.Sobel(other, cv2.CV_32F, 0, 1, ksize=3, scale=1 / 8)
    return EvenPair(one, other, np.asarray(along, np.float32), np.asarray(down, np.float32), left.shape[1] / size[0], part)


def _pictured(grey: Floats) -> tuple[slice, slice]:
    """The rows and columns of a picture that hold one. Shifted and rectified pictures have black margins, often one of a pair
    alone: their edges would be texture without a partner."""
    parts = []
    for axis, length in enumerate(grey.shape):
        bright = np.flatnonzero(grey.max(axis=1 - axis) > _BLANK)
        first, last = (int(bright[0]), int(bright[-1]) + 1) if len(bright) else (0, length)
        if last - first < length // 2:
            return slice(0, grey.shape[0]), slice(0, grey.shape[1])  # a black picture with some bright pixels
        # beside a margin the first row is half of it, since pictures are made smaller and compressed
        parts.append(slice(first + (first > 0), last - (last < length)))
    return parts[0], parts[1]


def match_on_wall(
    pair: EvenPair, grid: Unrolled, start: Floats, misfit: RowMisfit, width: int, height: int, offset_px: float
) -> WallMatch:
    """Find the shift of every cell of ``grid``, beginning at ``start`` (px), for pictures of ``width`` x ``height`` px."""
    own = _independent(grid, pair)
    limit = np.minimum(TRUST_PX * width / 1920, _TRUST_SHARE * (grid.disparity - offset_px)).astype(np.float32)
    lift = misfit.at(grid.x, grid.y, width, height)
    left = _sampled(pair.left, grid.x, grid.y, pair.step)
    shift, windows = start, windows_of(grid)
    patches = _Patches(left, windows)
    for _ in range(_ITERATIONS):
        tried = _least_squares(patches, *_right(pair, grid, shift, lift), own, pair.step)
        step = tried[-1].step
        for finer, least in zip(tried[-2::-1], _ALIKE[-2::-1], strict=True):
            step = np.where(_carries(finer, least, limit), finer.step, step)
        moved = np.clip(shift + np.clip(step, -_STEP_PX, _STEP_PX), start - _REACH_PX, start + _REACH_PX)
        shift = np.asarray(cv2.medianBlur(np.ascontiguousarray(moved, dtype=np.float32), 5), dtype=np.float32)
    tried = _least_squares(patches, *_right(pair, grid, shift, lift), own, pair.step)
    chosen = np.full(shift.shape, len(windows), np.uint8)
    for number in reversed(range(len(windows))):
        chosen[_carries(tried[number], _ALIKE[number], limit)] = number
    # texture that finds no partner is hidden from the other camera; without texture, unlike patches say nothing
    state = np.where(chosen < len(windows), TRUSTED, np.where(tried[0].texture > _TEXTURE, OCCLUDED, SMOOTH)).astype(np.uint8)
    chosen = np.minimum(chosen, np.uint8(len(windows) - 1))
    lonely = cv2.morphologyEx((state == TRUSTED).astype(np.uint8), cv2.MORPH_OPEN, np.ones(windows[0][::-1], np.uint8)) == 0
    state[lonely & (state == TRUSTED)] = SMOOTH
    state[~grid.seen | (grid.x - grid.disparity - shift < 2)] = OUTSIDE
    sigma = _answer_of(chosen, [window.sigma for window in tried])
    return WallMatch(shift, sigma, _answer_of(chosen, [window.alike for window in tried]), chosen, state)


def _answer_of(chosen: NDArray[np.uint8], answers: list[Floats]) -> Floats:
    """Of one answer (Z, A) for each of WINDOWS the one of the window that was chosen."""
    found = answers[-1]
    for number, answer in enumerate(answers[:-1]):  # several times faster than numpy's choose
        found = np.where(chosen == number, answer, found)
    return found


def likeness_at(pair: EvenPair, grid: Unrolled, shift: Floats, misfit: RowMisfit, width: int, height: int) -> Floats:
    """Correlation of the largest patches, were the shift ``shift`` (px): how well another answer would do."""
    lift = misfit.at(grid.x, grid.y, width, height)
    left, right = _sampled(pair.left, grid.x, grid.y, pair.step), _right(pair, grid, shift, lift)[0]
    return _Patches(left, windows_of(grid)[-1:]).beside(right)[0].alike()


def gain_over(
    other: Floats, pair: EvenPair, grid: Unrolled, match: WallMatch, misfit: RowMisfit, width: int, height: int
) -> Floats:
    """By how much more alike the patches are, each in the window that answered, at the shifts of ``match`` than at ``other``
    (px); the largest of smoothed pictures."""
    lift, windows, smoothing = misfit.at(grid.x, grid.y, width, height), windows_of(grid), _odd(grid, _SMOOTHING)
    left = _sampled(pair.left, grid.x, grid.y, pair.step)
    there, here = (_right(pair, grid, shift, lift)[0] for shift in (match.shift, other))
    fine, rough = _Patches(left, windows[:-1]), _Patches(_blurred(left, smoothing), windows[-1:])
    gains = [match.alike - both.alike() for both in fine.beside(here)]
    largest = [rough.beside(_blurred(right, smoothing))[0].alike() for right in (there, here)]
    return _answer_of(match.window, [*gains, largest[0] - largest[1]])


def sweep(
    pair: EvenPair,
    grid: Unrolled,
    first: Floats,
    misfit: RowMisfit,
    width: int,
    height: int,
    offset_px: float,
    also: tuple[Floats, ...] = (),
) -> Floats:
    """Where to begin (px): at ``first``, or at one of some distances before and behind the wall, or at one of ``also``, where
    patches agree clearly better, small ones if they tell, else large ones. What stands out by more than the texture's grain is
    otherwise never reached."""
    lift = misfit.at(grid.x, grid.y, width, height)
    left = _sampled(pair.left, grid.x, grid.y, pair.step)
    shift = grid.disparity - np.float32(offset_px)
    own, windows = _independent(grid, pair), windows_of(grid)
    patches, tries = _Patches(left, windows), [_Try(left.shape, window, own) for window in windows]
    starts = [first, np.zeros_like(first), *also]
    for number in range(len(starts) + len(_SWEEP)):
        start = starts[number] if number < len(starts) else _SWEEP[number - len(starts)] * shift
        start = np.asarray(start, dtype=np.float32)
        right = _sampled(pair.right, grid.x - grid.disparity - start, grid.y - lift, pair.step)
        for one, both in zip(tries, patches.beside(right), strict=True):
            one.put(start, both.alike(_PLAIN))
    found = first
    for one in reversed(tries):  # what a smaller patch is sure of counts
        found = np.where(one.sure, one.found, found)
    return np.asarray(cv2.medianBlur(np.ascontiguousarray(found, dtype=np.float32), _MEDIAN), dtype=np.float32)


class _Try:
    """The best of several starts, by how well patches of one size agree. The first start is to be beaten clearly."""

    def __init__(self, shape: tuple[int, ...], window: tuple[int, int], own: Floats) -> None:
        self._ahead = np.clip(_CLEARLY / np.sqrt(window[0] * window[1] * own), *_MARGIN)
        self._first: Floats | None = None
        self._best = np.full(shape, -1.0, np.float32)
        self.found = np.zeros(shape, np.float32)

    def put(self, start: Floats, alike: Floats) -> None:
        """How well patches agree where ``start`` (px) puts the wall."""
        if self._first is None:
            self._first = alike
        better = alike > self._best
        self._best[better], self.found[better] = alike[better], start[better]

    @property
    def sure(self) -> NDArray[np.bool_]:
        """Where the best start agrees clearly better than the first."""
        first = 0.0 if self._first is None else self._first
        return np.asarray(self._best > first + self._ahead, dtype=np.bool_)


def _independent(grid: Unrolled, pair: EvenPair) -> Floats:
    """Independent values in each cell."""
    cell = _INDEPENDENT * (grid.fineness / pair.step) ** 2 * grid.pixels
    return np.asarray(np.clip(cell, 0.005, 0.18) / grid.fineness**2, dtype=np.float32)


def windows_of(grid: Unrolled) -> list[tuple[int, int]]:
    """WINDOWS in cells of ``grid``, odd: the same patch of wall on every grid."""
    return [_odd(grid, window) for window in WINDOWS]


def _odd(grid: Unrolled, window: tuple[int, int]) -> tuple[int, int]:
    across, along = (2 * round((cells * grid.fineness - 1) / 2) + 1 for cells in window)
    return across, along


def row_misfit(pair: EvenPair, grid: Unrolled, shift: Floats, before: RowMisfit, width: int, height: int) -> RowMisfit:
    """A better estimate of how far the right picture sits too low, from patches of the wall matched in both directions."""
    lift = before.at(grid.x, grid.y, width, height)
    left = _sampled(pair.left, grid.x, grid.y, pair.step)
    right, along = _right(pair, grid, shift, lift)
    down = _sampled(pair.down, grid.x - grid.disparity - shift, grid.y - lift, pair.step)
    some = [max(round(cells * grid.fineness), 1) for cells in (24, 32)]
    every, window = (slice(some[0] // 2, None, some[0]), slice(some[1] // 2, None, some[1])), (some[1] + 9, some[0] + 7)

    def mean(values: Floats) -> NDArray[np.float64]:
        return cv2.blur(values, window)[every].astype(np.float64)

    rest = left - right
    xx, xy, yy = mean(along * along), mean(along * down), mean(down * down)
    xr, yr = mean(along * rest), mean(down * rest)
    determinant = xx * yy - xy * xy
    lower = -(xx * yr - xy * xr) / (determinant + 1e-9) * pair.step
    weight = np.where(grid.seen[every] & (np.abs(lower) < 3.0 * pair.step), determinant / (xx + 1e-9), 0.0).ravel()
    u = ((grid.x[every] - width / 2) / (width / 2)).ravel().astype(np.float64)
    v = ((grid.y[every] - height / 2) / (width / 2)).ravel().astype(np.float64)
    rows, wanted = np.stack([np.ones_like(u), u, v, u * v], axis=1), lower.ravel()
    damping = np.diag([1e-6, 1e-3, 1e-3, 1e-3]) * max(float(weight.sum()), 1e-9)
    kept = weight
    correction = np.zeros(4)
    for _ in range(6):
        correction[:] = np.linalg.solve((rows * kept[:, None]).T @ rows + damping, rows.T @ (wanted * kept))
        kept = weight / (1.0 + ((wanted - rows @ correction) / 0.3) ** 2)
    a, b, c, d = (float(old + new) for old, new in zip(before.terms, correction, strict=True))
    return RowMisfit((a, b, c, d))


def _right(pair: EvenPair, grid: Unrolled, shift: Floats, lift: Floats) -> tuple[Floats, Floats]:
    """The right picture and its gradient along the rows, where ``shift`` puts the wall."""
    x, y = grid.x - grid.disparity - shift, grid.y - lift
    return _sampled(pair.right, x, y, pair.step), _sampled(pair.along, x, y, pair.step)


def _sampled(picture: Floats, x: Floats, y: Floats, step: float) -> Floats:
    half = np.float32((step - 1) / 2)
    scale = np.float32(1 / step)
    found = cv2.remap(picture, (x - half) * scale, (y - half) * scale, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
    return np.asarray(found, dtype=np.float32)


def _blurred(values: Floats, window: tuple[int, int]) -> Floats:
    return np.asarray(cv2.blur(values, window), dtype=np.float32)


@dataclass(frozen=True)
class _Beside:
    """Means over the patches about each cell, for one window: of the left picture, of the right one, and of their products."""

    left: Floats
    right: Floats
    left_square: Floats
    right_square: Floats
    both: Floats

    def alike(self, plain: float = 0.0) -> Floats:
        """Correlation of the patches; ``plain``: what is added to their mean squares."""
        one = self.left_square - self.left * self.left
        other = self.right_square - self.right * self.right
        if plain:
            one, other = one + np.float32(plain), other + np.float32(plain)
        spread = np.sqrt(np.maximum(one * other, np.float32(1e-6)))
        return np.asarray((self.both - self.left * self.right) / spread, dtype=np.float32)

    @property
    def left_over(self) -> Floats:
        """Mean square of what differs."""
        different = self.left_square + self.right_square - 2 * self.both
        return np.asarray(np.maximum(different, 1e-6), dtype=np.float32)


class _Patches:
    """The patches of the left picture in windows of several sizes: what is asked of them again and again is kept."""

    def __init__(self, left: Floats, windows: list[tuple[int, int]]) -> None:
        square = left * left
        self.picture, self.windows = left, windows
        self._left = [(_blurred(left, window), _blurred(square, window)) for window in windows]

    def beside(self, right: Floats) -> list[_Beside]:
        """Beside those of the right picture, for each window."""
        square, both = right * right, self.picture * right
        return [
            _Beside(left, _blurred(right, window), left_square, _blurred(square, window), _blurred(both, window))
            for window, (left, left_square) in zip(self.windows, self._left, strict=True)
        ]


@dataclass(frozen=True)
class _Window:
    """What one window tells of every cell: the step of the shift (px), its sigma (px), how alike the patches are, and the mean
    square of the left one."""

    step: Floats
    sigma: Floats
    alike: Floats
    texture: Floats


def _carries(window: _Window, alike: float, limit: Floats) -> NDArray[np.bool_]:
    """Where a window's texture tells the shift well enough to be trusted."""
    return (window.sigma <= limit) & (window.alike >= alike)


def _least_squares(patches: _Patches, right: Floats, along: Floats, own: Floats, step: float) -> list[_Window]:
    """The right picture moves along its rows to meet the left, in each window. ``own``: independent values of a cell."""
    steep, pulled = along * along, along * (right - patches.picture)
    answers = []
    for window, both in zip(patches.windows, patches.beside(right), strict=True):
        energy = _blurred(steep, window) + np.float32(1e-5)
        alike = both.alike()
        # of the gradients only the part that both pictures share is texture, the rest is noise that fits nothing
        shared = energy * np.clip(alike, np.float32(0.05), np.float32(1.0))
        sigma = np.sqrt(both.left_over / (shared * (own * np.float32(window[0] * window[1])))) * np.float32(step)
        move = _blurred(pulled, window) / energy * np.float32(step)
        answers.append(_Window(move, np.asarray(sigma, np.float32), alike, both.left_square))
    return answers
