"""The colour picture of the virtual sewer, for the operator's eye: painted from where the rays of the depth picture ended."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.virtual import world
from drivers.virtual.rig import Pose
from drivers.virtual.world import Hits

_ANGLES, _CHAINAGES = 512, 1024
_CELL_M = 0.006
"""Length of pipe that one row of the texture covers; it repeats every _CHAINAGES rows."""
_EXPOSED_TO = 120.0
"""Grey level that automatic exposure brings the brighter parts to."""
_BGR = {
    world.NOTHING: (0, 0, 0),
    world.WALL: (168, 180, 188),
    world.END: (96, 104, 112),
    world.WATER: (58, 70, 62),
    world.DEPOSIT: (62, 88, 108),
    world.CHAMBER: (110, 124, 150),
    world.JOINT: (52, 58, 64),
}


class Painter:
    """Paints one pipe; the texture sticks to the wall, so that it moves as the box does."""

    def __init__(self, seed: int) -> None:
        rng = np.random.default_rng([seed, 3])
        coarse = rng.normal(size=(_CHAINAGES // 8, _ANGLES // 8)).astype(np.float32)
        texture = cv2.resize(coarse, (_ANGLES, _CHAINAGES), interpolation=cv2.INTER_CUBIC)
        texture = 0.13 * texture + 0.11 * rng.normal(size=(_CHAINAGES, _ANGLES)).astype(np.float32)
        self._texture = np.asarray(1 + texture, np.float32)
        self._colors = np.array([_BGR[kind] for kind in range(len(_BGR))], np.float32)
        self._rng = rng

    def picture(self, hits: Hits, pose: Pose, rays: NDArray[np.float32], size: tuple[int, int]) -> NDArray[np.uint8]:
        """(H, W, 3) uint8 BGR of ``size`` (width, height) from ``hits`` (h, w) of ``rays`` (h, w, 2) from ``pose``."""
        direction = np.concatenate([rays, np.ones((*rays.shape[:-1], 1), np.float32)], axis=-1)
        points = direction @ pose.rotation.T.astype(np.float32) * hits.depth[..., None] + pose.position.astype(np.float32)
        angle = np.arctan2(points[..., 1], points[..., 0])
        column = (angle * np.float32(_ANGLES / (2 * np.pi))).astype(np.int32)
        row = (points[..., 2] / np.float32(_CELL_M)).astype(np.int32)
        facing = (hits.material == world.CHAMBER) | (hits.material == world.END) | (hits.material == world.DEPOSIT)
        column = np.where(facing, (points[..., 0] / np.float32(_CELL_M)).astype(np.int32), column)
        row = np.where(facing, row + (points[..., 1] / np.float32(_CELL_M)).astype(np.int32), row)
        texture = self._texture[row % _CHAINAGES, column % _ANGLES]
        away = hits.depth * np.sqrt(np.einsum("...i,...i->...", direction, direction))
        light = (
            np.maximum(hits.cosine, np.float32(0.05)) ** np.float32(0.4)
            * np.float32(1.25)
            / (1 + (away / np.float32(0.7)) ** 2)
        )
        wet = hits.material == world.WATER
        ripples = self._rng.random(wet.shape, np.float32)
        texture = np.where(wet, np.where(ripples > np.float32(0.985), np.float32(3.2), np.float32(1.0)), texture)
        painted = self._colors[hits.material] * (light * texture)[..., None]
        exposure = _EXPOSED_TO / max(float(np.percentile(painted[::4, ::4], 85)), 1e-3)
        painted = 255 * (1 - np.exp(painted * np.float32(-exposure / 160)))
        painted += self._rng.normal(0, 1, painted.shape[:2]).astype(np.float32)[..., None]
        small = np.clip(painted, 0, 255).astype(np.uint8)
        return np.asarray(cv2.resize(small, size, interpolation=cv2.INTER_CUBIC), np.uint8)
