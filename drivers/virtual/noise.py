"""How depth cameras err: active stereo as the real D435i frames show it, and time of flight.

The figures of ``StereoNoise`` were read off the shared recordings by ``python -m tests.bench.noise_fit``, which prints the same
statistics of real and virtual frames side by side.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.virtual import world
from drivers.virtual.world import Hits
from estimators.pinhole import Intrinsics, rays

Array = NDArray[np.float32]
UNIT_M = 0.001
BASELINE_M = 0.05
_BANK = 12
_BANK_STEP = 1 / 32
"""Standard deviations that one count of a field in the bank stands for."""
_GHOST_M = 0.2
"""Where dirt on the window seems to hang."""
_NOTHING_M = 50.0
"""Where a ray meets nothing: as good as infinitely far."""


@dataclass(frozen=True)
class Window:
    """What stands between the camera and the pipe. ``scale``: relative error of every distance (plastic cover and calibration);
    ``smears``: blobs of dirt or drops as (x, y, radius) in fractions of the width, each a hole or, every third, a near
    ghost."""

    scale: float = 0.0
    smears: tuple[tuple[float, float, float], ...] = ()


@dataclass(frozen=True)
class Matching:
    """How a stereo matcher fails for reasons of geometry; the figures are the real D435i's (``tests.bench.noise_fit``).

    ``search_px``: largest disparity searched, at any width, so that a finer picture begins further away (0.167 m at 848 pixels,
    0.252 m at 1280). ``slant``: how much a disparity that changes along the row (pixels per pixel) costs, since the right eye
    sees a side wall squeezed or stretched: it is why small pipes show crown and invert and hardly any side; ``slant_noise`` is
    how much finer noise it brings. ``uneven``: how much light and texture differ between large patches. Light falls off with
    the cosine of incidence to the power ``angle``, and with range as 1 / (1 + ``fading`` range^2). The wall that closes
    a pipe is matched better by ``flat``, the last ``rim_px`` pixels (at 848 of width) of the pipe around it worse by ``rim``.
    What only the left eye sees is never matched, and false matches are alike in disparity, which at the left of the picture
    cannot be large.
    """

    search_px: float = 126.0
    slant: float = 2.6
    slant_noise: float = 2.0
    uneven: float = 0.4
    angle: float = 0.12
    fading: float = 0.02
    flat: float = 0.8
    rim: float = 0.6
    rim_px: float = 24.0


@dataclass(frozen=True)
class StereoNoise:
    """Active stereo. Standard deviations in pixels of disparity at 848 pixels of width; shares of the picture."""

    fine: float = 0.14
    """Within a few pixels."""
    coarse: float = 0.16
    """Over some 15 pixels, half of it fixed to the scene, since the same texture is matched each time."""
    grazing: float = 0.35
    """How much of it a surface seen at a grazing angle adds, per (1 / cosine - 1) up to 4."""
    steps: float = 32.0
    """Disparity steps a pixel."""
    light: float = 1.0
    """Emitter and lamp against the wall's texture: 1 as in a concrete pipe with the emitter on, 0 smooth and dark."""
    lattice: float = 0.12
    """Share of holes between the projector's dots on a well-lit wall."""
    speckles: float = 60.0
    """False matches a frame, where nothing true is seen."""
    matching: Matching = Matching()


@dataclass(frozen=True)
class TimeOfFlightNoise:
    """Time of flight: ``std`` (m) at 1 m growing with the square of range, ``multipath`` relative excess inside a concave pipe,
    ``flying`` share of edge pixels that lie between the two surfaces."""

    std: float = 0.004
    multipath: float = 0.02
    flying: float = 0.7
    nearest: float = 0.1


