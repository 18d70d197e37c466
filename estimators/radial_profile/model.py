"""Eq. 17 of the RADIUS paper as its code has it: constant, Z, and cos, sin, Z cos, Z sin for each harmonic."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def parameters(harmonics: int) -> int:
    """How many coefficients ``harmonics`` need: 2 + 4 K."""
    return 2 + 4 * harmonics


def design(theta: Array, z: Array, harmonics: int) -> Array:
    """Rows (N, 2 + 4 K) of eq. 17 at angles ``theta`` (rad) and depths ``z`` (N,).

    The columns are 1, z, then cos k theta, sin k theta, z cos k theta, z sin k theta for k = 1..K. (The paper prints only the
    terms with z; its text and its code have the constant ones too.)
    """
    columns = np.empty((parameters(harmonics), len(theta)))
    columns[0], columns[1] = 1.0, z
    for k in range(1, harmonics + 1):
        first = 4 * k - 2
        np.cos(k * theta, out=columns[first])
        np.sin(k * theta, out=columns[first + 1])
        np.multiply(columns[first], z, out=columns[first + 2])
        np.multiply(columns[first + 1], z, out=columns[first + 3])
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
