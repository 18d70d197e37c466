"""The painted wall of a virtual pipe, unrolled: what colour it has at (chainage, image angle), sharp near by, averaged far off.

The wall is painted in tiles when the camera comes near, each settled by the seed alone; a strip of it is then resampled to one
row for each pixel of radius in the picture, so that far rings are averaged over the length of wall that one pixel sees.
"""

from __future__ import annotations

import math
from collections import OrderedDict

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.virtual.look import Look
from drivers.virtual.paint import Brush, paint_thing
from drivers.virtual.world import VirtualSewer

Array = NDArray[np.float32]
COLUMNS = 1024
"""Cells around the pipe, from image angle 0 on; a tile is as long as the pipe is around, so its cells are square."""
ALBEDO_STEPS = 180
"""How many grey steps of a tile are an albedo of 1; glints are brighter."""
_LEVELS = 9
_TILES_KEPT = 14
_STAIN_M = 0.06
_STAIN_COLUMNS = 48


class Wall:
    """The wall of one ``sewer``; texture and dirt follow from ``seed``."""

    def __init__(self, sewer: VirtualSewer, look: Look, seed: int) -> None:
        self._sewer, self._look, self._seed = sewer, look, seed
        self.tile_m = 2 * math.pi * sewer.radius
        self.cell_m = self.tile_m / COLUMNS
        rng = np.random.default_rng([seed, 41])
        self._grain = [periodic_noise(rng, size, look_grain) for size, look_grain in ((COLUMNS, 1.2), (COLUMNS, 3.5))]
        rows = int((sewer.length + 40) / _STAIN_M) + 8
        self._stains = rng.normal(size=(rows, _STAIN_COLUMNS)).astype(np.float32)
        self._streaks = rng.normal(size=(rows // 6 + 4, 2 * _STAIN_COLUMNS)).astype(np.float32)
        edges = np.array([-np.inf, *sorted(joint.chainage for joint in sewer.joints), np.inf])
        self._pieces = edges
        tone = rng.normal(size=(len(edges), 1)) + 0.2 * rng.normal(size=(len(edges), 3))
        self._piece_tone = (1 + look.pieces * np.clip(tone, -2, 2)).astype(np.float32)
        self._tiles: OrderedDict[int, list[NDArray[np.uint8]]] = OrderedDict()

    def rows(self, chainage: Array, span: Array) -> NDArray[np.uint8]:
        """The wall (n, COLUMNS + 2, 3) at ``chainage`` (n,), ascending or descending, each row averaged over about ``span``
        (n,) metres. The first two columns come again at the end, for interpolation across the seam."""
        found = np.zeros((len(chainage), COLUMNS + 2, 3), np.uint8)
        level = np.clip(np.log2(np.maximum(span / np.float32(self.cell_m), 1)), 0, _LEVELS).astype(np.int32)
        for k in np.unique(level):
            chosen = np.flatnonzero(level == k)
            cell = self.cell_m * 2.0 ** int(k)
            position = chainage[chosen] / np.float32(cell) - np.float32(0.5)
            first = int(np.floor(position.min()))
            window = self._window(int(k), first, int(np.floor(position.max())) + 2)
            lower = np.floor(position).astype(np.int32)
            share = ((position - lower) * 256).astype(np.uint16)[:, None, None]
            above, below = window[lower - first].astype(np.uint16), window[lower - first + 1].astype(np.uint16)
            found[chosen, :COLUMNS] = (above * (256 - share) + below * share) >> 8
        found[:, COLUMNS:] = found[:, :2]
        return found

    def _window(self, level: int, first: int, end: int) -> NDArray[np.uint8]:
        """Rows ``first`` to ``end`` (exclusive) of a level, from as many tiles as they lie in."""
        per_tile = COLUMNS >> level
        parts = []
        while first < end:
            number = first // per_tile
            tile = self._tile(number)[level]
            take = min(end, (number + 1) * per_tile)
            parts.append(tile[first - number * per_tile : take - number * per_tile])
            first = take
        return parts[0] if len(parts) == 1 else np.concatenate(parts)

    def _tile(self, number: int) -> list[NDArray[np.uint8]]:
        """All levels of one tile, each averaged along the pipe over twice the length of the one before."""
        if number in self._tiles:
            self._tiles.move_to_end(number)
            return self._tiles[number]
        levels = [self._painted(number)]
        for _ in range(_LEVELS):
            finer = levels[-1]
            levels.append(cv2.resize(finer, (COLUMNS, len(finer) // 2), interpolation=cv2.INTER_AREA))  # type: ignore[arg-type]
        self._tiles[number] = levels
        while len(self._tiles) > _TILES_KEPT:
            self._tiles.popitem(last=False)
        return levels

    def _painted(self, number: int) -> NDArray[np.uint8]:
        """One tile (COLUMNS, COLUMNS, 3) in full."""
        look, sewer = self._look, self._sewer
        begin = number * self.tile_m
        z = (begin + (np.arange(COLUMNS, dtype=np.float32) + 0.5) * self.cell_m).astype(np.float32)
        angle = (np.arange(COLUMNS, dtype=np.float32) + 0.5) * np.float32(2 * np.pi / COLUMNS)
        fine = self._fine(number)
        tone = np.asarray(1 + np.float32(look.grain) * fine + np.float32(look.stains) * self._coarse(begin), np.float32)
        dirty = self._dirt(begin, angle)
        # the lamp's own unevenness is painted on: a crawler hardly rolls
        side = 1 + np.float32(look.lamp_side) * np.cos(angle - np.float32(look.lamp_angle))
        tone *= side
        clean = tone * (1 - dirty)
        dirty *= tone
        piece = self._piece_tone[np.searchsorted(self._pieces, z)]
        channels = zip(look.wall, look.dirt, piece.T, strict=True)
        planes = [clean * (np.float32(wall) * tint)[:, None] + dirty * np.float32(dirt) for wall, dirt, tint in channels]
        tile = np.asarray(cv2.merge(planes), np.float32)
        brush = Brush(tile, z, angle, fine, sewer.radius, look, self._seed)
        self._joints(brush)
        for index, thing in enumerate(sewer.things):
            paint_thing(brush, thing, index)
        tile[z > sewer.length] *= np.float32(0.08)
        return np.clip(tile * ALBEDO_STEPS, 0, 255).astype(np.uint8)

    def _fine(self, number: int) -> Array:
        """Grain that repeats after some tiles only: two periodic pictures, shifted differently."""
        fine, medium = self._grain
        rng = np.random.default_rng([self._seed, 42, number % (1 << 30)])
        specks = np.zeros((COLUMNS, COLUMNS), np.float32)
        count = int(900 * self._look.specks)
        at = rng.integers(0, COLUMNS, (count, 2))
        specks[at[:, 0], at[:, 1]] = rng.choice([-6.0, 5.0, 9.0], count)
        specks = np.asarray(cv2.GaussianBlur(specks, (0, 0), 0.9), np.float32)
        return np.asarray(fine + np.roll(medium, 389 * number, axis=1) + specks, np.float32)

    def _coarse(self, begin: float) -> Array:
        """Stains and streaks, continuous from tile to tile."""
        return sampled(self._stains, begin, self.tile_m, _STAIN_M) + np.float32(0.7) * sampled(
            self._streaks, begin, self.tile_m, 6 * _STAIN_M
        )

    def _dirt(self, begin: float, angle: Array) -> Array:
        """How dirty (COLUMNS, COLUMNS) 0..1: up to an uneven line above the invert."""
        up = np.abs(np.angle(np.exp(1j * (angle - np.pi / 2)))).astype(np.float32)
        line = np.float32(self._look.dirt_line) + np.float32(0.16) * sampled(
            self._stains[:, ::-1], begin, self.tile_m, _STAIN_M
        )
        return np.asarray(np.clip((line - up) / np.float32(0.18) + np.float32(0.5), 0, 1) * np.float32(0.75), np.float32)

    def _joints(self, brush: Brush) -> None:
        look = self._look
        for index, joint in enumerate(self._sewer.joints):
            rows = brush.rows(joint.chainage - 3 * joint.width, joint.chainage + 3 * joint.width)
            if rows.start >= rows.stop:
                continue
            rng = np.random.default_rng([self._seed, 43, index])
            edge = np.float32(0.05 * joint.width) * circle_noise(rng, 12) + np.float32(joint.chainage)
            along = brush.z[rows, None] - edge[None, :]
            gap = np.clip(
                (np.float32(joint.width / 2) - np.abs(along)) / np.float32(0.25 * joint.width) + np.float32(0.5), 0, 1
            )
            worn = np.clip(np.float32(0.9) + np.float32(0.25) * circle_noise(rng, 9), 0.2, 1)
            # the far edge faces the camera and shines; what stands in the gap has dirtied the wall about it
            far_edge = np.exp(-(((along - np.float32(0.95 * joint.width)) / np.float32(0.4 * joint.width)) ** 2))
            shine = 1 + np.float32(look.rim - 1) * far_edge * np.clip(np.float32(0.8) + 0.6 * circle_noise(rng, 14), 0, 1.6)
            grime = 1 - np.float32(0.3 * (1 - look.joint)) * np.exp(-((along / np.float32(1.6 * joint.width)) ** 2))
            brush.tile[rows] *= (shine * grime * (1 - np.float32(1 - look.joint) * gap * worn))[..., None]


def periodic_noise(rng: np.random.Generator, size: int, grain: float) -> Array:
    """(size, size) of standard deviation 1 that repeats without a seam."""
    border = int(4 * grain) + 1
    white = np.pad(rng.normal(size=(size, size)).astype(np.float32), border, mode="wrap")
    smooth = np.asarray(cv2.GaussianBlur(white, (0, 0), grain))[border : border + size, border : border + size]
    return np.asarray(smooth / smooth.std(), np.float32)


def circle_noise(rng: np.random.Generator, waves: int) -> Array:
    """(COLUMNS,) of standard deviation about 1 around the pipe, with up to ``waves`` waves."""
    angle = np.arange(COLUMNS) * (2 * np.pi / COLUMNS)
    number = np.arange(1, waves + 1)
    weight = rng.normal(size=(2, waves)) / np.sqrt(number)
    weight /= np.sqrt((weight**2).sum() / 2) + 1e-9
    return np.asarray(np.cos(np.outer(angle, number)) @ weight[0] + np.sin(np.outer(angle, number)) @ weight[1], np.float32)


def sampled(grid: Array, begin: float, length: float, step: float) -> Array:
    """(COLUMNS, COLUMNS) from ``begin`` over ``length`` (m) of a ``grid`` with a row each ``step`` (m) and columns around."""
    columns = grid.shape[1]
    row = np.clip((begin + (np.arange(COLUMNS) + 0.5) * (length / COLUMNS)) / step + 4, 0, len(grid) - 1.001)
    column = (np.arange(COLUMNS) + 0.5) * (columns / COLUMNS)
    wrapped = np.concatenate([grid, grid[:, :2]], axis=1)
    maps = np.meshgrid(column.astype(np.float32), row.astype(np.float32))
    return np.asarray(cv2.remap(wrapped, maps[0], maps[1], cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE), np.float32)
