"""CCTV pictures of the virtual sewer.

Rays of every second pixel are cast to the wall in closed form and enlarged to the whole picture; what they meet is looked up in
a strip of the unrolled wall (``wall.py``) that has one row for each pixel of radius, so that near texture is sharp, far texture
averaged, and everything sticks to the wall. Two fields of an interlaced picture are two moments.
"""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.virtual.camera import CctvCamera
from drivers.virtual.look import Look
from drivers.virtual.rig import Pose
from drivers.virtual.wall import COLUMNS, Wall
from drivers.virtual.world import VirtualSewer

Array = NDArray[np.float32]
Picture = NDArray[np.uint8]
_COARSE = 2
"""Rays are cast for every second pixel."""
_MARGIN = 2
"""Coarse cells around the picture, so that enlarging needs no guess at its border."""
_NEAREST_RING_PX = 9.0
"""Rings smaller than this (px) are the dark at the end of the pipe."""


class Renderer:
    """Draws what one ``camera`` sees of one ``sewer``. Keeps what is common to all its pictures; a picture depends on its
    arguments alone."""

    def __init__(self, sewer: VirtualSewer, camera: CctvCamera, look: Look, seed: int = 1) -> None:
        self.sewer, self.camera, self.look = sewer, camera, look
        self._wall = Wall(sewer, look, seed)
        self._focal = float(np.sqrt(camera.fx * camera.fy))
        self._reach_px = 1.35 * float(np.hypot(camera.width / 2, camera.height / 2)) * self._focal / min(camera.fx, camera.fy)
        self._ring_px = np.arange(_NEAREST_RING_PX, self._reach_px, 1.2, dtype=np.float32)
        self._noise = _grains(np.random.default_rng([seed, 51]), camera.height, camera.width)

    def picture(self, pose: Pose, rng: np.random.Generator, before: Pose | None = None, texts: tuple[str, ...] = ()) -> Picture:
        """(H, W, 3) uint8 BGR from ``pose``. In an interlaced look the odd lines were taken at ``before``; in one with text the
        lines of ``texts`` are burned in."""
        strip, start = self._strip(pose)
        maps = self._maps(pose, start)
        if self.look.interlace and before is not None:
            for mine, earlier in zip(maps, self._maps(before, start), strict=True):
                mine[1::2] = earlier[1::2]
        # the ring nearest to the camera may lie past the strip's end at a corner: it is as bright as the last
        found = cv2.remap(strip, *maps, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        return self._recorded(np.asarray(found, np.uint8), rng, texts)

    def _strip(self, pose: Pose) -> tuple[Picture, float]:
        """The lit wall ahead: one row for each ring of ``_ring_px``, far to near; and the chainage that their depths count
        from."""
        depth = np.float32(self._focal * self.sewer.radius) / self._ring_px
        span = depth * depth * np.float32(1.2 / (self._focal * self.sewer.radius))
        rows = self._wall.rows(depth + np.float32(pose.chainage), span)
        return self._lit(rows, depth), pose.chainage

    def _lit(self, rows: Picture, depth: Array) -> Picture:
        """Light falls off from the camera; a little fog shines before the dark."""
        look = self.look
        far = depth / np.float32(2 * self.sewer.radius * look.reach)
        # the cone of the lamp leaves out what is beside the camera
        beside = 1 - np.float32(0.25) * np.exp(-((depth / np.float32(1.2 * self.sewer.radius)) ** 2))
        light = np.float32(look.lamp) / (1 + (np.float32(2.2) * far) ** np.float32(look.falloff)) * beside
        angle = np.arange(COLUMNS + 2, dtype=np.float32) * np.float32(2 * np.pi / COLUMNS)
        side = 1 + np.float32(look.lamp_side) * np.cos(angle - np.float32(look.lamp_angle))
        fog = np.float32(look.haze) * far / (np.float32(0.35) + far)
        lit = rows.astype(np.float32) * np.float32(1 / 180)
        lit *= (light[:, None] * side[None, :])[..., None]
        lit += fog[:, None, None]
        table = _film()
        lit *= np.float32(_FILM_STEPS / _FILM_WHITE)
        np.minimum(lit, _FILM_STEPS - 1, out=lit)
        return table[lit.astype(np.uint16)]

    def _maps(self, pose: Pose, start: float) -> tuple[Array, Array]:
        """Column and row of the strip (H, W) for every pixel."""
        x, y, ring = self._cast(pose, start)
        height, width = self.camera.height, self.camera.width
        large = cv2.resize(
            cv2.merge([x, y, ring]),
            (width + 2 * _COARSE * _MARGIN, height + 2 * _COARSE * _MARGIN),
            interpolation=cv2.INTER_LINEAR,
        )
        edge = _COARSE * _MARGIN
        planes = cv2.split(large[edge : edge + height, edge : edge + width])
        column = np.asarray(cv2.phase(planes[0], planes[1]), np.float32)
        column *= np.float32(COLUMNS / (2 * np.pi))
        # cell k is centred at angle (k + 1/2) cells; the half cell before the first is the seam's other side
        column -= np.float32(0.5)
        column[column < 0] += np.float32(COLUMNS)
        row = np.asarray(planes[2], np.float32)
        row -= np.float32(_NEAREST_RING_PX)
        row *= np.float32(1 / 1.2)
        return column, row

    def _cast(self, pose: Pose, start: float) -> tuple[Array, Array, Array]:
        """Where the coarse rays meet the wall: its direction (x, y) seen from the axis, and the radius (px) of the ring."""
        ray = _rays(self.camera)
        turn = pose.rotation.astype(np.float32)
        dx, dy, dz = (turn[k, 0] * ray[0] + turn[k, 1] * ray[1] + turn[k, 2] for k in range(3))
        ox, oy = np.float32(pose.right), np.float32(pose.down)
        a = dx * dx + dy * dy + np.float32(1e-9)
        b = ox * dx + oy * dy
        profile = self.sewer.profile
        radius: Array | np.float32 = np.float32(self.sewer.radius)
        away = ox * ox + oy * oy
        depth = (np.sqrt(b * b - a * (away - radius * radius)) - b) / a
        x, y = ox + depth * dx, oy + depth * dy
        if not profile.round:
            for _ in range(4):
                radius = profile.radius(np.arctan2(y, x))
                depth = (np.sqrt(np.maximum(b * b - a * (away - radius * radius), 0)) - b) / a
                x, y = ox + depth * dx, oy + depth * dy
        ahead = depth * dz + np.float32(pose.chainage - start)
        ring = np.float32(self._focal * self.sewer.radius) / np.maximum(ahead, np.float32(1e-3))
        return x, y, np.minimum(ring, np.float32(4 * self._reach_px))

    def _recorded(self, picture: Picture, rng: np.random.Generator, texts: tuple[str, ...]) -> Picture:
        """What lens, sensor and recorder do to it."""
        look = self.look
        if look.blur > 0.3:
            picture = np.asarray(cv2.GaussianBlur(picture, (0, 0), look.blur), np.uint8)
        if look.text:
            _write(picture, texts)
        if look.noise > 0:
            top, left = rng.integers(0, _grain_play(self._noise, self.camera), 2)
            grains = self._noise[top : top + self.camera.height, left : left + self.camera.width]
            grains = np.asarray(cv2.merge([grains] * 3), np.uint8)
            picture = np.asarray(cv2.addWeighted(picture, 1.0, grains, look.noise / _GRAIN_STD, -128 * look.noise / _GRAIN_STD))
        if look.jpeg < 100:
            _, data = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, look.jpeg])
            picture = np.asarray(cv2.imdecode(data, cv2.IMREAD_COLOR), np.uint8)
        return picture


