"""Eq. 17 of the RADIUS paper as its code has it: constant, Z, and cos, sin, Z cos, Z sin for each harmonic."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Axis:
    """The line that angles and radii are counted from: at depth z it stands at (x + right z, y + down z), metres.

    The paper counts from the camera's axis. An off-centre circle is then no short Fourier series (eq. 14 holds for small
    offsets only), and one that drifts with depth is not linear in it; about the pipe's own axis both are exact.
    """

    x: float = 0.0
    y: float = 0.0
    right: float = 0.0
    down: float = 0.0

    def at(self, z: Array) -> tuple[Array, Array]:
        """(x, y) at depths ``z``."""
        return self.x + self.right * z, self.y + self.down * z


CAMERA_AXIS = Axis()


def parameters(harmonics: int) -> int:
    """How many coefficients ``harmonics`` need: 2 + 4 K."""
    return 2 + 4 * harmonics


def design(theta: Array, z: Array, harmonics: int) -> Array:
    """Rows (N, 2 + 4 K) of eq. 17 at angles ``theta`` (rad) and depths ``z`` (N,).

    The columns are 1, z, then cos k theta, sin k theta, z cos k theta, z sin k theta for k = 1..K. (The paper prints only the
    terms with z; its text and its code have the constant ones too.)
    """
    return design_towards(np.cos(theta), np.sin(theta), z, harmonics)


def design_towards(cosine: Array, sine: Array, z: Array, harmonics: int) -> Array:
    """``design`` at angles whose cosine and sine are known."""
    columns = np.empty((parameters(harmonics), len(z)))
    columns[0], columns[1] = 1.0, z
    c, s = np.ones_like(cosine), np.zeros_like(sine)
    for k in range(1, harmonics + 1):
        c, s = c * cosine - s * sine, s * cosine + c * sine
        first = 4 * k - 2
        columns[first], columns[first + 1] = c, s
        np.multiply(c, z, out=columns[first + 2])
        np.multiply(s, z, out=columns[first + 3])
    return columns.T


def harmonics_of(coefficients: Array) -> int:
    """K of a coefficient vector (2 + 4 K,)."""
    return (len(coefficients) - 2) // 4


def profile_at(coefficients: Array, theta: Array) -> tuple[Array, Array]:
    """(constant, slope): the radius at angles ``theta`` is constant + slope * z. Both shaped like ``theta``."""
    constant = np.full(np.shape(theta), coefficients[0])
    slope = np.full(np.shape(theta), coefficients[1])
    for k in range(1, harmonics_of(coefficients) + 1):
        cosine, sine = np.cos(k * theta), np.sin(k * theta)
        a, b, c, d = coefficients[4 * k - 2 : 4 * k + 2]
        constant = constant + a * cosine + b * sine
        slope = slope + c * cosine + d * sine
    return constant, slope


def profile_rows(theta: Array, harmonics: int) -> tuple[Array, Array]:
    """Rows (N, 2 + 4 K) that tell ``profile_at`` angles (N,) from coefficients, for its constant and for its slope."""
    both = design(theta, np.ones_like(theta), harmonics)
    sloping = np.zeros(both.shape[1], dtype=bool)
    sloping[1] = True
    for k in range(1, harmonics + 1):
        sloping[4 * k : 4 * k + 2] = True
    return np.where(sloping, 0.0, both), np.where(sloping, both, 0.0)


def recentred(coefficients: Array, axis: Axis) -> tuple[Array, Axis]:
    """The same wall, to first order, about an axis that takes over its first harmonic."""
    if harmonics_of(coefficients) < 1:
        return coefficients, axis
    x, y, right, down = (float(value) for value in coefficients[2:6])
    moved = coefficients.copy()
    moved[2:6] = 0.0
    return moved, Axis(axis.x + x, axis.y + y, axis.right + right, axis.down + down)
