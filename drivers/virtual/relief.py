"""How far the landmarks of a virtual pipe stand out of its wall, and where rays meet what stands out."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from drivers.virtual.landmarks import Connection, DisplacedJoint, Patch, Thing

Array = NDArray[np.float32]
Height = Callable[[Array, Array], Array]
"""Height above the nominal wall (m, into the pipe) at (chainage, image angle), any shape."""
Raised = Connection | Patch | DisplacedJoint
SETTLED_M = 1.2
"""Behind a displaced joint the pipe is back in line after so much (m)."""
_HALVED = 3
"""How often the last step to a surface is halved: a ray that grazes the wall passes centimetres of pipe from shell to shell."""
_FOOT = 0.25
"""Share of a deposit's length and width over which it rises."""


class Relief:
    """The relief of ``things`` in a pipe of ``radius`` (m). ``pockets``: connections are holes as deep as they are wide."""

    def __init__(self, things: tuple[Thing, ...], radius: float, pockets: bool) -> None:
        self._radius = radius
        self._things: tuple[Raised, ...] = tuple(
            thing
            for thing in things
            if isinstance(thing, Patch | DisplacedJoint) or (pockets and isinstance(thing, Connection))
        )
        self.spans = tuple(_span(thing, radius) for thing in self._things)
        """(chainage from, to, image angle of the middle, half width in rad) of each that stands out."""
        self.high = max([0.0, *(_highest(thing) for thing in self._things)])
        self.low = min([0.0, *(_lowest(thing) for thing in self._things)])

    def __bool__(self) -> bool:
        return bool(self._things)

    def height(self, z: Array, angle: Array) -> Array:
        """Above the nominal wall (m)."""
        total = np.zeros(np.broadcast_shapes(z.shape, angle.shape), np.float32)
        for thing in self._things:
            if isinstance(thing, Patch):
                total += np.float32(thing.height) * patch_shape(thing, z, angle)
            elif isinstance(thing, DisplacedJoint):
                total += displacement(thing, z, angle)
            else:
                total = np.where(opening(thing, self._radius, z, angle) < 1, np.float32(_lowest(thing)), total)
        return total

    def near(self, z: Array, angle: Array) -> NDArray[np.bool_]:
        """Which rays that would end on the nominal wall at (z, angle) may meet something that stands out of it, or pass into
        something that stands in. Seen from far, a thing hides as much wall behind it as its height times the ray's slope."""
        found = np.zeros(z.shape, bool)
        for begin, end, middle, half in self.spans:
            within = (z > begin) & (z < end)
            found |= within if half > 2 else within & (np.abs(_turned(angle, middle)) < half + 0.35)
        return found


def march(
    height: Height,
    radius: float,
    low: float,
    high: float,
    origin: tuple[float, float, float],
    ray: tuple[Array, Array, Array],
    shells: int = 16,
    beyond: Array | None = None,
) -> Array:
    """Depth along rays (n,) at which they meet the surface at ``radius`` less ``height``. It lies between ``low`` and ``high``
    before ``radius``, or before ``beyond`` (n,) where given, the radius at which each ray meets the bare wall: through so many
    ``shells`` of growing radius, then by halves, the last step by the secant. Rays that meet nothing end on the last shell."""
    (ox, oy, oz), (dx, dy, dz) = origin, ray
    a = dx * dx + dy * dy + np.float32(1e-12)
    b = np.float32(ox) * dx + np.float32(oy) * dy
    away = np.float32(ox * ox + oy * oy)
    bare = np.float32(radius) if beyond is None else beyond
    hit = np.zeros(dx.shape, bool)
    depth_before = gap_before = np.zeros(dx.shape, np.float32)

    def below(depth: Array) -> Array:
        """How far (m) a place on the rays lies behind the surface."""
        x, y = np.float32(ox) + depth * dx, np.float32(oy) + depth * dy
        return np.asarray(
            np.hypot(x, y) - np.float32(radius) + height(np.float32(oz) + depth * dz, np.arctan2(y, x)), np.float32
        )

    near, near_gap, far, far_gap = (np.zeros(dx.shape, np.float32) for _ in range(4))
    for level in np.linspace(high, low, shells, dtype=np.float32):
        depth = np.asarray((np.sqrt(np.maximum(b * b - a * (away - (bare - level) ** 2), 0)) - b) / a, np.float32)
        gap = below(depth)
        inside = (gap >= 0) & (depth > 0) & ~hit
        near, near_gap = np.where(inside, depth_before, near), np.where(inside, gap_before, near_gap)
        far, far_gap = np.where(inside, depth, far), np.where(inside, gap, far_gap)
        hit |= inside
        depth_before, gap_before = depth, gap
    for _ in range(_HALVED):
        middle = np.asarray((near + far) / 2, np.float32)
        gap = below(middle)
        behind = gap >= 0
        near, near_gap = np.where(behind, near, middle), np.where(behind, near_gap, gap)
        far, far_gap = np.where(behind, middle, far), np.where(behind, gap, far_gap)
    share = np.where(near_gap < 0, near_gap / np.minimum(near_gap - far_gap, np.float32(-1e-9)), np.float32(1))
    return np.asarray(np.where(hit, near + share * (far - near), depth_before), np.float32)


