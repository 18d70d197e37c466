"""Roots that hang into a virtual pipe: fibres in space, drawn as lines."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.virtual.camera import CctvCamera
from drivers.virtual.film import FILM_STEPS, FILM_WHITE, film
from drivers.virtual.landmarks import Roots
from drivers.virtual.look import Look
from drivers.virtual.rig import Pose
from drivers.virtual.world import VirtualSewer

_NEAREST_M, _FARTHEST_M = 0.1, 4.0
_KNOTS = 9
_PALE = np.array([0.55, 0.66, 0.74])
_DARK = np.array([0.12, 0.18, 0.24])


@dataclass(frozen=True)
class _Tuft:
    chainage: float
    fibres: NDArray[np.float64]
    """(n, _KNOTS, 3) in the pipe frame."""
    thickness: NDArray[np.float64]
    """(n,) metres."""
    colors: NDArray[np.float64]
    """(n, 3) BGR."""


class RootTufts:
    """All roots of one sewer; they grow the same for the same ``seed``."""

    def __init__(self, sewer: VirtualSewer, camera: CctvCamera, look: Look, seed: int) -> None:
        self._camera, self._haze = camera, look.haze
        self._tufts = [
            _grown(thing, sewer.radius, np.random.default_rng([seed, 45, index]))
            for index, thing in enumerate(sewer.things)
            if isinstance(thing, Roots)
        ]

    def draw(self, picture: NDArray[np.uint8], pose: Pose, light: Callable[[NDArray[np.float32]], NDArray[np.float32]]) -> None:
        """Draw the roots ahead into a picture (H, W, 3) as a camera at ``pose`` sees them; ``light`` is that at a depth (m)."""
        for tuft in sorted(self._tufts, key=lambda one: -one.chainage):
            ahead = tuft.chainage - pose.chainage
            if not _NEAREST_M < ahead < _FARTHEST_M:
                continue
            pixels = self._camera.project(pose, tuft.fibres.reshape(-1, 3)).reshape(*tuft.fibres.shape[:2], 2)
            lit = float(light(np.array([ahead], np.float32))[0])
            width = np.clip(np.round(tuft.thickness * self._camera.fy / ahead), 1, 7).astype(int)
            for line, thick, color in zip(pixels, width, tuft.colors, strict=True):
                if np.isfinite(line).all():
                    exposed = np.minimum((color * lit + self._haze) * (FILM_STEPS / FILM_WHITE), FILM_STEPS - 1)
                    grey = tuple(int(value) for value in film()[exposed.astype(int)])
                    points = [np.round(np.clip(line, -2000, 3000) * 16).astype(np.int32)]
                    cv2.polylines(picture, points, False, grey, int(thick), cv2.LINE_AA, 4)


def _grown(roots: Roots, radius: float, rng: np.random.Generator) -> _Tuft:
    """Fibres that come in at a joint, bend down, wander, and branch."""
    pale = rng.uniform(0.0, 1.0)
    lines, thickness, colors = [], [], []
    for _ in range(roots.fibres):
        angle = roots.angle + roots.spread * float(np.clip(rng.normal(0, 0.45), -1, 1))
        start = np.array([radius * np.cos(angle), radius * np.sin(angle), roots.chainage + rng.normal(0, 0.006)])
        inwards = -np.array([np.cos(angle), np.sin(angle), 0.0]) + rng.normal(0, [0.6, 0.6, 0.8])
        length = roots.length * float(rng.uniform(0.35, 1.15))
        line = _fibre(start, inwards, length, radius, rng)
        thick = float(rng.choice([0.0006, 0.0012, 0.0024], p=[0.55, 0.35, 0.1]))
        tone = np.clip(pale + rng.normal(0, 0.25), 0, 1)
        color = (tone * _PALE + (1 - tone) * _DARK) * rng.uniform(0.7, 1.15)
        lines.append(line)
        thickness.append(thick)
        colors.append(color)
        for _ in range(int(rng.integers(0, 4))):
            knot = int(rng.integers(2, _KNOTS - 1))
            aside = line[knot] - line[knot - 1]
            aside = aside / (np.linalg.norm(aside) + 1e-9) + rng.normal(0, 0.7, 3)
            lines.append(_fibre(line[knot], aside, 0.4 * length * float(rng.uniform(0.3, 1)), radius, rng))
            thickness.append(0.6 * thick)
            colors.append(color)
    return _Tuft(roots.chainage, np.array(lines), np.array(thickness), np.array(colors))


def _fibre(
    start: NDArray[np.float64], towards: NDArray[np.float64], length: float, radius: float, rng: np.random.Generator
) -> NDArray[np.float64]:
    """(_KNOTS, 3): a walk of steps that lean to the ground and never leave the pipe."""
    points = [start]
    heading = towards / (np.linalg.norm(towards) + 1e-9)
    for _ in range(_KNOTS - 1):
        heading = heading + np.array([0.0, 0.08, 0.0]) + rng.normal(0, 0.26, 3)
        heading /= np.linalg.norm(heading)
        point = points[-1] + heading * (length / (_KNOTS - 1))
        away = float(np.hypot(point[0], point[1]))
        if away > radius:
            point[:2] *= radius / away
        points.append(point)
    return np.array(points)
