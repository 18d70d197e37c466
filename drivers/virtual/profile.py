"""Cross-sections of virtual pipes as radius over image angle around their centre."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

SAMPLES = 720
Array = NDArray[np.float64]
_ANGLES = np.linspace(-np.pi, np.pi, SAMPLES, endpoint=False)


@dataclass(frozen=True)
class PipeProfile:
    """``radii`` (SAMPLES,) in metres at image angles atan2(v, u) from -pi, evenly spaced; ``kind`` for people."""

    kind: str
    radii: tuple[float, ...]

    def radius(self, angle: NDArray[np.floating]) -> NDArray[np.float32]:
        """Radius at image angles, any shape; linear between the samples."""
        table = np.asarray((*self.radii, self.radii[0]), np.float32)
        position = (np.asarray(angle, np.float32) + np.float32(np.pi)) * np.float32(SAMPLES / (2 * np.pi))
        lower = np.clip(position.astype(np.int32), 0, SAMPLES - 1)
        fraction = position - lower
        return np.asarray(table[lower] * (1 - fraction) + table[lower + 1] * fraction, np.float32)

    @property
    def round(self) -> bool:
        """Whether one radius says it all."""
        return max(self.radii) - min(self.radii) < 1e-9

    @property
    def mean_diameter(self) -> float:
        """Perimeter over pi: what a lining is ordered by."""
        radii = np.asarray(self.radii)
        points = np.stack([radii * np.cos(_ANGLES), radii * np.sin(_ANGLES)], axis=1)
        return float(np.linalg.norm(np.diff(points, axis=0, append=points[:1]), axis=1).sum() / np.pi)

    def below(self) -> float:
        """Distance from the centre straight down to the invert."""
        return float(self.radius(np.array([np.pi / 2]))[0])


def circular(diameter: float) -> PipeProfile:
    """A round pipe of interior ``diameter`` (m)."""
    return PipeProfile("circular", (diameter / 2,) * SAMPLES)


def oval(width: float, height: float) -> PipeProfile:
    """An ellipse of ``width`` by ``height`` (m)."""
    a, b = width / 2, height / 2
    return PipeProfile("oval", tuple(float(a * b / np.hypot(b * np.cos(t), a * np.sin(t))) for t in _ANGLES))


def dented(diameter: float, depth: float, angle: float, width: float = 0.5) -> PipeProfile:
    """A round pipe pressed in by ``depth`` (m) at image ``angle``, over about ``width`` (rad) to either side."""
    away = np.angle(np.exp(1j * (_ANGLES - angle)))
    return PipeProfile("dented", tuple(float(r) for r in diameter / 2 - depth * np.exp(-((away / width) ** 2))))


def egg(width: float) -> PipeProfile:
    """The standard egg of DIN 4263, height = 1.5 x width (m), its centre at half the height.

    Three arcs: crown of radius W/2, sides of radius 3W/2 whose centres lie at the height of the crown's, invert of radius W/4.
    """
    w = width
    crown, invert, side = w / 2, w / 4, 1.5 * w
    crown_y, invert_y = -0.25 * w, 0.5 * w  # the centre of the profile is at half the height, y down

    def distance(t: float) -> float:
        direction = np.array([np.cos(t), np.sin(t)])
        inside = []
        for radius, cx, cy in ((crown, 0.0, crown_y), (invert, 0.0, invert_y), (side, -np.copysign(w, direction[0]), crown_y)):
            centre = np.array([cx, cy])
            along = float(direction @ centre)
            root = along**2 - float(centre @ centre) + radius**2
            inside.append(along + np.sqrt(root) if root >= 0 else -np.inf)
        if direction[1] * inside[0] <= crown_y:
            return inside[0]
        at_invert = direction * inside[1] if np.isfinite(inside[1]) else None
        joins_y = invert_y + 0.6 * invert  # where the side's arc touches the invert's: on the line through both centres
        return inside[1] if at_invert is not None and at_invert[1] >= joins_y else inside[2]

    return PipeProfile("egg", tuple(float(distance(t)) for t in _ANGLES))