def patch_shape(patch: Patch, z: Array, angle: Array) -> Array:
    """0 beside a deposit to 1 on top of it, lumpy; any shape."""
    length = patch.end - patch.start
    along = _plateau((z - np.float32(patch.start)) / np.float32(length))
    turned = _turned(angle, patch.angle)
    across = _plateau(turned / np.float32(2 * patch.spread) + np.float32(0.5))
    rng = np.random.default_rng(round(1e4 * (patch.start + 3 * patch.end)))
    phase = rng.uniform(0, 2 * np.pi, (3, 2))
    lumps = sum(
        np.sin(z * np.float32(2 * np.pi / wave) + np.float32(p)) * np.sin(turned * np.float32(turns) + np.float32(q))
        for (p, q), wave, turns in zip(phase, (0.11, 0.19, 0.31), (11.0, 7.0, 4.0), strict=True)
    )
    return np.asarray(along * across * (np.float32(0.8) + np.float32(0.2 / 3) * lumps), np.float32)


def displacement(joint: DisplacedJoint, z: Array, angle: Array) -> Array:
    """How far (m) the pipe behind a displaced joint stands in; any shape."""
    behind = z - np.float32(joint.chainage)
    back = np.where(behind >= 0, np.clip(1 - behind / np.float32(SETTLED_M), 0, 1), np.float32(0))
    return np.asarray(np.float32(joint.step) * back * np.cos(angle - np.float32(joint.angle)), np.float32)


def opening(connection: Connection, radius: float, z: Array, angle: Array) -> Array:
    """Distance from the axis of a connection, 1 at its edge; any shape. Infinite on the far side of the pipe."""
    turned = _turned(angle, connection.angle)
    across = np.where(np.abs(turned) < np.pi / 2, np.float32(radius) * np.sin(turned), np.float32(np.inf))
    return np.asarray(np.hypot(across, z - np.float32(connection.chainage)) / np.float32(connection.diameter / 2), np.float32)


def _turned(angle: Array, middle: float) -> Array:
    """From ``middle`` to ``angle``, in [-pi, pi)."""
    return np.asarray((angle - np.float32(middle) + np.float32(np.pi)) % np.float32(2 * np.pi) - np.float32(np.pi), np.float32)


def _plateau(share: Array) -> Array:
    """0 outside of 0..1, 1 inside, with soft feet."""
    foot = np.clip(np.minimum(share, 1 - share) / np.float32(_FOOT), 0, 1)
    return np.asarray(foot * foot * (3 - 2 * foot), np.float32)


def _highest(thing: Raised) -> float:
    return max(thing.height, 0.0) if isinstance(thing, Patch) else thing.step if isinstance(thing, DisplacedJoint) else 0.0


def _lowest(thing: Raised) -> float:
    if isinstance(thing, Patch):
        return min(thing.height, 0.0)
    return -thing.diameter if isinstance(thing, Connection) else -thing.step if isinstance(thing, DisplacedJoint) else 0.0


def _span(thing: Raised, radius: float) -> tuple[float, float, float, float]:
    if isinstance(thing, Connection):
        # a ray that comes in steeply ends as far behind the opening as it is deep and more
        wide = math.asin(min(thing.diameter / 2 / radius, 1.0))
        return thing.chainage - thing.diameter, thing.chainage + 4 * thing.diameter, thing.angle, wide
    if isinstance(thing, DisplacedJoint):
        return thing.chainage - 0.3, thing.chainage + SETTLED_M + 0.3, thing.angle, math.pi
    return thing.start - 0.1, thing.end + 0.6 + 6 * abs(thing.height), thing.angle, thing.spread
