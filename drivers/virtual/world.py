"""The virtual sewer, version 1: a chamber wall with one pipe in it, and what lies in the pipe.

Pipe frame: x right, y down, z along the pipe from its mouth at z = 0; the origin is the centre of the profile at the mouth.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from drivers.virtual.landmarks import LandmarkTruth, Thing, truths
from drivers.virtual.profile import PipeProfile
from drivers.virtual.relief import Relief, march

NOTHING, WALL, END, WATER, DEPOSIT, CHAMBER, JOINT = range(7)
"""Materials that a ray can end on."""
Array = NDArray[np.float32]
_TURNS = 0.05
"""By how much, as a share of its radius, a profile that is not round may differ within the turn that a ray makes near it."""


@dataclass(frozen=True)
class Deposit:
    """A bed of sediment: from ``start`` to ``end`` along the pipe, ``height`` above the invert; metres."""

    start: float
    end: float
    height: float


@dataclass(frozen=True)
class Joint:
    """A joint at ``chainage`` with a gap of ``width`` and ``depth`` (m); a negative depth is a lip that stands in."""

    chainage: float
    width: float = 0.012
    depth: float = 0.008


@dataclass(frozen=True)
class VirtualSewer:
    """``length`` (m) is where a wall or bend closes the view; ``water`` its depth above the invert (m); ``things`` are its
    landmarks."""

    profile: PipeProfile
    length: float = 6.0
    water: float = 0.0
    deposit: Deposit | None = None
    joints: tuple[Joint, ...] = ()
    things: tuple[Thing, ...] = ()

    @cached_property
    def radius(self) -> float:
        """Mean interior radius (m)."""
        return sum(self.profile.radii) / len(self.profile.radii)

    @cached_property
    def landmarks(self) -> tuple[LandmarkTruth, ...]:
        """What is in it and where, in the order of chainage."""
        return truths(self.things, self.radius)

    @cached_property
    def relief(self) -> Relief:
        """What stands out of the wall or opens in it."""
        return Relief(self.things, self.radius, pockets=True)

    def cast(self, position: NDArray[np.float64], rotation: NDArray[np.float64], rays: Array) -> Hits:
        """Where rays (..., 2) of (X/Z, Y/Z) of a camera at ``position`` (3,) with ``rotation`` (3, 3), camera to pipe, end."""
        direction = np.concatenate([rays, np.ones((*rays.shape[:-1], 1), np.float32)], axis=-1) @ rotation.T.astype(np.float32)
        dx, dy, dz = direction[..., 0], direction[..., 1], direction[..., 2]
        ox, oy, oz = (np.float32(value) for value in position)
        with np.errstate(divide="ignore", invalid="ignore"):
            depth, material = self._wall(ox, oy, dx, dy, dz, oz)
            if self.relief:
                depth, material = self._stand_out(depth, material, position, direction)
            chainage = oz + depth * dz
            mouth = np.where(dz > 0, -oz / dz, np.inf)
            outside = chainage < 0
            if oz < 0 and np.hypot(ox, oy) >= self.profile.radius(np.arctan2(oy, ox)):
                # seen from beside the mouth, a ray may meet the wall's far side without having come in by the mouth
                mouth_x, mouth_y = ox + mouth * dx, oy + mouth * dy
                outside |= ~(np.hypot(mouth_x, mouth_y) < self.profile.radius(np.arctan2(mouth_y, mouth_x)))
            depth = np.where(outside, np.where(mouth > 0, mouth, np.inf), depth)
            material[outside] = CHAMBER
            end = np.where(dz > 0, (np.float32(self.length) - oz) / dz, np.inf)
            depth, material = _nearer(depth, material, end, END, end > 0)
            invert = np.float32(self.profile.below())
            if self.water > 0:
                surface = np.where(dy > 0, (invert - np.float32(self.water) - oy) / dy, np.inf)
                depth, material = _nearer(depth, material, surface, WATER, (surface > 0) & (oz + surface * dz > 0))
            if self.deposit is not None:
                depth, material = self._bed(self.deposit, depth, material, (oy, oz), (dy, dz))
            cosine = self._incidence(depth, material, (ox, oy), direction)
        gone = ~np.isfinite(depth) | (depth <= 0)
        return Hits(
            np.where(gone, np.float32(0), depth).astype(np.float32), cosine, np.where(gone, NOTHING, material).astype(np.uint8)
        )

    def _wall(
        self, ox: np.float32, oy: np.float32, dx: Array, dy: Array, dz: Array, oz: np.float32
    ) -> tuple[Array, NDArray[np.uint8]]:
        """Depth at which the rays leave the profile: a circle solved exactly, its radius renewed from the angle it was met
        at. In a joint they end on its floor or its flank."""
        a = dx * dx + dy * dy + np.float32(1e-12)
        b = ox * dx + oy * dy
        centre = ox * ox + oy * oy
        radius: NDArray[np.float32] | np.float32 = np.float32(np.mean(self.profile.radii))
        depth = (-b + np.sqrt(np.maximum(b * b - a * (centre - radius * radius), 0))) / a
        if not self.profile.round:
            for _ in range(5):
                radius = self.profile.radius(np.arctan2(oy + depth * dy, ox + depth * dx))
                depth = (-b + np.sqrt(np.maximum(b * b - a * (centre - radius * radius), 0))) / a
        material = np.full(depth.shape, WALL, np.uint8)
        for joint in self.joints:
            ring = np.abs(oz + depth * dz - np.float32(joint.chainage)) < joint.width / 2
            if ring.any():
                wider = (radius if isinstance(radius, np.float32) else radius[ring]) + np.float32(joint.depth)
                floor = (-b[ring] + np.sqrt(np.maximum(b[ring] ** 2 - a[ring] * (centre - wider * wider), 0))) / a[ring]
                first, last = (np.float32(joint.chainage + side * joint.width / 2) for side in (-1, 1))
                flank = (np.clip(oz + floor * dz[ring], first, last) - oz) / dz[ring]
                depth[ring] = np.where(np.abs(dz[ring]) > 1e-6, flank, floor)
                material[ring] = JOINT
        return np.asarray(depth, np.float32), material

    def _stand_out(
        self, depth: Array, material: NDArray[np.uint8], position: NDArray[np.float64], direction: Array
    ) -> tuple[Array, NDArray[np.uint8]]:
        """Rays that meet a landmark end on it. A pipe that is not round keeps its shape: the height counts from its wall."""
        ox, oy, oz = (float(value) for value in position)
        hit = direction * depth[..., None]
        z, angle = hit[..., 2] + np.float32(oz), np.arctan2(hit[..., 1] + np.float32(oy), hit[..., 0] + np.float32(ox))
        near = self.relief.near(z, angle)
        if not near.any():
            return depth, material
        rays = direction[near]
        local = 0.0 if self.profile.round else 1.0

        def height(z: Array, angle: Array) -> Array:
            shape = np.float32(local) * (np.float32(self.radius) - self.profile.radius(angle))
            return np.asarray(self.relief.height(z, angle) + shape, np.float32)

        x, y = hit[near][:, 0] + np.float32(ox), hit[near][:, 1] + np.float32(oy)
        spare = local * _TURNS * self.radius
        met = march(
            height,
            self.radius,
            self.relief.low - spare,
            self.relief.high + spare,
            (ox, oy, oz),
            (rays[:, 0], rays[:, 1], rays[:, 2]),
            beyond=np.hypot(x, y),
        )
        depth = depth.copy()
        nominal, changed = depth[near], np.abs(met - depth[near]) > 1e-4
        depth[near] = np.where(changed, met, nominal)
        kind = material[near]
        kind[changed & (met < nominal)] = DEPOSIT
        material[near] = kind
        return depth, material

    def _bed(
        self,
        deposit: Deposit,
        depth: Array,
        material: NDArray[np.uint8],
        origin: tuple[np.float32, np.float32],
        direction: tuple[Array, Array],
    ) -> tuple[Array, NDArray[np.uint8]]:
        """The deposit's top and the step at its near end."""
        (oy, oz), (dy, dz) = origin, direction
        level = np.float32(self.profile.below() - deposit.height)
        top = np.where(dy > 0, (level - oy) / dy, np.inf)
        on_top = (oz + top * dz > deposit.start) & (oz + top * dz < deposit.end) & (top > 0)
        depth, material = _nearer(depth, material, top, DEPOSIT, on_top)
        step = np.where(dz > 0, (np.float32(deposit.start) - oz) / dz, np.inf)
        return _nearer(depth, material, step, DEPOSIT, (oy + step * dy > level) & (step > 0))

    def _incidence(
        self, depth: Array, material: NDArray[np.uint8], origin: tuple[np.float32, np.float32], direction: Array
    ) -> NDArray[np.float32]:
        """Cosine between the ray and the surface's normal: 1 head-on, 0 grazing."""
        length = np.sqrt(np.einsum("...i,...i->...", direction, direction))
        x, y = origin[0] + depth * direction[..., 0], origin[1] + depth * direction[..., 1]
        rho = np.maximum(np.hypot(x, y), np.float32(1e-6))
        across = np.abs(x * direction[..., 0] + y * direction[..., 1]) / rho
        lengthwise, downwards = np.abs(direction[..., 2]), np.abs(direction[..., 1])
        facing = (material == END) | (material == CHAMBER)
        level = (material == WATER) | (material == DEPOSIT)
        return np.asarray(np.where(facing, lengthwise, np.where(level, downwards, across)) / length, np.float32)


@dataclass(frozen=True)
class Hits:
    """Where rays end: ``depth`` along the camera's z (m; 0 for nowhere), ``cosine`` of incidence, ``material``; one shape."""

    depth: NDArray[np.float32]
    cosine: NDArray[np.float32]
    material: NDArray[np.uint8]


def _nearer(
    depth: Array, material: NDArray[np.uint8], other: Array, kind: int, valid: NDArray[np.bool_]
) -> tuple[Array, NDArray[np.uint8]]:
    closer = valid & (other < depth)
    return np.where(closer, other, depth), np.where(closer, np.uint8(kind), material)