def render(
    sewer: VirtualSewer,
    camera: CctvCamera,
    pose: Pose,
    rng: np.random.Generator,
    look: Look | None = None,
    before: Pose | None = None,
    seed: int = 1,
) -> Picture:
    """(H, W, 3) uint8 BGR of ``sewer`` from ``pose``; ``rng`` makes the sensor's noise, ``seed`` the wall. ``before`` is where
    the camera was at the other field of an interlaced picture."""
    return _renderer(sewer, camera, look or Look(), seed).picture(pose, rng, before)


@lru_cache(maxsize=4)
def _renderer(sewer: VirtualSewer, camera: CctvCamera, look: Look, seed: int) -> Renderer:
    return Renderer(sewer, camera, look, seed)


@lru_cache(maxsize=4)
def _rays(camera: CctvCamera) -> tuple[Array, Array]:
    """(X/Z, Y/Z) of the middles of coarse cells, ``_MARGIN`` cells beyond the picture."""

    def middles(size: int, focal: float, centre: float) -> Array:
        cells = np.arange(-_MARGIN, size // _COARSE + _MARGIN, dtype=np.float32)
        return (((cells + np.float32(0.5)) * _COARSE - np.float32(0.5 + centre)) / np.float32(focal)).astype(np.float32)

    x, y = np.meshgrid(middles(camera.width, camera.fx, camera.cx), middles(camera.height, camera.fy, camera.cy))
    return x, y


_FILM_STEPS, _FILM_WHITE = 4096, 8.0
_GRAIN_STD = 20.0


@lru_cache(maxsize=1)
def _film() -> Picture:
    """Grey level of light 0 to ``_FILM_WHITE``: linear in the dark, saturating softly."""
    light = np.arange(_FILM_STEPS) * (_FILM_WHITE / _FILM_STEPS)
    return np.asarray(np.clip(255 * (1 - np.exp(-light)), 0, 255), np.uint8)


def _grains(rng: np.random.Generator, height: int, width: int) -> Picture:
    """Sensor noise around 128, larger than a picture, so that each takes another part of it."""
    grains = rng.normal(128, _GRAIN_STD * 1.6, (height + 64, width + 64)).astype(np.float32)
    return np.clip(cv2.GaussianBlur(grains, (0, 0), 0.5), 0, 255).astype(np.uint8)


def _write(picture: Picture, texts: tuple[str, ...]) -> None:
    """White letters on a dark seam, at the lower left."""
    for line, text in enumerate(reversed(texts)):
        at = (24, picture.shape[0] - 28 - 30 * line)
        for color, thick in (((0, 0, 0), 4), ((235, 235, 235), 2)):
            cv2.putText(picture, text, at, cv2.FONT_HERSHEY_DUPLEX, 0.8, color, thick, cv2.LINE_AA)


def _grain_play(noise: Picture, camera: CctvCamera) -> int:
    return min(int(noise.shape[0]) - camera.height, int(noise.shape[1]) - camera.width)
