"""The vehicle: nine states, how they go on, and where that puts the sensor (paper, Sec. 4.2 and 4.3).

State x_v = [x y z phi theta psi u v w]: position and roll, pitch, yaw in the world (NED), velocity along the body's own axes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimators.structure.types import Array

SIZE = 9


@dataclass(frozen=True)
class SensorMount:
    """Pose of the sensor on the vehicle: ``rotation`` (3, 3) sensor to body, ``offset`` (3,) in the body's frame."""

    rotation: Array
    offset: Array


@dataclass(frozen=True)
class SensorPose:
    """Where the sensor is: ``rotation`` (3, 3) sensor to world and ``position`` (3,), with what they are made of.

    ``body_turns`` (3, 3, 3): derivatives of the body's rotation by roll, pitch and yaw. ``body`` (3,) is the vehicle's
    position.
    """

    rotation: Array
    position: Array
    body_turns: Array
    body: Array
    mount: SensorMount


def rotation_of(angles: Array) -> Array:
    """Rz(yaw) Ry(pitch) Rx(roll) (3, 3): body to world."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(angles), np.sin(angles)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def rotation_turns(angles: Array) -> Array:
    """Derivatives (3, 3, 3) of ``rotation_of`` by roll, pitch and yaw."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(angles), np.sin(angles)
    roll = [
        [0.0, cy * sp * cr + sy * sr, -cy * sp * sr + sy * cr],
        [0.0, sy * sp * cr - cy * sr, -sy * sp * sr - cy * cr],
        [0.0, cp * cr, -cp * sr],
    ]
    pitch = [
        [-cy * sp, cy * cp * sr, cy * cp * cr],
        [-sy * sp, sy * cp * sr, sy * cp * cr],
        [-cp, -sp * sr, -sp * cr],
    ]
    yaw = [
        [-sy * cp, -sy * sp * sr - cy * cr, -sy * sp * cr + cy * sr],
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [0.0, 0.0, 0.0],
    ]
    return np.array([roll, pitch, yaw])


def sensor_pose(state: Array, mount: SensorMount) -> SensorPose:
    """The sensor of a vehicle in ``state`` (9,)."""
    body = rotation_of(state[3:6])
    return SensorPose(
        body @ mount.rotation, state[:3] + body @ mount.offset, rotation_turns(state[3:6]), state[:3].copy(), mount
    )


def body_rates(angles: Array, rates: Array) -> Array:
    """Turning rates (3,) about the body's axes from those of roll, pitch and yaw."""
    (cr, cp, _), (sr, sp, _) = np.cos(angles), np.sin(angles)
    return np.array([[1, 0, -sp], [0, cr, cp * sr], [0, -sr, cp * cr]]) @ rates


def advanced(state: Array, rates: Array, dt: float) -> tuple[Array, Array, Array]:
    """Eq. 21: the state (9,) after ``dt`` at constant velocity, turning by ``rates`` (3,) of the angles.

    Also its derivative by the state (9, 9) and by the noise of acceleration and of the rates (9, 6).
    """
    body = rotation_of(state[3:6])
    turns = rotation_turns(state[3:6])
    after = state.copy()
    after[:3] += body @ state[6:9] * dt
    after[3:6] += rates * dt
    by_state = np.eye(SIZE)
    by_state[:3, 3:6] = np.einsum("kij,j->ik", turns, state[6:9]) * dt
    by_state[:3, 6:9] = body * dt
    by_noise = np.zeros((SIZE, 6))
    by_noise[:3, :3] = body * dt**2 / 2
    by_noise[3:6, 3:] = np.eye(3) * dt
    by_noise[6:9, :3] = np.eye(3) * dt
    return after, by_state, by_noise


def wrapped(angle: Array) -> Array:
    """Into -pi to pi."""
    return np.asarray((angle + np.pi) % (2 * np.pi) - np.pi)
