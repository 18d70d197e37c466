"""Where the box is and how it moves: poses in the pipe frame (see world.py)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Pose:
    """``right``, ``down``, ``chainage`` of the camera (m); ``yaw`` to the right, ``pitch`` downwards, ``roll`` clockwise
    (rad)."""

    right: float = 0.0
    down: float = 0.0
    chainage: float = 0.0
    yaw: float = 0.0
    pitch: float = 0.0
    roll: float = 0.0

    @property
    def position(self) -> NDArray[np.float64]:
        """(3,) in the pipe frame."""
        return np.array([self.right, self.down, self.chainage])

    @property
    def rotation(self) -> NDArray[np.float64]:
        """(3, 3) from the camera to the pipe frame: roll, then pitch, then yaw."""
        cy, sy, cp, sp, cr, sr = (f(a) for a in (self.yaw, self.pitch, self.roll) for f in (np.cos, np.sin))
        yaw = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
        pitch = np.array([[1, 0, 0], [0, cp, sp], [0, -sp, cp]])
        roll = np.array([[cr, -sr, 0], [sr, cr, 0], [0, 0, 1]])
        return np.asarray(yaw @ pitch @ roll)


@dataclass(frozen=True)
class HandMotion:
    """How an operator's rod sways: standard deviations of place (m) and angle (rad), and how long a sway takes, in frames."""

    place: float = 0.002
    angle: float = 0.004
    period: float = 25.0


def sway(pose: Pose, motion: HandMotion, rng: np.random.Generator) -> Iterator[Pose]:
    """Poses around ``pose``, one a frame, without end: a second-order random walk that is pulled back to it."""
    scale = np.array([motion.place] * 3 + [motion.angle] * 3)
    pull = 2 * np.pi / motion.period
    damping = 0.35
    offset = rng.normal(size=6)
    speed = rng.normal(size=6) * pull
    rest = np.array([pose.right, pose.down, pose.chainage, pose.yaw, pose.pitch, pose.roll])
    while True:
        right, down, chainage, yaw, pitch, roll = (float(value) for value in rest + scale * offset)
        yield Pose(right, down, chainage, yaw, pitch, roll)
        speed += -(pull**2) * offset - 2 * damping * pull * speed + 2 * pull**1.5 * np.sqrt(damping) * rng.normal(size=6)
        offset = offset + speed
