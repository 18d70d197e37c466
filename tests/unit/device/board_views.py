"""Views of a board through two known lenses: rendered ray by ray, with blur and noise. The truth of the calibration's tests."""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from estimators.board.board import Board, Sighting
from estimators.board.calibration import View
from estimators.pinhole import Intrinsics, LensPair, project_rays, rays

SIZE = (640, 400)
_SQUARE_PX = 48
_MARGIN = 1.0
"""White about the board, in squares."""


def lenses(size: tuple[int, int] = SIZE) -> LensPair:
    """Two wide lenses that bend and squint a little, 60 mm apart."""
    scale = size[0] / 640
    left, right = (
        Intrinsics(*size, scale * f, scale * (f + 0.7), scale * ppx, scale * ppy, "brown_conrady", coeffs)
        for f, ppx, ppy, coeffs in (
            (380.0, 322.0, 203.0, (-0.18, 0.06, 0.0008, -0.0005, 0.0)),
            (383.0, 316.5, 198.0, (-0.17, 0.05, -0.0006, 0.0004, 0.0)),
        )
    )
    turn = cv2.Rodrigues(np.array([0.004, -0.012, 0.006]))[0]
    x, y, z = (-turn @ np.array([0.0603, 0.0006, -0.0004])).tolist()
    return LensPair(left, right, tuple(turn.ravel().tolist()), (x, y, z))


@dataclass(frozen=True)
class Place:
    """Where the board is held: its middle (m) in the left camera's frame, and how it is turned (rad, a rotation vector)."""

    middle: tuple[float, float, float]
    turned: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Photographer:
    """Takes pictures of ``board`` through ``pair``. ``blur`` (px) and ``noise`` (grey levels) are those of the cameras."""

    board: Board
    pair: LensPair = field(default_factory=lenses)
    blur: float = 0.7
    noise: float = 2.0

    def pictures(self, place: Place, rng: np.random.Generator) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
        """(left, right), each (H, W) grey."""
        left, right = (self._picture(lens, rotation, at, rng) for lens, rotation, at in self._seen(place))
        return left, right

    def view(self, name: str, place: Place, rng: np.random.Generator, off_px: float = 0.08) -> View:
        """What would be found in these pictures, without taking them: corners in the picture, each ``off_px`` (rms) off."""
        both = []
        for lens, rotation, at in self._seen(place):
            points = self.board.points @ rotation.T + at
            pixels = project_rays(points[:, :2] / points[:, 2:], lens)
            inside = ((pixels > 4) & (pixels < np.array(lens.size) - 5)).all(axis=1)
            found = pixels[inside] + rng.normal(0, off_px / np.sqrt(2), (inside.sum(), 2))
            both.append(Sighting(np.flatnonzero(inside), found, self.blur))
        return View(name, *both)

    def _seen(self, place: Place) -> list[tuple[Intrinsics, NDArray[np.float64], NDArray[np.float64]]]:
        turn = cv2.Rodrigues(np.array(place.turned))[0]
        size_m = self.board.square_m * np.array([self.board.columns, self.board.rows, 0.0])
        origin = np.array(place.middle) - turn @ (size_m / 2)
        between = np.asarray(self.pair.rotation).reshape(3, 3)
        return [(self.pair.left, turn, origin), (self.pair.right, between @ turn, between @ origin + self.pair.translation)]

    def _picture(
        self, lens: Intrinsics, rotation: NDArray[np.float64], origin: NDArray[np.float64], rng: np.random.Generator
    ) -> NDArray[np.uint8]:
        paper = _paper(self.board)
        sight = np.concatenate([rays(lens), np.ones((lens.height, lens.width, 1), np.float32)], axis=-1).astype(np.float64)
        normal = rotation[:, 2]
        depth = (normal @ origin) / (sight @ normal)
        on_board = (sight * depth[..., None] - origin) @ rotation[:, :2] / self.board.square_m
        # a texel's middle is half a texel from its edge
        u, v = ((on_board[..., axis] + _MARGIN) * _SQUARE_PX - 0.5 for axis in (0, 1))
        u, v = (np.where(depth > 0, places, -1e6).astype(np.float32) for places in (u, v))
        # the paper is blurred to what a pixel sees of it, so that nothing flickers
        texels = float(np.median(np.abs(np.diff(u, axis=1))[np.abs(np.diff(u, axis=1)) < 50])) if (depth > 0).any() else 1.0
        soft = cv2.GaussianBlur(paper, (0, 0), max(0.5 * texels, 0.3))
        picture = cv2.remap(soft, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=90.0)
        picture = 20 + 0.8 * cv2.GaussianBlur(picture, (0, 0), self.blur)
        return np.asarray(np.clip(picture + rng.normal(0, self.noise, picture.shape), 0, 255), dtype=np.uint8)


def _paper(board: Board) -> NDArray[np.float32]:
    margin = round(_MARGIN * _SQUARE_PX)
    return np.pad(board.picture(_SQUARE_PX), margin, constant_values=255).astype(np.float32)


def good_places(rng: np.random.Generator, count: int = 24) -> list[Place]:
    """As a careful person holds a board of 270 x 180 mm: all over the picture, near and far, tilted every way."""
    places = []
    tilts = [(0.0, 0.0), (0.5, 0.0), (-0.5, 0.0), (0.0, 0.5), (0.0, -0.5), (0.35, 0.35), (-0.35, 0.35), (0.3, -0.4)]
    spots = [(x, y) for y in (-0.7, 0.0, 0.7) for x in (-0.75, -0.25, 0.25, 0.75)]
    for number in range(count):
        depth = float(rng.uniform(0.28, 0.55))
        across, down = spots[number % len(spots)]
        pitch, yaw = tilts[number % len(tilts)]
        # half of the field of view less half of the board, so that most of it stays in the picture
        x = across * max(0.80 * depth - 0.09, 0.03) + 0.03
        y = down * max(0.50 * depth - 0.05, 0.02)
        turned = (pitch + rng.normal(0, 0.05), yaw + rng.normal(0, 0.05), float(rng.normal(0, 0.15)))
        places.append(Place((x, y, depth), turned))
    return places
