"""Paints the landmarks of a virtual pipe onto its unrolled wall."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.virtual.landmarks import Connection, DisplacedJoint, Fracture, Patch, Roots, Thing
from drivers.virtual.look import Look
from drivers.virtual.relief import SETTLED_M, displacement, opening, patch_shape

Array = NDArray[np.float32]
_SUBPIXEL = 4
"""Bits behind the point in coordinates that OpenCV draws with."""


@dataclass(frozen=True)
class Brush:
    """A ``tile`` (n, m, 3) of the wall under the brush, its chainages ``z`` (n,) and angles (m,), painted in place. ``rough``
    (n, m) is the wall's own grain, of standard deviation about 1."""

    tile: Array
    z: Array
    angle: Array
    rough: Array
    radius: float
    look: Look
    seed: int

    def rows(self, begin: float, end: float) -> slice:
        """The rows of the tile from chainage ``begin`` to ``end``; empty where it does not reach so far."""
        first, last = np.searchsorted(self.z, (begin, end))
        return slice(int(first), int(last))

    def around(self, angle: float) -> Array:
        """Angle (m,) from ``angle`` to every column, in (-pi, pi]."""
        return np.asarray(np.angle(np.exp(1j * (self.angle - angle))), np.float32)

    def blend(self, rows: slice, share: Array, color: Array) -> None:
        """Lay ``color`` (..., 3) over the rows, covering ``share`` (n, m) of them."""
        part = self.tile[rows]
        part += share[..., None] * (color - part)


def paint_thing(brush: Brush, thing: Thing, index: int) -> None:
    """Paint one landmark where it lies on the tile; how it looks follows from the seed and its ``index``."""
    begin, end, _, _ = thing.reach(brush.radius)
    margin = SETTLED_M if isinstance(thing, DisplacedJoint) else 0.25
    rows = brush.rows(begin - 0.25, end + margin)
    if rows.start >= rows.stop:
        return
    rng = np.random.default_rng([brush.seed, 44, index])
    if isinstance(thing, Connection):
        _connection(brush, rows, thing, rng)
    elif isinstance(thing, Patch):
        _patch(brush, rows, thing, rng)
    elif isinstance(thing, DisplacedJoint):
        _displaced(brush, rows, thing, rng)
    elif isinstance(thing, Fracture):
        _fracture(brush, rows, thing, rng)
    else:
        _roots(brush, rows, thing, rng)


def _connection(brush: Brush, rows: slice, thing: Connection, rng: np.random.Generator) -> None:
    """A dark opening with a rim; of its inside the far wall shows, a crescent that the lamp reaches."""
    z, angle = brush.z[rows, None], brush.angle[None, :]
    away = opening(thing, brush.radius, z, angle)
    half = thing.diameter / 2
    bearing = np.arctan2(z - np.float32(thing.chainage), np.float32(brush.radius) * brush.around(thing.angle)[None, :])
    jagged = rng.uniform(0.0, 0.05)
    edge = 1 + sum(
        np.float32(jagged * rng.normal() / math.sqrt(k)) * np.sin(np.float32(k) * bearing + np.float32(rng.uniform(0, 6.3)))
        for k in (2, 3, 5, 8, 13)
    )
    stained = rng.random() < 0.6
    if stained:
        _stain(brush, rows, thing, rng)
    rim_wide, rim_tone = float(rng.uniform(0.08, 0.3)), float(rng.choice([rng.uniform(0.45, 0.8), rng.uniform(1.1, 1.6)]))
    wall = np.asarray(brush.look.wall, np.float32)
    rim = np.clip((edge + np.float32(rim_wide) - away) / np.float32(0.06), 0, 1)
    mortar = wall * np.float32(rim_tone) * (1 + np.float32(0.2) * brush.rough[rows])[..., None]
    brush.blend(rows, np.asarray(rim * np.float32(0.8), np.float32), mortar)
    hole = np.asarray(np.clip((edge - away) / np.float32(0.05), 0, 1), np.float32)
    # looked at from before, the far side of the inside is what lies behind the opening moved towards the camera
    shifted = np.hypot(
        np.where(np.isfinite(away), np.float32(brush.radius) * np.sin(brush.around(thing.angle))[None, :], np.float32(9)),
        z - np.float32(thing.chainage - 0.45 * half),
    ) / np.float32(half)
    inside = np.clip((shifted - np.float32(0.8)) / np.float32(0.5), 0, 1) ** 1.5 * np.float32(rng.uniform(0.25, 0.6))
    depth = np.float32(rng.uniform(0.01, 0.05)) + inside
    brush.blend(rows, hole, wall * np.float32(rng.uniform(0.7, 1.0)) * depth[..., None])


