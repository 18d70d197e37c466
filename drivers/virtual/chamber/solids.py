"""Solids that rays are cast at: cylinders with caps, spheres and boxes.

Their surfaces are exact, which facets of a mesh are not, and casting at them needs numpy alone: Open3D's RaycastingScene would
cost a small computer 250 MB and a second at each start, and embreex has no wheels for aarch64. ``device`` makes meshes of
them where a mesh is wanted.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_PARALLEL = 1e-12


@dataclass(frozen=True)
class Cylinder:
    """From ``start`` to ``end`` (3,), closed at both ends."""

    start: Array
    end: Array
    radius: float

    def moved(self, rotation: Array, position: Array) -> Cylinder:
        """The same at another pose."""
        return replace(self, start=rotation @ self.start + position, end=rotation @ self.end + position)

    def ball(self) -> tuple[Array, float]:
        """Centre and radius of a sphere around it."""
        return (self.start + self.end) / 2, float(np.hypot(np.linalg.norm(self.end - self.start) / 2, self.radius))

    def cast(self, origins: Array, directions: Array) -> Array:
        """Ranges (N,) at which rays meet it from outside, inf where they do not."""
        axis = self.end - self.start
        length = float(np.linalg.norm(axis))
        axis = axis / length
        relative = origins - self.start
        along_o, along_d = relative @ axis, directions @ axis
        across_o = relative - along_o[:, None] * axis
        across_d = directions - along_d[:, None] * axis
        a = np.einsum("ij,ij->i", across_d, across_d)
        half_b = np.einsum("ij,ij->i", across_o, across_d)
        c = np.einsum("ij,ij->i", across_o, across_o) - self.radius**2
        inside = half_b**2 - a * c
        with np.errstate(divide="ignore", invalid="ignore"):
            side = (-half_b - np.sqrt(np.where(inside >= 0, inside, np.nan))) / np.where(a > _PARALLEL, a, np.nan)
            met = along_o + side * along_d
            best = np.where((side > 0) & (met >= 0) & (met <= length), side, np.inf)
            for cap in (0.0, length):
                t = (cap - along_o) / np.where(np.abs(along_d) > _PARALLEL, along_d, np.nan)
                off = across_o + t[:, None] * across_d
                hit = (t > 0) & (np.einsum("ij,ij->i", off, off) <= self.radius**2)
                best = np.minimum(best, np.where(hit, t, np.inf))
        return best


@dataclass(frozen=True)
class Sphere:
    """Around ``centre`` (3,)."""

    centre: Array
    radius: float

    def moved(self, rotation: Array, position: Array) -> Sphere:
        """The same at another pose."""
        return replace(self, centre=rotation @ self.centre + position)

    def ball(self) -> tuple[Array, float]:
        """Itself."""
        return self.centre, self.radius

    def cast(self, origins: Array, directions: Array) -> Array:
        """As ``Cylinder.cast``; ``directions`` are unit vectors."""
        relative = origins - self.centre
        half_b = np.einsum("ij,ij->i", relative, directions)
        inside = half_b**2 - np.einsum("ij,ij->i", relative, relative) + self.radius**2
        t = -half_b - np.sqrt(np.maximum(inside, 0.0))
        return np.where((inside >= 0) & (t > 0), t, np.inf)


@dataclass(frozen=True)
class Box:
    """Around ``centre`` (3,), ``half`` (3,) to each side along the columns of ``rotation`` (3, 3)."""

    centre: Array
    half: Array
    rotation: Array

    def moved(self, rotation: Array, position: Array) -> Box:
        """The same at another pose."""
        return replace(self, centre=rotation @ self.centre + position, rotation=rotation @ self.rotation)

    def ball(self) -> tuple[Array, float]:
        """Centre and radius of a sphere around it."""
        return self.centre, float(np.linalg.norm(self.half))

    def cast(self, origins: Array, directions: Array) -> Array:
        """As ``Cylinder.cast``."""
        o, d = (origins - self.centre) @ self.rotation, directions @ self.rotation
        d = np.where(np.abs(d) > _PARALLEL, d, _PARALLEL)
        near, far = (-self.half - o) / d, (self.half - o) / d
        enter = np.minimum(near, far).max(axis=1)
        leave = np.maximum(near, far).min(axis=1)
        return np.where((enter <= leave) & (enter > 0), enter, np.inf)


Solid = Cylinder | Sphere | Box


def cast(solids: list[Solid], origins: Array, directions: Array) -> tuple[Array, NDArray[np.intp]]:
    """Ranges (N,) of the nearest surfaces along unit rays (N, 3) from (N, 3), inf where none, and the number of the solid."""
    ranges = np.full(len(origins), np.inf)
    which = np.full(len(origins), -1)
    own, squared = np.einsum("ij,ij->i", origins, directions), np.einsum("ij,ij->i", origins, origins)
    for number, solid in enumerate(solids):
        centre, radius = solid.ball()
        ahead = directions @ centre - own
        apart = squared - 2 * (origins @ centre) + centre @ centre - ahead**2
        near = np.flatnonzero(apart <= radius**2 + 1e-9)  # a little more than the ball, for what is lost in the differences
        if not len(near):
            continue
        met = solid.cast(origins[near], directions[near])
        closer = met < ranges[near]
        ranges[near[closer]] = met[closer]
        which[near[closer]] = number
    return ranges, which
