"""Lenses and places of two cameras from views of a board, how well they are known, and why views are not enough.

The method is Zhang's as OpenCV has it (calibrateCamera, stereoCalibrate). What is added is doubt: views that disagree with the
others are left out by name, and the whole is computed again without each fifth of the views (a delete-group jackknife), whose
spread says how far a disparity and the baseline may be off.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from estimators.board.board import Board, Sighting
from estimators.board.coverage import coverage
from estimators.pinhole import Intrinsics, LensPair, deproject_pixels, matrix_of, project_rays, rectified

Floats = NDArray[np.float64]

LEAST_VIEWS = 12
LEAST_CORNERS = 8
"""Corners that both cameras must see for a view to count."""
LEAST_COVERED = 0.75
LEAST_TILTS = 2
LARGEST_BLUR = 1.8
"""Blur of edges (px), and the errors below, in pictures of REFERENCE_WIDTH; wider pictures may have more."""
LARGEST_REPROJECTION = 0.6
LARGEST_EPIPOLAR = 0.5
LARGEST_OFFSET_STD = 0.5
LARGEST_SCALE_STD = 0.01
REFERENCE_WIDTH = 1280
BOARD_STD = 0.002
"""How well the size of a printed board is known: half a millimetre in 25 cm."""
_ODD, _ODD_LEAST_PX = 3.0, 0.3
"""A view whose error is so many times the median, and more than so many pixels, disagrees with the others."""
_MOST_ODD = 0.25
_GROUPS = 5
_BETTER = 0.97
"""A sixth-order term of the distortion is taken where it brings the error below this share."""
_FINE = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 60, 1e-9)


class NotEnough(Exception):
    """These views make no calibration that could be trusted. The text is one sentence for the operator."""


@dataclass(frozen=True)
class View:
    """One pair of pictures with the board in it."""

    name: str
    left: Sighting
    right: Sighting

    @property
    def common(self) -> tuple[NDArray[np.int64], Floats, Floats]:
        """(ids, left pixels, right pixels) of the corners that both saw."""
        ids, left, right = np.intersect1d(self.left.ids, self.right.ids, return_indices=True)
        return ids, self.left.pixels[left], self.right.pixels[right]

    def shows_enough(self, board: Board) -> bool:
        """Whether both cameras see enough corners, and not all of them on one line: that tells nothing of a lens."""
        ids = self.common[0]
        rows, columns = np.divmod(ids, board.columns - 1)
        return len(ids) >= LEAST_CORNERS and min(len(np.unique(rows)), len(np.unique(columns))) >= 2


@dataclass(frozen=True)
class PairCalibration:
    """Both lenses. ``reprojection_px`` is the rms distance of corners from where they should be seen, ``epipolar_px`` the rms
    difference of their rows after rectification; ``offset_std_px`` and ``scale_std`` how well disparities and the baseline are
    known; ``views`` those it is from, ``left_out`` those that disagree, with their errors (px)."""

    lenses: LensPair
    reprojection_px: float
    epipolar_px: float
    offset_std_px: float
    scale_std: float
    views: tuple[str, ...]
    left_out: tuple[tuple[str, float], ...]


def too_blurred(view: View, size: tuple[int, int]) -> bool:
    """Whether a view is out of focus, or was taken in motion."""
    return max(view.left.blur_px, view.right.blur_px) > LARGEST_BLUR * _wider(size)


def calibrate_pair(board: Board, views: Sequence[View], size: tuple[int, int]) -> PairCalibration:
    """Both lenses from ``views`` in pictures of ``size``. Raises NotEnough."""
    usable = _usable(board, views, size)
    solved = _solve(board, usable, size)
    errors = _view_errors(board, usable, solved)
    odd = errors > max(_ODD * float(np.median(errors)), _ODD_LEAST_PX * _wider(size))
    left_out = [(view.name, float(error)) for view, error, out in zip(usable, errors, odd, strict=True) if out]
    if left_out:
        named = ", ".join(f"{name} ({error:.1f} px)" for name, error in left_out)
        if len(left_out) > _MOST_ODD * len(usable):
            raise NotEnough(f"Too many views disagree with the others: {named}; was the board bent, or did a camera move?")
        usable = [view for view, out in zip(usable, odd, strict=True) if not out]
        try:
            _check_views(board, usable, size)
        except NotEnough as error:
            raise NotEnough(f"{error} Left out, since they disagree with the others: {named}.") from None
        solved = _solve(board, usable, size)
        errors = _view_errors(board, usable, solved)
    reprojection, epipolar = float(np.sqrt(np.mean(errors**2))), _epipolar(usable, solved)
    if reprojection > LARGEST_REPROJECTION * _wider(size):
        raise NotEnough(
            f"The corners lie {reprojection:.2f} px off where they should: see that the board is flat, and of the stated kind."
        )
    if epipolar > LARGEST_EPIPOLAR * _wider(size):
        raise NotEnough(f"The rows of both pictures still differ by {epipolar:.2f} px: see that no camera moves meanwhile.")
    offset_std, scale_std = _doubt(board, usable, size, solved)
    if offset_std > LARGEST_OFFSET_STD * _wider(size) or scale_std > LARGEST_SCALE_STD:
        raise NotEnough(
            f"With other views it would come out differently, disparities by {offset_std:.2f} px and lengths by "
            f"{100 * scale_std:.1f} %: take more views, nearer and farther, more tilted."
        )
    return PairCalibration(
        solved, reprojection, epipolar, offset_std, scale_std, tuple(view.name for view in usable), tuple(left_out)
    )


def _usable(board: Board, views: Sequence[View], size: tuple[int, int]) -> list[View]:
    """The views that can be used. Raises NotEnough where they are too few, or do not cover enough."""
    few = [view.name for view in views if not view.shows_enough(board)]
    blurred = [view.name for view in views if view.name not in few and too_blurred(view, size)]
    usable = [view for view in views if view.name not in few and view.name not in blurred]
    try:
        _check_views(board, usable, size)
    except NotEnough as error:
        told = []
        if few:
            told.append(f"both cameras must see {LEAST_CORNERS} corners in two rows or more, which is not so in {_some(few)}")
        if blurred:
            told.append(f"blurred are {_some(blurred)}: hold the board still, and focus")
        raise NotEnough(" ".join([str(error), *(f"{one[0].upper()}{one[1:]}." for one in told)])) from None
    return usable


def _check_views(board: Board, usable: Sequence[View], size: tuple[int, int]) -> None:
    if len(usable) < LEAST_VIEWS:
        raise NotEnough(f"There are {len(usable)} usable views of the board, at least {LEAST_VIEWS} are needed.")
    covered = coverage(board, ((view.left, view.right) for view in usable), size)
    if min(covered.shares) < LEAST_COVERED:
        shares = " and ".join(f"{100 * share:.0f} %" for share in covered.shares)
        raise NotEnough(
            f"The views cover {shares} of the two pictures, {100 * LEAST_COVERED:.0f} % are needed: "
            f"show the board in the {_some(covered.missing())}."
        )
    tilts = covered.missing_tilts(LEAST_TILTS)
    if tilts:
        raise NotEnough(f"The board was hardly tilted: show it also with its {' and with its '.join(tilts)}.")


def _solve(board: Board, views: Sequence[View], size: tuple[int, int]) -> LensPair:
    """Each lens by itself from all that it saw, then both together."""
    (left, left_bends), (right, right_bends) = (
        _one_lens(board, [getattr(view, side) for view in views], size) for side in ("left", "right")
    )
    common = [view.common for view in views]
    points = [board.points[ids].astype(np.float32) for ids, _, _ in common]
    flags = cv2.CALIB_USE_INTRINSIC_GUESS | (0 if left_bends[4] or right_bends[4] else cv2.CALIB_FIX_K3)
    found = cv2.stereoCalibrate(
        points,
        [seen.astype(np.float32) for _, seen, _ in common],
        [seen.astype(np.float32) for _, _, seen in common],
        left,
        left_bends,
        right,
        right_bends,
        size,
        flags=flags,
        criteria=_FINE,
    )
    left, left_bends, right, right_bends, turn, step = (np.asarray(part, dtype=np.float64) for part in found[1:7])
    lenses = (_intrinsics(left, left_bends, size), _intrinsics(right, right_bends, size))
    # to the nearest rotation, which the numbers of an iteration are not quite
    u, _, v = np.linalg.svd(turn)
    x, y, z = step.ravel().tolist()
    try:
        return LensPair(*lenses, tuple((u @ v).ravel().tolist()), (x, y, z))
    except ValueError:
        raise NotEnough(
            f"The right camera comes out {1000 * -x:.0f} mm to the right of the left one and {1000 * np.hypot(y, z):.0f} mm "
            "above or behind it: were left and right exchanged, or does one stand on its head?"
        ) from None


def _one_lens(board: Board, seen: Sequence[Sighting], size: tuple[int, int]) -> tuple[Floats, Floats]:
    """(camera matrix, distortion), the sixth-order term only where it is worth its while."""
    points = [board.points[one.ids].astype(np.float32) for one in seen]
    pixels = [one.pixels.astype(np.float32) for one in seen]

    def solved(flags: int) -> tuple[float, Floats, Floats]:
        rms, camera, bends = cv2.calibrateCamera(points, pixels, size, np.eye(3), np.zeros(5), flags=flags, criteria=_FINE)[:3]
        return float(rms), np.asarray(camera, dtype=np.float64), np.asarray(bends, dtype=np.float64).ravel()

    plain = solved(cv2.CALIB_FIX_K3)
    full = solved(0)
    return full[1:] if full[0] < _BETTER * plain[0] else plain[1:]


def _intrinsics(camera: Floats, bends: Floats, size: tuple[int, int]) -> Intrinsics:
    coeffs = tuple(float(value) for value in np.asarray(bends).ravel()[:5])
    return Intrinsics(
        *size, float(camera[0, 0]), float(camera[1, 1]), float(camera[0, 2]), float(camera[1, 2]), "brown_conrady", coeffs
    )


def _view_errors(board: Board, views: Sequence[View], lenses: LensPair) -> Floats:
    """The rms distance (px) of each view's corners in both pictures from where one board at one place is seen."""
    turn, step = np.asarray(lenses.rotation).reshape(3, 3), np.asarray(lenses.translation)
    errors = []
    for view in views:
        ids, left, right = view.common
        points = board.points[ids]
        _, rotated, moved = cv2.solvePnP(points, left, matrix_of(lenses.left), np.asarray(lenses.left.coeffs))
        placed = points @ cv2.Rodrigues(rotated)[0].T + moved.ravel()
        other = placed @ turn.T + step
        off = [
            project_rays(place[:, :2] / place[:, 2:], lens) - pixels
            for place, lens, pixels in ((placed, lenses.left, left), (other, lenses.right, right))
        ]
        errors.append(np.sqrt(np.mean([(one**2).sum(axis=1) for one in off])))
    return np.asarray(errors)


