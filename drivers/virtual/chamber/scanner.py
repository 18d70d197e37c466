"""The twin of the scanner: clouds of the virtual chamber, swept while the vehicle moves."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from drivers.navigation.scans import Scan, mount_at
from drivers.virtual.chamber.objects import placed
from drivers.virtual.chamber.path import VehiclePath
from drivers.virtual.chamber.solids import Array, Cylinder, Solid, cast
from drivers.virtual.chamber.structure import Structure, Tank

OFFSET = (0.5, 0.0, 0.1)
"""Of the scanner on the vehicle: forward, right, down (m)."""


def chamber_solids(structure: Structure) -> list[Solid]:
    """Everything that a ray may meet but the tank."""
    solids: list[Solid] = [Cylinder(np.array(p.start), np.array(p.end), p.radius_m) for p in structure.description.pipes]
    for thing in structure.objects:
        solids += placed(thing.label, bool(thing.is_open), thing.rotation, thing.position)
    return solids


class VirtualScanner:
    """Scans of ``structure`` from the vehicle on ``path``."""

    def __init__(self, structure: Structure, path: VehiclePath) -> None:
        self._settings = structure.description.scanner
        self._path = path
        self._solids = chamber_solids(structure)
        self._tank = structure.description.tank
        self.mount = mount_at(np.radians(self._settings.tilt_deg), np.array(OFFSET))
        horizontal, vertical = (np.radians(angle) / 2 for angle in self._settings.field_deg)
        azimuth, elevation = np.meshgrid(
            np.linspace(-horizontal, horizontal, self._settings.columns),
            np.linspace(-vertical, vertical, self._settings.rows),
            indexing="ij",
        )
        rays = np.stack([np.sin(azimuth) * np.cos(elevation), np.sin(elevation), np.cos(azimuth) * np.cos(elevation)], axis=-1)
        self._rays = rays.reshape(-1, 3)
        self._late_s = np.repeat(np.linspace(-0.5, 0.5, self._settings.columns) * self._settings.sweep_s, self._settings.rows)

    def times(self) -> Array:
        """When scans are taken: the middle of each sweep (s)."""
        return np.arange(1.0, self._path.duration_s, 1.0 / self._settings.rate_hz)

    def scan(self, time_s: float, rng: np.random.Generator) -> Scan:
        """One scan, with noise, in the sensor's frame at each point's own time."""
        settings = self._settings
        pose = self._path.pose(time_s + self._late_s)
        into_world = pose.rotation @ self.mount.rotation
        origins = pose.position + pose.rotation @ self.mount.offset
        directions = np.einsum("nij,nj->ni", into_world, self._rays)
        ranges, _ = cast(self._solids, origins, directions)
        ranges = np.minimum(ranges, tank_ranges(self._tank, origins, directions))
        kept = (ranges >= settings.range_m[0]) & (ranges <= settings.range_m[1]) & (rng.random(len(ranges)) >= settings.dropout)
        measured = ranges[kept] + rng.normal(0.0, settings.noise_m, int(kept.sum()))
        return Scan(time_s, self._rays[kept] * measured[:, None], self._late_s[kept])

    def scans(self, rng: np.random.Generator) -> Iterator[Scan]:
        """All of them in order."""
        for time_s in self.times():
            yield self.scan(float(time_s), rng)


def tank_ranges(tank: Tank, origins: Array, directions: Array) -> Array:
    """Ranges (N,) at which rays from inside meet floor, walls or slopes; the surface of the water is open."""
    half_x, half_y = tank.size_m[0] / 2, tank.size_m[1] / 2
    nearest = np.full(len(origins), np.inf)
    faces = [(0, half_x, 1), (0, -half_x, -1), (1, half_y, 1), (1, -half_y, -1), (2, tank.depth_m, 1)]
    for axis, where, side in faces:
        speed = directions[:, axis] * side
        with np.errstate(divide="ignore"):
            t = np.where(speed > 1e-9, (where - origins[:, axis]) * side / speed, np.inf)
        nearest = np.minimum(nearest, t)
    if tank.slope_width_m and tank.slope_height_m:
        for end in (1.0, -1.0):
            # the slope falls from the wall to the floor: its normal points up and away from the wall
            foot = np.array([end * (half_x - tank.slope_width_m), 0.0, tank.depth_m])
            normal = np.array([-end * tank.slope_height_m, 0.0, -tank.slope_width_m])
            speed = directions @ normal
            with np.errstate(divide="ignore", invalid="ignore"):
                t = np.where(speed < -1e-9, ((foot - origins) @ normal) / speed, np.inf)
            nearest = np.minimum(nearest, np.where(t > 0, t, np.inf))
    return nearest
