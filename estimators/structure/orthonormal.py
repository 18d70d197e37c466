"""The paper's four numbers of a line (Sec. 4.1): three angles of an orthonormal frame and the distance from the origin.

The filter does not use them (see ``features``): they are here to be compared with. Where the line passes straight above or
below the origin the two outer angles turn about the same axis and only their difference is told, and for a line through the
origin
n = p x q vanishes. Written as Rz(gamma) Ry(beta) Rx(alpha), R[2, 0] is -sin(beta): eq. 11 lacks that sign.
"""

from __future__ import annotations

import numpy as np

from estimators.structure.types import Array


def from_ends(start: Array, end: Array) -> Array:
    """Eqs. 3 to 12: (alpha, beta, gamma, rho) of the line through two points (3,). Raises ValueError for one through the
    origin."""
    moment = np.cross(start, end)
    direction = end - start
    length = float(np.linalg.norm(direction))
    if np.linalg.norm(moment) < 1e-12 * max(1.0, length):
        raise ValueError("a line through the origin has no such numbers")
    return _numbers(direction / length, moment / length)


def _numbers(direction: Array, moment: Array) -> Array:
    """From Pluecker coordinates: unit direction (3,) and moment (3,)."""
    rho = float(np.linalg.norm(moment))
    n = moment / rho
    r = np.cross(direction, n)
    return np.array([np.arctan2(direction[2], n[2]), -np.arcsin(np.clip(r[2], -1, 1)), np.arctan2(r[1], r[0]), rho])


def frame(numbers: Array) -> Array:
    """R = [r v n] (3, 3) of eq. 8."""
    (ca, cb, cg), (sa, sb, sg) = np.cos(numbers[:3]), np.sin(numbers[:3])
    return np.array(
        [
            [cg * cb, cg * sb * sa - sg * ca, cg * sb * ca + sg * sa],
            [sg * cb, sg * sb * sa + cg * ca, sg * sb * ca - cg * sa],
            [-sb, cb * sa, cb * ca],
        ]
    )


def pluecker(numbers: Array) -> tuple[Array, Array]:
    """Unit direction (3,) and moment (3,): rho times n."""
    axes = frame(numbers)
    return axes[:, 1], numbers[3] * axes[:, 2]


def into_world(numbers: Array, rotation: Array, position: Array) -> Array:
    """Eqs. 13 and 14: the numbers in the world of a line given in a sensor's frame at (rotation, position)."""
    direction, moment = pluecker(numbers)
    turned = rotation @ direction
    return _numbers(turned, rotation @ moment + np.cross(position, turned))


def into_sensor(numbers: Array, rotation: Array, position: Array) -> Array:
    """Eqs. 15 and 16, with the transpose over the whole product as eq. 15 needs it."""
    direction, moment = pluecker(numbers)
    return _numbers(rotation.T @ direction, rotation.T @ (moment - np.cross(position, direction)))