def _stain(brush: Brush, rows: slice, thing: Connection, rng: np.random.Generator) -> None:
    """What ran out of a connection down the wall."""
    down = math.pi / 2 - (thing.angle + 2 * math.pi if thing.angle < -math.pi / 2 else thing.angle)
    share = brush.around(thing.angle)[None, :] / np.float32(down if abs(down) > 0.2 else 0.2)
    wide = np.float32(thing.diameter * rng.uniform(0.15, 0.35)) * (1 + np.float32(0.5) * np.abs(share))
    along = (brush.z[rows, None] - np.float32(thing.chainage)) / wide
    amount = np.exp(-(along**2)) * ((share > 0) & (share < 1)) * np.float32(rng.uniform(0.3, 0.8))
    tint = np.array([0.20, 0.30, 0.42]) * rng.uniform(0.5, 1.6)
    brush.blend(rows, np.asarray(amount, np.float32), np.asarray(tint, np.float32))


def _patch(brush: Brush, rows: slice, thing: Patch, rng: np.random.Generator) -> None:
    """A bed of silt, grit or grease: lumpy, uneven at its edge, bright where it rises against the lamp."""
    z, angle = brush.z[rows, None], brush.angle[None, :]
    shape = patch_shape(thing, z, angle)
    rough = brush.rough[rows]
    blotches = np.asarray(cv2.GaussianBlur(np.ascontiguousarray(rough), (0, 0), 6), np.float32)
    blotches /= blotches.std() + np.float32(1e-6)
    cover = np.asarray(
        np.clip((shape * (1 + np.float32(0.45) * blotches) - np.float32(0.1)) / np.float32(0.12), 0, 1), np.float32
    )
    kinds = ((0.16, 0.25, 0.33), (0.30, 0.36, 0.40), (0.22, 0.38, 0.52), (0.62, 0.70, 0.74), (0.10, 0.14, 0.16))
    color = np.array(kinds[int(rng.integers(len(kinds)))]) * rng.uniform(0.75, 1.25)
    coarse = float(rng.uniform(0.08, 0.35))
    # its own relief: grain and lumps seen in slanting light
    relief = np.float32(thing.height) * shape + np.float32(0.0016) * blotches
    slope = np.gradient(relief, axis=0) / np.float32(brush.z[1] - brush.z[0]) if len(relief) > 1 else np.zeros_like(relief)
    shade = np.clip(1 + np.float32(1.6) * slope, 0.35, 2.0) * (1 + np.float32(coarse) * rough)
    painted = np.asarray(color, np.float32) * np.clip(shade, 0.1, 2.5)[..., None]
    brush.blend(rows, cover * np.float32(0.95), np.asarray(painted, np.float32))


def _displaced(brush: Brush, rows: slice, thing: DisplacedJoint, rng: np.random.Generator) -> None:
    """The face of the pipe that stands in is bright or broken, the gap on the other side black."""
    behind = brush.z[rows, None] - np.float32(thing.chainage)
    side = np.cos(brush.angle - np.float32(thing.angle)).astype(np.float32)[None, :]
    wall = np.asarray(brush.look.wall, np.float32)
    face_m = 0.5 * thing.step
    face = np.exp(-((behind / np.float32(face_m)) ** 2)) * np.clip(side * np.float32(2.5), 0, 1)
    tone = np.float32(rng.choice([rng.uniform(0.3, 0.6), rng.uniform(1.2, 1.9)])) * (1 + np.float32(0.25) * brush.rough[rows])
    brush.blend(rows, np.asarray(face * np.float32(0.85), np.float32), wall * np.clip(tone, 0.1, 2.2)[..., None])
    gap_m = 0.8 * thing.step
    gap = np.exp(-(((behind - np.float32(0.3 * gap_m)) / np.float32(gap_m)) ** 2)) * np.clip(-side * np.float32(2.0), 0, 1)
    brush.blend(rows, np.asarray(gap * np.float32(0.93), np.float32), wall * np.float32(0.05))
    # in the shadow of the lip the wall behind it is dim
    shadow = np.clip(displacement(thing, brush.z[rows, None], brush.angle[None, :]) / np.float32(thing.step), 0, 1)
    lee = np.exp(-np.maximum(behind - np.float32(face_m), 0) / np.float32(4 * thing.step)) * (behind > face_m)
    brush.tile[rows] *= (1 - np.float32(0.55) * shadow * lee)[..., None]


