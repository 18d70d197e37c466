"""Lines and points as features of the filter: how they look from the sensor, how they enter the map, with all Jacobians.

The paper's four numbers of a line (eq. 2) have places where they run away (see ``orthonormal``). A line here is a point on
it and a direction; its four errors are offsets of that point along two directions across the line, and turns of the
direction towards them. That is regular everywhere, and a scan observes exactly these four.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from estimators.structure.types import Array, Segment
from estimators.structure.vehicle import SIZE, SensorPose


@dataclass(frozen=True)
class Line:
    """Through ``point`` (3,) along the unit vector ``direction`` (3,), with two directions ``across`` (2, 3)."""

    point: Array
    direction: Array
    across: Array

    def moved(self, error: Array) -> Line:
        """The line with ``error`` (4,) added: offsets across, then turns."""
        direction = self.direction + error[2:] @ self.across
        direction = direction / math.sqrt(direction @ direction)
        first = self.across[0] - (self.across[0] @ direction) * direction
        first /= math.sqrt(first @ first)
        # written out: this is called for each line at each reading, and numpy's cross product takes longer than all the rest
        x, y, z = direction.tolist()
        a, b, c = first.tolist()
        across = np.array([[a, b, c], [y * c - z * b, z * a - x * c, x * b - y * a]])
        return Line(self.point + error[:2] @ self.across, direction, across)

    def along(self, points: Array) -> Array:
        """Places (...,) of ``points`` (..., 3) along it, from ``point``."""
        return np.asarray((points - self.point) @ self.direction)


@dataclass(frozen=True)
class Seen:
    """How a feature should look: ``innovation`` (m,), derivatives of the expected observation by the vehicle (m, 9) and by the
    feature's own error (m, f), and the noise (m, m) of the observation."""

    innovation: Array
    by_vehicle: Array
    by_feature: Array
    noise: Array


def observe_line(line: Line, pose: SensorPose, segment: Segment) -> Seen:
    """What the filter makes of ``segment`` if it shows ``line``: eqs. 30 to 35 in the errors of this module.

    Expected are offset and turn of the line, in the sensor's frame, relative to the segment at its middle.
    """
    back = pose.rotation.T
    middle, direction, across = segment.middle, segment.direction, segment.across
    point = back @ (line.point - pose.position)
    along = back @ line.direction
    sign = 1.0 if along @ direction >= 0 else -1.0
    along = sign * along
    scale = float(along @ direction)
    slope = along / scale
    reach = float((middle - point) @ direction)
    expected = np.concatenate([across @ (point - middle + slope * reach), across @ slope])
    flat = across @ (np.eye(3) - np.outer(slope, direction))
    by_point = np.vstack([flat, np.zeros((2, 3))])
    by_along = np.vstack([flat * (reach / scale), flat / scale])
    turn_back = pose.mount.rotation.T @ np.swapaxes(pose.body_turns, 1, 2)
    by_vehicle = np.zeros((4, SIZE))
    by_vehicle[:, :3] = -by_point @ back
    for k in range(3):
        by_vehicle[:, 3 + k] = (
            by_point @ turn_back[k] @ (line.point - pose.body) + sign * by_along @ turn_back[k] @ line.direction
        )
    into = back @ line.across.T
    by_feature = np.hstack([by_point @ into, by_along @ into * sign])
    return Seen(-expected, by_vehicle, by_feature, segment.covariance)


def new_line(pose: SensorPose, segment: Segment) -> tuple[Line, Array]:
    """Eq. 38: a segment as a line of the map, and the derivative (4, 9) of its errors by the vehicle (J1 of eq. 42).

    J2 of eq. 43 is the identity: the errors of a segment are those of its line.
    """
    line = Line(
        pose.position + pose.rotation @ segment.middle, pose.rotation @ segment.direction, segment.across @ pose.rotation.T
    )
    by_vehicle = np.zeros((4, SIZE))
    by_vehicle[:2, :3] = line.across
    arm = pose.mount.offset + pose.mount.rotation @ segment.middle
    along = pose.mount.rotation @ segment.direction
    for k in range(3):
        by_vehicle[:2, 3 + k] = line.across @ (pose.body_turns[k] @ arm)
        by_vehicle[2:, 3 + k] = line.across @ (pose.body_turns[k] @ along)
    return line, by_vehicle


def observe_point(point: Array, pose: SensorPose, position: Array, covariance: Array) -> Seen:
    """Eq. 44: where ``point`` (3,) should be in the sensor's frame, against ``position`` (3,)."""
    back = pose.rotation.T
    by_vehicle = np.zeros((3, SIZE))
    by_vehicle[:, :3] = -back
    for k in range(3):
        by_vehicle[:, 3 + k] = pose.mount.rotation.T @ (pose.body_turns[k].T @ (point - pose.body))
    return Seen(position - back @ (point - pose.position), by_vehicle, back, covariance)


def new_point(pose: SensorPose, position: Array) -> tuple[Array, Array]:
    """Eq. 45: an object's position in the world, and its derivative (3, 9) by the vehicle; that by ``position`` is the
    rotation."""
    by_vehicle = np.zeros((3, SIZE))
    by_vehicle[:, :3] = np.eye(3)
    arm = pose.mount.offset + pose.mount.rotation @ position
    for k in range(3):
        by_vehicle[:, 3 + k] = pose.body_turns[k] @ arm
    return pose.position + pose.rotation @ position, by_vehicle