@dataclass
class StereoCamera:
    """One recording's worth of active stereo: what is fixed to the scene is drawn once, the rest anew for every frame."""

    intrinsics: Intrinsics
    noise: StereoNoise
    window: Window
    rng: np.random.Generator
    blur: float = 0.0
    """Standard deviation (pixels) of the smear by motion."""
    _fixed: Array = field(init=False)
    _texture: Array = field(init=False)
    _smear: NDArray[np.uint8] = field(init=False)
    _patches: Array = field(init=False)
    _columns: Array = field(init=False)

    def __post_init__(self) -> None:
        self._fixed = _field(self.intrinsics.size, 15, self.rng)
        self._texture = _field(self.intrinsics.size, 5, self.rng)
        self._smear = _smears(self.intrinsics.size, self.window)
        patches = self.rng.normal(size=(7, 11)).astype(np.float32) * np.float32(self.noise.matching.uneven)
        self._patches = np.asarray(cv2.resize(patches, self.intrinsics.size, interpolation=cv2.INTER_CUBIC), np.float32)
        self._columns = np.arange(self.intrinsics.width, dtype=np.float32)[None, :]

    def picture(self, hits: Hits) -> NDArray[np.uint16]:
        """A depth picture (H, W) uint16 in UNIT_M of what the rays met; ``hits`` may be on a coarser grid."""
        width, height = self.intrinsics.size
        noise, rng = self.noise, self.rng
        far = np.where(hits.depth > 0, hits.depth, np.float32(_NOTHING_M))
        cosine = np.maximum(hits.cosine, np.float32(0.02))
        true_depth = _enlarge(far, (width, height))
        water = (
            cv2.resize((hits.material == world.WATER).astype(np.uint8), (width, height), interpolation=cv2.INTER_NEAREST) > 0
        )
        pixels = np.float32(self.intrinsics.fx * BASELINE_M)
        disparity = np.asarray(pixels / true_depth, np.float32)
        if self.blur > 0:
            disparity = np.asarray(cv2.GaussianBlur(disparity, (0, 0), self.blur), np.float32)
        scale = np.float32(width / 848)
        coarse = (self._fixed + _field((width, height), 15, rng)) * np.float32(0.71 * noise.coarse)
        fine = _field((width, height), 3, rng) * np.float32(noise.fine)
        grazing = np.minimum(np.float32(0.5 * noise.grazing) * (1 / cosine - 1), np.float32(4 * noise.grazing))
        slant = self._slant(disparity)
        coarse *= 1 + _enlarge(grazing, (width, height))
        stray = coarse + fine * (np.float32(0.8) + np.float32(noise.matching.slant_noise) * slant)
        measured = disparity + stray * scale
        measured = np.round(measured * np.float32(noise.steps)) / np.float32(noise.steps)
        light = _enlarge(self._light(far, cosine), (width, height))
        seen = self._seen(light, water, self._favour(hits.material) - np.float32(noise.matching.slant) * slant)
        seen &= (disparity < noise.matching.search_px) & (self._columns > disparity)
        seen &= true_depth < np.float32(0.8 * _NOTHING_M)
        depth = np.where(seen & (measured > 0.05), pixels / np.maximum(measured, np.float32(0.05)), np.float32(0))
        depth = depth * np.float32(1 + self.window.scale)
        depth[self._smear == 1] = 0
        ghost = self._smear == 2
        depth[ghost] = np.float32(_GHOST_M) + np.float32(0.01) * self._texture[ghost]
        self._false_matches(depth)
        depth[:, : round(0.01 * width)] = 0
        return _millimetres(depth)

    def _light(self, depth: Array, cosine: Array) -> Array:
        """How well the wall is lit, 1 where nothing is lost: light falls off with range and angle."""
        matching = self.noise.matching
        falling = cosine ** np.float32(matching.angle) / (1 + np.float32(matching.fading) * depth**2)
        return np.asarray(np.float32(self.noise.light) * np.minimum(np.float32(1.3) * falling, 1), np.float32)

    def _seen(self, light: Array, water: NDArray[np.bool_], favour: Array) -> NDArray[np.bool_]:
        """Where a match is found: light and texture decide, and water mirrors most of it away."""
        texture = np.float32(0.6) * self._texture + np.float32(0.6) * _field(self.intrinsics.size, 4, self.rng)
        margin = light * np.float32(2.0) - np.float32(0.85 + 2 * (self.noise.lattice - 0.12)) + self._patches + favour
        margin = np.where(water, margin - np.float32(1.6), margin)
        return np.asarray(texture < margin * np.float32(1.2))

    def _favour(self, material: NDArray[np.uint8]) -> Array:
        """For a wall that closes the view, against the rim around it, where a window of the matcher holds both surfaces."""
        matching = self.noise.matching
        end = (material == world.END).astype(np.uint8)
        reach = round(matching.rim_px * material.shape[1] / 848)
        rim = cv2.dilate(end, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1)))
        favour = np.float32(matching.flat) * end - np.float32(matching.rim) * (rim - end)
        return _enlarge(favour.astype(np.float32), self.intrinsics.size)

    def _slant(self, disparity: Array) -> Array:
        """Change of the true disparity along the row, pixels per pixel, without sign; at an edge no more than 1."""
        small = np.asarray(cv2.resize(disparity, None, fx=0.25, fy=0.25), np.float32)
        steep = np.abs(cv2.Sobel(small, cv2.CV_32F, 1, 0, ksize=3, scale=1 / 32))
        return _enlarge(np.minimum(steep, np.float32(1)), self.intrinsics.size)

    def _false_matches(self, depth: Array) -> None:
        """Where there is no true match: round blobs whose disparity may be anything that fits into the picture, the same all
        over a blob."""
        height, width = depth.shape
        pixels = self.intrinsics.fx * BASELINE_M
        for _ in range(self.rng.poisson(self.noise.speckles)):
            w, h = (self.rng.uniform(low, high) * width / 848 for low, high in ((5, 17), (4, 12)))
            x, y = int(self.rng.uniform(0.01, 0.98) * width), int(self.rng.uniform(0, 0.98) * height)
            v, u = np.ogrid[: int(h) + 1, : int(w) + 1]
            patch = depth[y : y + int(h) + 1, x : x + int(w) + 1]
            inside = ((u - w / 2) / (w / 2)) ** 2 + ((v - h / 2) / (h / 2)) ** 2 <= 1
            false = pixels / self.rng.uniform(0.5, max(min(self.noise.matching.search_px, x), 1.0))
            patch[inside[: patch.shape[0], : patch.shape[1]] & (patch == 0)] = np.float32(false)


