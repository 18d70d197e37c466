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

from drivers.base import FrameTimeout, SensorLost, SensorMissing
from drivers.stereo.base import StereoCamera, StereoFrame
from drivers.virtual.faults import FaultScript
from drivers.virtual.rig import Pose
from drivers.virtual.world import END, JOINT, NOTHING, VirtualSewer
from estimators.pinhole import Intrinsics, rays

Array = NDArray[np.float32]

_TILE = 1024
_TILE_M = 1.6
"""Length of pipe after which the grain comes again."""
_STEP_M = 0.25


@dataclass(frozen=True)
class StereoLook:
    """``grain`` is the contrast of the wall's texture (0.3 weathered concrete, 0.02 new plastic); ``smooth`` stretches of pipe,
    (from, to) in m, with a tenth of it; ``light`` the mean grey; ``noise`` of the sensor in grey values; ``gap`` how bright the
    inside of a joint is against the wall (its seal is black, its ground in shadow)."""

    grain: float = 0.25
    smooth: tuple[tuple[float, float], ...] = ()
    light: float = 110.0
    noise: float = 1.5
    gap: float = 1.0


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
        return self.taken(self.scene(pose), rng)

    def scene(self, pose: Pose) -> tuple[Array, Array]:
        """(left, right) as light falls on the sensors, each (H, W) in grey values: the costly part."""
        right = pose.position + pose.rotation @ np.array([self.lens.baseline_m, 0.0, 0.0])
        return self._picture(pose.position, pose.rotation, 0.0), self._picture(right, pose.rotation, self.lens.offset_px)

    def taken(self, scene: tuple[Array, Array], rng: np.random.Generator) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
        """One exposure of it."""
        left, right = (
            np.asarray(np.clip(light + rng.normal(0, self.look.noise, light.shape), 0, 255), dtype=np.uint8) for light in scene
        )
        return left, right

    def _picture(self, position: NDArray[np.float64], rotation: NDArray[np.float64], shift: float) -> Array:
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
        lit[hits.material == JOINT] *= np.float32(self.look.gap)
        picture = np.where(hits.material == NOTHING, 0.0, np.minimum(lit, 210.0) * (1 + contrast * grain))
        return np.asarray(picture)


class VirtualStereoCamera(StereoCamera):
    """Pairs along a drive through a virtual sewer: from ``start`` (m) on, ``dwell`` exposures at each place and then a step
    further, back again at the end; ``rate_hz`` a second, or as fast as they are asked for. Closed and opened again it is where
    it was."""

    name = "virtual stereo camera"

    def __init__(
        self,
        painter: StereoPainter,
        start: float = 0.3,
        seed: int = 1,
        dwell: int = 1,
        rate_hz: float | None = None,
        faults: FaultScript | None = None,
    ) -> None:
        self._painter = painter
        self._start = start
        self._seed = seed
        self._dwell = dwell
        self._period_s = 0.0 if rate_hz is None else 1.0 / rate_hz
        self.faults = faults or FaultScript()
        self._open_since: int | None = None
        self._number = 0
        self._due = 0.0
        self._place: int | None = None
        self._scene: tuple[Array, Array] | None = None
        self._frozen: tuple[NDArray[np.uint8], NDArray[np.uint8]] | None = None

    def _open(self) -> None:
        self.faults.begin()
        if "disconnect" in self.faults.active():
            raise SensorMissing(f"The {self.name} is not there.")
        self.faults.restarted()
        self._open_since = self.faults.times_unplugged()
        self._paint()  # here, where a driver may take its time
        self._due = time.monotonic()

    def pose(self, number: int) -> Pose:
        """Where the camera is at a place, a little off the axis."""
        way = max(self._painter.sewer.length - self._start - 1.2, _STEP_M)
        radius = self._painter.sewer.radius
        rng = np.random.default_rng([self._seed, number])
        right, down = rng.uniform(-0.08, 0.08, 2) * radius
        yaw, pitch = rng.uniform(-0.03, 0.03, 2)
        return Pose(float(right), float(down), self._start + (number * _STEP_M) % way, float(yaw), float(pitch))

    def _read(self, timeout_s: float) -> StereoFrame:
        if self._open_since is None or self._open_since != self.faults.times_unplugged():
            raise SensorLost(f"The {self.name} is not open.")
        active = self.faults.active()
        wait_s = self._due - time.monotonic()
        if wait_s > timeout_s or "never comes" in active:
            time.sleep(timeout_s)
            raise FrameTimeout(f"The {self.name} sent no pair for {timeout_s:.3g} s.")
        time.sleep(max(wait_s, 0.0))
        self._due = max(self._due, time.monotonic() - self._period_s) + self._period_s
        scene = self._paint()
        number = self._number
        self._number += 1
        left, right = self._exposed(scene, np.random.default_rng([self._seed, number, 7]), active)
        lens = self._painter.lens
        return StereoFrame(
            left, right, lens.intrinsics, lens.baseline_m, lens.offset_px, time.monotonic_ns(), number + 1, source="virtual"
        )

    def _paint(self) -> tuple[Array, Array]:
        """What is seen from where the camera stands now, painted once."""
        place = self._number // self._dwell
        if self._scene is None or place != self._place:
            self._scene, self._place = self._painter.scene(self.pose(place)), place
        return self._scene

    def _exposed(
        self, scene: tuple[Array, Array], rng: np.random.Generator, faults: frozenset[str]
    ) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
        if "freeze" in faults and self._frozen is not None:
            return self._frozen
        dim = np.float32(1 / 40 if "dark" in faults else 1)
        pair = self._painter.taken((scene[0] * dim, scene[1] * dim), rng)
        if "garbage" in faults:
            pair = rng.integers(0, 256, pair[0].shape, np.uint8), rng.integers(0, 256, pair[1].shape, np.uint8)
        if "wrong size" in faults:
            pair = pair[0], pair[1][: len(pair[1]) // 2]
        self._frozen = pair
        return pair

    def close(self) -> None:
        """Stop. Never raises, may be called twice."""
        self._open_since = None
