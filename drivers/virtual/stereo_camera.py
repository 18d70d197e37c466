"""A stereo pair in the virtual sewer: both pictures of the same painted wall, rectified, with the noise of a sensor.

The paint is a function of the place in the pipe alone, so that both cameras see the same grain; light falls off with the
distance and with the angle of incidence, as from a lamp at the camera.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.base import SensorLost
from drivers.stereo.base import StereoCamera, StereoFrame
from drivers.virtual.rig import Pose
from drivers.virtual.world import END, NOTHING, VirtualSewer
from estimators.pinhole import Intrinsics, rays

Array = NDArray[np.float32]

_TILE = 1024
_TILE_M = 1.6
"""Length of pipe after which the grain comes again."""
_STEP_M = 0.25


@dataclass(frozen=True)
class StereoLook:
    """``grain`` is the contrast of the wall's texture (0.3 weathered concrete, 0.02 new plastic); ``smooth`` stretches of pipe,
    (from, to) in m, with a tenth of it; ``light`` the mean grey; ``noise`` of the sensor in grey values."""

    grain: float = 0.25
    smooth: tuple[tuple[float, float], ...] = ()
    light: float = 110.0
    noise: float = 1.5


@dataclass(frozen=True)
class StereoLens:
    """A rectified pair: two pin-hole cameras side by side, ``baseline_m`` apart. ``offset_px`` is added to every disparity, as
    by pictures that were shifted sideways."""

    intrinsics: Intrinsics = field(default_factory=lambda: Intrinsics(960, 600, 560.0, 560.0, 479.5, 299.5))
    baseline_m: float = 0.06
    offset_px: float = 0.0


class StereoPainter:
    """Renders pairs of one ``sewer``; the grain follows from ``seed``."""

    def __init__(self, sewer: VirtualSewer, lens: StereoLens, look: StereoLook, seed: int) -> None:
        self.sewer, self.lens, self.look = sewer, lens, look
        rng = np.random.default_rng([seed, 6])
        grain = np.zeros((_TILE, _TILE), np.float32)
        for sigma, share in ((0.8, 0.5), (2.0, 0.6), (6.0, 0.5), (20.0, 0.3)):
            layer = cv2.GaussianBlur(
                np.tile(rng.normal(size=(_TILE // 2, _TILE // 2)).astype(np.float32), (2, 2)), (0, 0), sigma
            )
            grain += np.float32(share) * layer / layer.std()
        self._grain = np.pad(np.clip(grain / grain.std(), -2.5, 2.5), ((0, 1), (0, 1)), mode="wrap")

    def pair(self, pose: Pose, rng: np.random.Generator) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
        """(left, right), each (H, W) grey."""
        right = pose.position + pose.rotation @ np.array([self.lens.baseline_m, 0.0, 0.0])
        shifts = 0.0, self.lens.offset_px
        left, other = (
            self._picture(place, pose.rotation, shift, rng) for place, shift in zip((pose.position, right), shifts, strict=True)
        )
        return left, other

    def _picture(
        self, position: NDArray[np.float64], rotation: NDArray[np.float64], shift: float, rng: np.random.Generator
    ) -> NDArray[np.uint8]:
        camera = self.lens.intrinsics
        sight = rays(camera) + np.array([shift / camera.fx, 0.0], np.float32)
        hits = self.sewer.cast(position, rotation, sight)
        direction = np.concatenate([sight, np.ones((*sight.shape[:-1], 1), np.float32)], axis=-1) @ rotation.T.astype(
            np.float32
        )
        place = position.astype(np.float32) + hits.depth[..., None] * direction
        x, y, z = place[..., 0], place[..., 1], place[..., 2]
        around = np.arctan2(y, x) * np.float32(_TILE / (2 * np.pi)) % _TILE
        along = z * np.float32(_TILE / _TILE_M) % _TILE
        end = hits.material == END
        around = np.where(end, x * np.float32(_TILE / _TILE_M) % _TILE, around).astype(np.float32)
        along = np.where(end, y * np.float32(_TILE / _TILE_M) % _TILE, along).astype(np.float32)
        grain = cv2.remap(self._grain, around, along, cv2.INTER_LINEAR)
        contrast = np.full(z.shape, self.look.grain, np.float32)
        for first, last in self.look.smooth:
            contrast[(z >= first) & (z < last) & ~end] *= np.float32(0.1)
        distance = np.linalg.norm(direction, axis=-1) * hits.depth
        lit = np.sqrt(np.clip(hits.cosine, 0.02, 1)) / np.maximum(distance, 0.15)
        lit *= np.float32(self.look.light) / max(float(np.median(lit[hits.material != NOTHING])), 1e-6)
        picture = np.where(hits.material == NOTHING, 0.0, np.minimum(lit, 210.0) * (1 + contrast * grain))
        picture = picture + rng.normal(0, self.look.noise, z.shape)
        return np.asarray(np.clip(picture, 0, 255), dtype=np.uint8)


class VirtualStereoCamera(StereoCamera):
    """Pairs along a drive through a virtual sewer: from ``start`` (m) on, a step further at each read, back again at the
    end."""

    name = "virtual stereo camera"

    def __init__(self, painter: StereoPainter, start: float = 0.3, seed: int = 1) -> None:
        self._painter = painter
        self._start = start
        self._seed = seed
        self._number: int | None = None

    def _open(self) -> None:
        self._number = 0

    def pose(self, number: int) -> Pose:
        """Where the camera is at a pair, a little off the axis."""
        way = max(self._painter.sewer.length - self._start - 1.2, _STEP_M)
        radius = self._painter.sewer.radius
        rng = np.random.default_rng([self._seed, number])
        right, down = rng.uniform(-0.08, 0.08, 2) * radius
        yaw, pitch = rng.uniform(-0.03, 0.03, 2)
        return Pose(float(right), float(down), self._start + (number * _STEP_M) % way, float(yaw), float(pitch))

    def _read(self, timeout_s: float) -> StereoFrame:
        if self._number is None:
            raise SensorLost(f"The {self.name} is not open.")
        number = self._number
        self._number += 1
        left, right = self._painter.pair(self.pose(number), np.random.default_rng([self._seed, number, 7]))
        lens = self._painter.lens
        return StereoFrame(
            left, right, lens.intrinsics, lens.baseline_m, lens.offset_px, time.monotonic_ns(), number + 1, source="virtual"
        )

    def close(self) -> None:
        """Stop. Never raises, may be called twice."""
        self._number = None
