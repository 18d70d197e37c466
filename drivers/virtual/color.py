"""The colour picture of the virtual sewer, for the operator's eye: painted from where the rays of the depth picture ended."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.virtual import world
from drivers.virtual.rig import Pose
from drivers.virtual.world import Hits

Array = NDArray[np.float32]
_TILE = 512
_GRAIN_M = 0.002
"""Length of wall that one cell of the texture covers."""
_EXPOSED_TO = 120.0
"""Grey level that automatic exposure brings the brighter parts to."""
_BGR = {
    world.NOTHING: (0, 0, 0),
    world.WALL: (168, 180, 188),
    world.END: (96, 104, 112),
    world.WATER: (40, 50, 44),
    world.DEPOSIT: (62, 88, 108),
    world.CHAMBER: (110, 124, 150),
    world.JOINT: (30, 34, 38),
}


class Painter:
    """Paints the pipe of one ``radius`` (m); the texture sticks to the wall, so that it moves as the box does."""

    def __init__(self, radius: float, seed: int) -> None:
        self._rng = np.random.default_rng([seed, 3])
        self._texture = _texture(self._rng)
        # a whole number of tiles around the pipe leaves no seam
        self._around = np.float32(_TILE / (2 * np.pi) * max(1, round(2 * np.pi * radius / (_GRAIN_M * _TILE))))
        self._colors = np.array([_BGR[kind] for kind in range(len(_BGR))], np.float32)

    def picture(self, hits: Hits, pose: Pose, rays: Array, size: tuple[int, int]) -> NDArray[np.uint8]:
        """(H, W, 3) uint8 BGR of ``size`` (width, height) from ``hits`` (h, w) of ``rays`` (h, w, 2) from ``pose``."""
        direction = np.concatenate([rays, np.ones((*rays.shape[:-1], 1), np.float32)], axis=-1)
        points = direction @ pose.rotation.T.astype(np.float32) * hits.depth[..., None] + pose.position.astype(np.float32)
        away2 = hits.depth**2 * np.einsum("...i,...i->...", direction, direction)
        light = np.maximum(hits.cosine, np.float32(0.05)) ** np.float32(0.4) / (np.float32(0.15) + away2)
        painted = self._colors[hits.material] * (light * self._grain(hits, points))[..., None]
        exposure = _EXPOSED_TO / max(float(np.percentile(painted[::4, ::4], 85)), 1e-3)
        painted = 255 * (1 - np.exp(painted * np.float32(-exposure / 160)))
        painted += self._rng.normal(0, 1, painted.shape[:2]).astype(np.float32)[..., None]
        small = np.clip(painted, 0, 255).astype(np.uint8)
        return np.asarray(cv2.resize(small, size, interpolation=cv2.INTER_CUBIC), np.uint8)

    def _grain(self, hits: Hits, points: Array) -> Array:
        """Brightness of the texture where the rays ended; on water, glints that come and go."""
        x, y, z = points[..., 0], points[..., 1], points[..., 2]
        walls = (hits.material == world.WALL) | (hits.material == world.JOINT)
        across = np.where(walls, np.arctan2(y, x) * self._around, x / np.float32(_GRAIN_M))
        along = np.where(walls, z, y + z) / np.float32(_GRAIN_M)
        found = cv2.remap(self._texture, across % _TILE, along % _TILE, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
        glints = np.where(self._rng.random(x.shape, np.float32) > np.float32(0.99), np.float32(6), np.float32(1))
        return np.asarray(np.where(hits.material == world.WATER, glints, found), np.float32)


def _texture(rng: np.random.Generator) -> Array:
    """Brightness (_TILE, _TILE) around 1 that repeats without a seam: grains, stains and what is between them."""
    total = np.zeros((_TILE, _TILE), np.float32)
    for grain, weight in ((1.0, 0.14), (3.0, 0.09), (12.0, 0.08), (40.0, 0.05)):
        tiles = np.tile(rng.normal(size=(_TILE, _TILE)).astype(np.float32), (2, 2))
        half = _TILE // 2
        smooth = np.asarray(cv2.GaussianBlur(tiles, (0, 0), grain))[half : half + _TILE, half : half + _TILE]
        total += np.float32(weight) * smooth / smooth.std()
    return np.asarray(np.clip(1 + total, 0.2, 2.0), np.float32)
