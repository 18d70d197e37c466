"""The vehicle's way around the structure: where it is and how fast at any time, smooth enough to be differentiated."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from drivers.virtual.chamber.solids import Array
from drivers.virtual.chamber.structure import Path_

_KNOT_S = 1.0


@dataclass(frozen=True)
class Pose:
    """``position`` (..., 3) in the world (NED); ``attitude`` (..., 3): roll, pitch, yaw; ``rotation`` (..., 3, 3) body to
    world."""

    position: Array
    attitude: Array
    rotation: Array


class VehiclePath:
    """An orbit (or waypoints) with small random sway, facing the centre. ``rng`` draws the sway."""

    def __init__(self, path: Path_, rng: np.random.Generator) -> None:
        self.duration_s = path.duration_s
        times = np.arange(-5.0, path.duration_s + 5.0 + _KNOT_S, _KNOT_S)
        share = np.clip(times / path.duration_s, -0.02, 1.02)
        centre = np.array(path.centre)
        if path.waypoints is None:
            swing = 0.5 - 0.5 * np.cos(2 * np.pi * 2.5 * share + 0.7)
            radius = path.radius_m[0] + (path.radius_m[1] - path.radius_m[0]) * swing
            angle = 2 * np.pi * path.turns * share + 0.4 + rng.uniform(-0.3, 0.3)
            depth = path.depth_m[0] + (path.depth_m[1] - path.depth_m[0]) * (0.5 - 0.5 * np.cos(2 * np.pi * 1.7 * share + 1.0))
            position = np.column_stack([centre[0] + radius * np.cos(angle), centre[1] + radius * np.sin(angle), depth])
        else:
            points = np.array(path.waypoints)
            position = CubicSpline(np.linspace(0, 1, len(points)), points)(np.clip(share, 0, 1))
        position = position + 0.03 * _sway(rng, len(times), 3)
        towards = centre - position[:, :2]
        yaw = np.unwrap(np.arctan2(towards[:, 1], towards[:, 0]))
        sway = np.radians(path.sway_deg) * _sway(rng, len(times), 3)
        attitude = np.column_stack([sway[:, 0], sway[:, 1], yaw + 2 * sway[:, 2]])
        self._position = CubicSpline(times, position)
        self._attitude = CubicSpline(times, attitude)

    def pose(self, times: Array | float) -> Pose:
        """Where it is at ``times`` (s since the start), which may be an array."""
        attitude = self._attitude(times)
        return Pose(self._position(times), attitude, rotation_of(attitude))

    def velocity(self, times: Array | float) -> Array:
        """Velocity (..., 3) over ground along the body's own axes: forward, right, down."""
        world = self._position(times, 1)
        body: Array = np.einsum("...ji,...j->...i", rotation_of(self._attitude(times)), world)
        return body

    def attitude_rate(self, times: Array | float) -> Array:
        """Rates (..., 3) of roll, pitch and yaw."""
        rates: Array = self._attitude(times, 1)
        return rates


def rotation_of(attitude: Array) -> Array:
    """Rz(yaw) Ry(pitch) Rx(roll), (..., 3, 3) for (..., 3): from the body's axes to the world's."""
    cr, cp, cy = np.moveaxis(np.cos(attitude), -1, 0)
    sr, sp, sy = np.moveaxis(np.sin(attitude), -1, 0)
    rows = [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def _sway(rng: np.random.Generator, count: int, columns: int) -> Array:
    """Smooth noise of about unit size: white noise through a window of 12 s."""
    window = np.hanning(13)
    white = rng.normal(size=(count + 12, columns))
    smooth = np.stack([np.convolve(white[:, c], window, "valid") for c in range(columns)], axis=1)
    scaled: Array = smooth / np.sqrt((window**2).sum())
    return scaled