def _fracture(brush: Brush, rows: slice, thing: Fracture, rng: np.random.Generator) -> None:
    """A thin dark line that wanders and branches; damp spreads from it at times."""
    cell = float(brush.z[1] - brush.z[0])
    turned = brush.around((thing.angle + thing.angle_to) / 2)
    middle = len(turned) // 2
    canvas = np.zeros((rows.stop - rows.start, len(turned)), np.uint8)
    top = float(brush.z[rows.start])
    for line, width in _cracks(thing, brush.radius, rng):
        column = middle + line[:, 1] * brush.radius / cell
        points = np.stack([column, (line[:, 0] - top) / cell], axis=1) * 2**_SUBPIXEL
        thick = max(1, round(width / cell))
        cv2.polylines(canvas, [np.round(points).astype(np.int32)], False, 255, thick, cv2.LINE_AA, _SUBPIXEL)
    # the canvas has the crack in its middle, the tile begins at image angle 0
    order = np.argsort(turned, kind="stable")
    crack = np.zeros_like(canvas)
    crack[:, order] = canvas
    share = crack.astype(np.float32) / np.float32(255)
    damp = float(rng.choice([0.0, rng.uniform(0.15, 0.5)]))
    if damp:
        halo = np.asarray(cv2.GaussianBlur(canvas, (0, 0), 0.008 / cell), np.float32)
        spread = np.zeros_like(halo)
        spread[:, order] = halo
        brush.blend(
            rows, np.minimum(spread / np.float32(255 * 0.2), 1) * np.float32(damp), np.float32(0.12) * np.ones(3, np.float32)
        )
    brush.blend(rows, share * np.float32(rng.uniform(0.75, 0.97)), np.asarray(brush.look.wall, np.float32) * np.float32(0.07))


def _cracks(thing: Fracture, radius: float, rng: np.random.Generator) -> list[tuple[NDArray[np.float64], float]]:
    """Lines (n, 2) of (chainage, angle from the fracture's middle) with their widths (m): the crack and its branches."""
    length = math.hypot(thing.end - thing.start, radius * (thing.angle_to - thing.angle))
    steps = max(8, int(length / 0.02))
    share = np.linspace(0, 1, steps)
    half = (thing.angle_to - thing.angle) / 2
    shake = np.cumsum(rng.normal(0, 0.006, (steps, 2)), axis=0)
    shake -= share[:, None] * shake[-1]
    main = np.stack([thing.start + share * (thing.end - thing.start), -half + share * 2 * half], axis=1)
    main += shake * [1.0, 1.0 / radius]
    main[:, 0] = np.clip(main[:, 0], thing.start, thing.end)
    width = float(rng.uniform(0.002, 0.0055))
    found = [(main, width)]
    for _ in range(int(rng.integers(1, 5))):
        begin = main[int(rng.integers(steps // 6, steps - 1))]
        heading = rng.uniform(0, 2 * math.pi)
        count = int(rng.integers(4, 12))
        walk = np.cumsum(rng.normal(0, 0.35, count))
        move = 0.015 * np.stack([np.cos(heading + walk), np.sin(heading + walk) / radius], axis=1)
        branch = np.vstack([begin, begin + np.cumsum(move, axis=0)])
        found.append((branch, 0.6 * width))
    return found


def _roots(brush: Brush, rows: slice, thing: Roots, rng: np.random.Generator) -> None:
    """The joint where roots come in is dark and matted with fine ones that lie on the wall."""
    turned = brush.around(thing.angle)[None, :] / np.float32(thing.spread)
    along = (brush.z[rows, None] - np.float32(thing.chainage)) / np.float32(0.03)
    mat = np.exp(-(turned**2) * 1.2 - along**2) * np.clip(np.float32(0.6) + np.float32(0.5) * brush.rough[rows], 0, 1)
    brush.blend(rows, np.asarray(mat * np.float32(0.7), np.float32), np.asarray((0.10, 0.15, 0.20), np.float32))