@dataclass
class TimeOfFlightCamera:
    """One recording's worth of time of flight."""

    intrinsics: Intrinsics
    noise: TimeOfFlightNoise
    window: Window
    rng: np.random.Generator
    blur: float = 0.0
    _smear: NDArray[np.uint8] = field(init=False)

    def __post_init__(self) -> None:
        self._smear = _smears(self.intrinsics.size, self.window)

    def picture(self, hits: Hits) -> NDArray[np.uint16]:
        """A depth picture (H, W) uint16 in UNIT_M; light that came by way of the opposite wall makes a concave wall look
        wider."""
        width, height = self.intrinsics.size
        near = _enlarge(np.where(hits.depth > 0, hits.depth, np.float32(0)), (width, height))
        cosine = np.maximum(_enlarge(hits.cosine, (width, height)), np.float32(0.02))
        wall = cv2.resize((hits.material == world.WALL).astype(np.float32), (width, height))
        excess = np.float32(self.noise.multipath) * (1 + np.float32(0.3) * _field((width, height), 31, self.rng)) * wall
        distance = near * (1 + excess)
        edge = cv2.morphologyEx(near, cv2.MORPH_GRADIENT, np.ones((3, 3), np.uint8)) > 0.15
        flying = edge & (self.rng.random(edge.shape) < self.noise.flying)
        mixed = cv2.blur(distance, (5, 5))
        distance = np.where(flying, mixed, distance)
        std = np.float32(self.noise.std) * (np.float32(0.5) + distance**2) / np.sqrt(cosine)
        depth = (distance + std * _field((width, height), 3, self.rng)) * np.float32(1 + self.window.scale)
        depth[(near < self.noise.nearest) | (cosine < 0.06) & (near > 2.0) | (self._smear > 0)] = 0
        return _millimetres(depth)


def coarse_rays(intrinsics: Intrinsics, step: int = 2) -> Array:
    """Rays (H/step, W/step, 2) through the middle of each ``step`` x ``step`` pixels, so that what is cast along them is
    enlarged without a shift."""
    fine = rays(intrinsics)
    height, width = (side // step for side in fine.shape[:2])
    blocks = fine[: height * step, : width * step].reshape(height, step, width, step, 2)
    return np.ascontiguousarray(blocks.mean(axis=(1, 3)), np.float32)


def _millimetres(depth: Array) -> NDArray[np.uint16]:
    return np.asarray(np.clip(np.rint(depth / UNIT_M), 0, 65535), np.uint16)


def _enlarge(values: Array, size: tuple[int, int]) -> Array:
    return np.asarray(cv2.resize(values, size, interpolation=cv2.INTER_LINEAR), np.float32)


def _smears(size: tuple[int, int], window: Window) -> NDArray[np.uint8]:
    """0 clear, 1 hole, 2 near ghost."""
    width, height = size
    picture = np.zeros((height, width), np.uint8)
    for k, (x, y, radius) in enumerate(window.smears):
        centre = (int(x * width), int(y * height))
        cv2.ellipse(
            picture, centre, (int(radius * width), int(0.8 * radius * width)), 30.0 * k, 0, 360, 2 if k % 3 == 2 else 1, -1
        )
    return picture


@lru_cache(maxsize=24)
def _bank(size: tuple[int, int], grain: int) -> NDArray[np.int8]:
    """A few fields (_BANK, H, W) of noise that is alike over ``grain`` pixels, in _BANK_STEP: small, for there are many."""
    width, height = size
    rng = np.random.default_rng(grain)
    fields = []
    for _ in range(_BANK):
        coarse = rng.normal(size=(height // max(grain // 2, 1) + 2, width // max(grain // 2, 1) + 2)).astype(np.float32)
        fine = cv2.resize(cv2.GaussianBlur(coarse, (0, 0), 0.8), (width, height), interpolation=cv2.INTER_LINEAR)
        fields.append(np.clip(np.rint(fine / (fine.std() * _BANK_STEP)), -127, 127).astype(np.int8))
    return np.stack(fields)


def _field(size: tuple[int, int], grain: int, rng: np.random.Generator) -> NDArray[np.float32]:
    """Unit noise (H, W): one of the bank's, shifted and mirrored at random, which is far cheaper than drawing it."""
    chosen = _bank(size, grain)[int(rng.integers(_BANK))]
    if rng.random() < 0.5:
        chosen = chosen[::-1]
    if rng.random() < 0.5:
        chosen = chosen[:, ::-1]
    shifted = np.roll(chosen, (int(rng.integers(size[1])), int(rng.integers(size[0]))), axis=(0, 1))
    return np.asarray(shifted * np.float32(_BANK_STEP), np.float32)