def _epipolar(views: Sequence[View], lenses: LensPair) -> float:
    """The rms difference (px) of the rows that a corner has in the two rectified pictures."""
    rows = []
    for view in views:
        _, left, right = view.common
        rows.append(_rectified_pixels(left, lenses, 0)[:, 1] - _rectified_pixels(right, lenses, 1)[:, 1])
    return float(np.sqrt(np.mean(np.concatenate(rows) ** 2)))


def _rectified_pixels(pixels: Floats, lenses: LensPair, side: int) -> Floats:
    """(N, 2): where the rectified picture of a side shows what its lens threw to ``pixels``."""
    found = rectified(lenses)
    sight = deproject_pixels(pixels, (lenses.left, lenses.right)[side])
    turned = np.column_stack([sight, np.ones(len(sight))]) @ found.turns[side].T
    return project_rays(turned[:, :2] / turned[:, 2:], found.intrinsics)


def disparity_errors(believed: LensPair, true: LensPair, depths: Sequence[float] = (0.4, 0.8, 1.6)) -> tuple[Floats, Floats]:
    """(errors, disparities) in px of points all over the picture at ``depths`` (m), which ``true`` lenses see and ``believed``
    ones read."""
    found = rectified(believed)
    u, v = np.meshgrid(np.linspace(0.1, 0.9, 7), np.linspace(0.1, 0.9, 5))
    size = np.array(found.intrinsics.size)
    sight = deproject_pixels(np.stack([u.ravel(), v.ravel()], axis=1) * size, true.left)
    turn, step = np.asarray(true.rotation).reshape(3, 3), np.asarray(true.translation)
    errors, disparities = [], []
    for depth in depths:
        points = depth * np.column_stack([sight, np.ones(len(sight))])
        other = points @ turn.T + step
        left = _rectified_pixels(project_rays(sight, true.left), believed, 0)
        right = _rectified_pixels(project_rays(other[:, :2] / other[:, 2:], true.right), believed, 1)
        expected = found.intrinsics.fx * found.baseline_m / (points @ found.turns[0].T)[:, 2]
        inside = ((left > 0) & (left < size) & (right > 0) & (right < size)).all(axis=1)
        errors.append(np.where(inside, left[:, 0] - right[:, 0] - expected, np.nan))
        disparities.append(expected)
    return np.concatenate(errors), np.concatenate(disparities)


