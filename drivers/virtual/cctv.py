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
from drivers.virtual.film import FILM_STEPS, FILM_WHITE, film
from drivers.virtual.look import Look
from drivers.virtual.relief import Relief, march
from drivers.virtual.rig import Pose
from drivers.virtual.roots import RootTufts
from drivers.virtual.wall import ALBEDO_STEPS, COLUMNS, Wall
from drivers.virtual.world import VirtualSewer

Array = NDArray[np.float32]
Picture = NDArray[np.uint8]
_COARSE = 4
"""Rays are cast for every fourth pixel of every fourth line, in each field anew."""
_RING_STEP = 1.2
"""Rows of the strip are so far apart in the picture (px)."""
_MARGIN = 2
"""Coarse cells around the picture, so that enlarging needs no guess at its border."""
_NEAREST_RING_PX = 9.0
"""Rings smaller than this (px) are the dark at the end of the pipe."""
_RELIEF_M = 3.5
"""What stands out of the wall farther ahead than this is drawn flat."""
_SHELLS = 9
_HEIGHT_M = 0.005


class Renderer:
    """Draws what one ``camera`` sees of one ``sewer``. Keeps what is common to all its pictures; a picture depends on its
    arguments alone."""

    def __init__(self, sewer: VirtualSewer, camera: CctvCamera, look: Look, seed: int = 1) -> None:
        self.sewer, self.camera, self.look = sewer, camera, look
        self._wall = Wall(sewer, look, seed)
        self._focal = float(np.sqrt(camera.fx * camera.fy))
        self._reach_px = 1.35 * float(np.hypot(camera.width / 2, camera.height / 2)) * self._focal / min(camera.fx, camera.fy)
        self._relief = Relief(sewer.things, sewer.radius, pockets=False)
        self._height = _height_table(self._relief, sewer.length)
        self._roots = RootTufts(sewer, camera, look, seed)
        self._noise = _grains(np.random.default_rng([seed, 51]), camera.height, camera.width)

    def picture(
        self,
        pose: Pose,
        rng: np.random.Generator,
        before: Pose | None = None,
        texts: tuple[str, ...] = (),
        moment: float = 0.0,
    ) -> Picture:
        """(H, W, 3) uint8 BGR from ``pose``. In an interlaced look the odd lines were taken at ``before``; in one with text the
        lines of ``texts`` are burned in. ``moment`` (s) moves the water."""
        earlier = before if self.look.interlace and before is not None else pose
        fields = [self._cast(one, field, pose.chainage, moment) for field, one in enumerate((pose, earlier))]
        nearest = max(float(planes[2].max()) for planes in fields)
        strip = self._strip(pose.chainage, min(nearest + 3 * _RING_STEP, self._reach_px))
        seen = self._maps(fields)
        # a ring nearer than the strip's end is as bright as the last
        picture = np.asarray(cv2.remap(strip, seen[0], seen[1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE), np.uint8)
        if len(seen) > 2:
            self._water(picture, seen[2], seen[3])
        self._roots.draw(picture, pose, self._light)
        return self._recorded(picture, rng, texts)

    def _strip(self, start: float, nearest_px: float) -> Picture:
        """The lit wall ahead of chainage ``start``: one row for each ring, from the farthest to the nearest."""
        ring = np.arange(_NEAREST_RING_PX, nearest_px, _RING_STEP, dtype=np.float32)
        depth = np.float32(self._focal * self.sewer.radius) / ring
        span = depth * depth * np.float32(_RING_STEP / (self._focal * self.sewer.radius))
        return self._lit(self._wall.rows(depth + np.float32(start), span), depth)

    def _light(self, depth: Array) -> Array:
        """How much light falls on what lies ``depth`` (m) ahead."""
        look = self.look
        far = depth / np.float32(2 * self.sewer.radius * look.reach)
        # the cone of the lamp leaves out what is beside the camera
        beside = 1 - np.float32(0.25) * np.exp(-((depth / np.float32(1.2 * self.sewer.radius)) ** 2))
        return np.asarray(
            np.float32(look.lamp) / (1 + (np.float32(2.2) * far) ** np.float32(look.falloff)) * beside, np.float32
        )

    def _lit(self, rows: Picture, depth: Array) -> Picture:
        """Light falls off from the camera; a little fog shines before the dark. ``rows`` (n, m, 3) are lit in place."""
        far = depth / np.float32(2 * self.sewer.radius * self.look.reach)
        fog = np.float32(self.look.haze) * far / (np.float32(0.35) + far)
        albedo = np.arange(256, dtype=np.float32) * np.float32(1 / ALBEDO_STEPS)
        exposed = (albedo * self._light(depth)[:, None] + fog[:, None]) * np.float32(FILM_STEPS / FILM_WHITE)
        table = film()[np.minimum(exposed, FILM_STEPS - 1).astype(np.uint16)]
        for row, grey in zip(rows, table, strict=True):
            cv2.LUT(row, grey, row)
        return rows

    def _maps(self, fields: list[tuple[Array, ...]]) -> tuple[Array, ...]:
        """Column and row of the strip (H, W) for every pixel; with water also how much of it is seen, and how far ahead."""
        height, width = self.camera.height, self.camera.width
        found = tuple(np.empty((height, width), np.float32) for _ in range(len(fields[0]) - 1))
        for field, planes in enumerate(fields):
            x, y, ring, *wet = (self._enlarged(plane) for plane in planes)
            column = np.asarray(cv2.phase(x, y), np.float32)
            column *= np.float32(COLUMNS / (2 * np.pi))
            # cell k is centred at angle (k + 1/2) cells; the half cell before the first is the seam's other side
            column -= np.float32(0.5)
            column[column < 0] += np.float32(COLUMNS)
            ring -= np.float32(_NEAREST_RING_PX)
            ring *= np.float32(1 / _RING_STEP)
            for whole, plane in zip(found, (column, ring, *wet), strict=True):
                whole[field::2] = plane
        return found

    def _enlarged(self, plane: Array) -> Array:
        """A coarse plane for every pixel (H / 2, W) of a field."""
        height, width = self.camera.height // 2, self.camera.width
        size = (width + 2 * _MARGIN * _COARSE, height + _MARGIN * _COARSE)
        large = cv2.resize(plane, size, interpolation=cv2.INTER_LINEAR)
        edge = _MARGIN * _COARSE
        return np.ascontiguousarray(large[edge // 2 : edge // 2 + height, edge : edge + width], np.float32)

    def _cast(self, pose: Pose, field: int, start: float, moment: float) -> tuple[Array, ...]:
        """Where the coarse rays of a field end: the direction (x, y) from the axis, and the radius (px) of the ring there. With
        water also whether they met it first, 0 to 1, and how far ahead (m): then they go on, mirrored, to the wall."""
        ray = _rays(self.camera, field)
        turn = pose.rotation.astype(np.float32)
        dx, dy, dz = (turn[k, 0] * ray[0] + turn[k, 1] * ray[1] + turn[k, 2] for k in range(3))
        ox, oy, oz = (np.float32(value) for value in (pose.right, pose.down, pose.chainage - start))
        depth = self._to_wall(ox, oy, dx, dy)
        if self._relief:
            self._stand_out(depth, pose, (dx, dy, dz))
        x, y, ahead = ox + depth * dx, oy + depth * dy, oz + depth * dz
        wet: tuple[Array, ...] = ()
        if self.sewer.water > 0:
            surface = np.float32(self.sewer.profile.below() - self.sewer.water)
            # where the water meets the wall it wets it unevenly
            shore = np.sin((pose.chainage + depth * dz) * np.float32(37.0)) + np.sin(
                (pose.chainage + depth * dz) * np.float32(91.0)
            )
            lap = np.float32(0.06 * self.sewer.water) * shore.astype(np.float32)
            under = y > surface + lap
            reach = np.where(under, (surface - oy) / np.maximum(dy, np.float32(1e-4)), 0).astype(np.float32)
            soft = np.clip((y - surface - lap) / np.float32(0.08 * self.sewer.water), 0, 1)
            wet = (np.where(under, soft, 0).astype(np.float32), oz + reach * dz)
            rows = slice(int(np.argmax(under.any(axis=1))), len(y)) if under.any() else slice(0, 0)
            u, px, pz = under[rows], (ox + reach * dx)[rows], wet[1][rows] + np.float32(start)
            slope_x, slope_z = self._ripples(px, pz, moment)
            mx, my, mz = dx[rows] + slope_x, -dy[rows], dz[rows] + slope_z
            # reflected at (px, surface): the way to the wall from there, with a place of its own for every ray
            a, b = mx * mx + my * my + np.float32(1e-9), px * mx + surface * my
            inside = px * px + surface * surface - np.float32(self.sewer.radius**2)
            on = (np.sqrt(np.maximum(b * b - a * inside, 0)) - b) / a
            x[rows], y[rows] = np.where(u, px + on * mx, x[rows]), np.where(u, surface + on * my, y[rows])
            ahead[rows] = np.where(u, wet[1][rows] + on * mz, ahead[rows])
        ring = np.float32(self._focal * self.sewer.radius) / np.maximum(ahead, np.float32(1e-3))
        return (x, y, np.minimum(ring, np.float32(4 * self._reach_px)), *wet)

    def _to_wall(self, ox: np.float32, oy: np.float32, dx: Array, dy: Array) -> Array:
        """Depth at which rays leave the profile: a circle solved exactly, its radius renewed from the angle it was met at."""
        profile = self.sewer.profile
        a = dx * dx + dy * dy + np.float32(1e-9)
        b = ox * dx + oy * dy
        away = ox * ox + oy * oy
        depth = (np.sqrt(b * b - a * (away - np.float32(self.sewer.radius**2))) - b) / a
        for _ in range(0 if profile.round else 4):
            radius = profile.radius(np.arctan2(oy + depth * dy, ox + depth * dx))
            depth = (np.sqrt(np.maximum(b * b - a * (away - radius * radius), 0)) - b) / a
        return np.asarray(depth, np.float32)

    def _stand_out(self, depth: Array, pose: Pose, ray: tuple[Array, Array, Array]) -> None:
        """Shorten or lengthen ``depth`` where rays meet a deposit or a displaced pipe."""
        z = np.float32(pose.chainage) + depth * ray[2]
        ahead = [span for span in self._relief.spans if span[1] > pose.chainage and span[0] < pose.chainage + _RELIEF_M]
        if not ahead:
            return
        angle = np.arctan2(np.float32(pose.down) + depth * ray[1], np.float32(pose.right) + depth * ray[0])
        near = self._relief.near(z, angle) & (z < pose.chainage + _RELIEF_M)
        if near.any():
            rays = (ray[0][near], ray[1][near], ray[2][near])
            radius, low, high = self.sewer.radius, self._relief.low, self._relief.high
            depth[near] = march(self._heights, radius, low, high, (pose.right, pose.down, pose.chainage), rays, _SHELLS)

    def _heights(self, z: Array, angle: Array) -> Array:
        """Of the relief, from a table."""
        rows, columns = self._height.shape
        row = np.clip((z * np.float32(1 / _HEIGHT_M)).astype(np.int32), 0, rows - 1)
        column = ((angle + np.float32(np.pi)) * np.float32(columns / (2 * np.pi))).astype(np.int32) % columns
        return np.asarray(self._height[row, column], np.float32)

    def _ripples(self, x: Array, z: Array, moment: float) -> tuple[Array, Array]:
        """Slopes of the water's surface at (x, z), doubled as a mirror doubles them; it flows along the pipe."""
        steep = np.float32(self.look.ripples)
        flowed = z - np.float32(0.25 * moment)
        along = np.sin(flowed * np.float32(71.0) + x * np.float32(40.0)) + np.sin(
            flowed * np.float32(173.0) - x * np.float32(61.0)
        )
        across = np.sin(flowed * np.float32(47.0) + x * np.float32(118.0) + np.float32(1.0))
        return steep * across, steep * along

    def _water(self, picture: Picture, share: Array, ahead: Array) -> None:
        """Darken the mirror image on the water, more where it is looked into steeply, and add the water's own colour."""
        rows, columns = np.flatnonzero(share.any(axis=1)), np.flatnonzero(share.any(axis=0))
        if len(rows) == 0:
            return
        part = slice(int(rows[0]), int(rows[-1]) + 1), slice(int(columns[0]), int(columns[-1]) + 1)
        amount, depth = share[part], np.maximum(ahead[part], np.float32(0.05))
        height = np.float32(self.sewer.profile.below() - self.sewer.water)
        # the share that water mirrors grows steeply towards grazing; its powers by hand, for ** is slow
        grazing2 = depth * depth / (depth * depth + height * height)
        mirror = amount * (np.float32(0.15) + np.float32(0.6) * (grazing2 * grazing2 * grazing2))
        dry = 1 - amount + mirror
        # light is smooth: once for each line is enough
        own = amount * (self._light(np.maximum(ahead[part[0]].max(axis=1), np.float32(0.05))) * np.float32(0.35 * 255))[:, None]
        colored = np.asarray(cv2.merge([own * np.float32(share) for share in self.look.water]), np.float32)
        seen = np.asarray(cv2.multiply(picture[part].astype(np.float32), cv2.merge([dry, dry, dry])), np.float32)
        picture[part] = np.minimum(seen + colored, 255).astype(np.uint8)

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
    moment: float = 0.0,
) -> Picture:
    """(H, W, 3) uint8 BGR of ``sewer`` from ``pose``; ``rng`` makes the sensor's noise, ``seed`` the wall. ``before`` is where
    the camera was at the other field of an interlaced picture, ``moment`` (s) moves the water."""
    return _renderer(sewer, camera, look or Look(), seed).picture(pose, rng, before, moment=moment)


@lru_cache(maxsize=4)
def _renderer(sewer: VirtualSewer, camera: CctvCamera, look: Look, seed: int) -> Renderer:
    return Renderer(sewer, camera, look, seed)


@lru_cache(maxsize=8)
def _rays(camera: CctvCamera, field: int) -> tuple[Array, Array]:
    """(X/Z, Y/Z) of the middles of coarse cells of one field, ``_MARGIN`` cells beyond the picture. Two lines of a field lie in
    a cell: those of the even field begin at line 0, those of the odd one at 1."""

    def middles(size: int, shift: float, focal: float, centre: float) -> Array:
        cells = np.arange(-_MARGIN, size // _COARSE + _MARGIN, dtype=np.float32)
        return ((cells * _COARSE + np.float32(shift - centre)) / np.float32(focal)).astype(np.float32)

    across = middles(camera.width, (_COARSE - 1) / 2, camera.fx, camera.cx)
    x, y = np.meshgrid(across, middles(camera.height, field + _COARSE / 2 - 1, camera.fy, camera.cy))
    return x, y


_GRAIN_STD = 20.0


def _height_table(relief: Relief, length: float) -> Array:
    """Heights (n, 512) from chainage 0 on, image angle -pi on."""
    rows = int(length / _HEIGHT_M) + 1 if relief else 1
    table = np.zeros((rows, 512), np.float32)
    angle = (np.arange(512, dtype=np.float32) + np.float32(0.5)) * np.float32(2 * np.pi / 512) - np.float32(np.pi)
    for begin, end, _, _ in relief.spans:
        part = slice(max(int(begin / _HEIGHT_M), 0), min(int(end / _HEIGHT_M) + 1, rows))
        z = (np.arange(part.start, part.stop, dtype=np.float32) + np.float32(0.5)) * np.float32(_HEIGHT_M)
        table[part] = relief.height(z[:, None], angle[None, :])
    return table


def _grains(rng: np.random.Generator, height: int, width: int) -> Picture:
    """Sensor noise around 128, larger than a picture, so that each takes another part of it."""
    grains = rng.normal(128, _GRAIN_STD * 1.6, (height + 64, width + 64)).astype(np.float32)
    return np.clip(cv2.GaussianBlur(grains, (0, 0), 0.5), 0, 255).astype(np.uint8)


def _write(picture: Picture, texts: tuple[str, ...]) -> None:
    """White letters on dark bars, at the lower left."""
    for line, text in enumerate(reversed(texts)):
        left, base = 24, picture.shape[0] - 28 - 30 * line
        (width, height), below = cv2.getTextSize(text, cv2.FONT_HERSHEY_DUPLEX, 0.8, 1)
        picture[base - height - 3 : base + below, left - 4 : left + width + 4] //= 4
        cv2.putText(picture, text, (left, base), cv2.FONT_HERSHEY_DUPLEX, 0.8, (235, 235, 235), 1, cv2.LINE_AA)


def _grain_play(noise: Picture, camera: CctvCamera) -> int:
    return min(int(noise.shape[0]) - camera.height, int(noise.shape[1]) - camera.width)