def _doubt(board: Board, views: Sequence[View], size: tuple[int, int], solved: LensPair) -> tuple[float, float]:
    """(offset_std_px, scale_std) by leaving each fifth of the views out: an error of all disparities alike, together with what
    differs from place to place, and one in proportion to them."""
    without = []
    for group in range(_GROUPS):
        kept = [view for index, view in enumerate(views) if index % _GROUPS != group]
        errors, disparities = disparity_errors(solved, _solve(board, kept, size))
        without.append(errors)
    changes = np.array(without) - np.mean(without, axis=0)
    known = np.isfinite(changes).all(axis=0)
    rows = np.stack([np.ones(known.sum()), disparities[known]], axis=1)
    parts = np.linalg.lstsq(rows, changes[:, known].T, rcond=None)[0]
    rest = changes[:, known] - (rows @ parts).T
    spread = np.sqrt((_GROUPS - 1) / _GROUPS * np.sum(parts**2, axis=1))
    uneven = np.sqrt((_GROUPS - 1) / _GROUPS * np.sum(np.mean(rest**2, axis=1)))
    return float(np.hypot(spread[0], uneven)), float(np.hypot(spread[1], BOARD_STD))


def _wider(size: tuple[int, int]) -> float:
    return max(1.0, size[0] / REFERENCE_WIDTH)


def _some(names: Sequence[str]) -> str:
    """The first few of them."""
    told = ", ".join(names[:4])
    return told if len(names) <= 4 else f"{told} and {len(names) - 4} more"
