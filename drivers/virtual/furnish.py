"""Fills a long virtual pipe with what lies in sewers."""

from __future__ import annotations

import math

import numpy as np

from drivers.virtual.landmarks import Connection, DisplacedJoint, Fracture, Patch, Roots, Thing
from drivers.virtual.profile import circular
from drivers.virtual.world import Joint, VirtualSewer

COUNTS = {"connection": 4, "deposit": 2, "displaced joint": 2, "fracture": 2, "roots": 2}
"""Landmarks in 25 m of pipe."""
_JOINT_M = 0.02


def furnished_sewer(rng: np.random.Generator, length: float, diameter: float) -> VirtualSewer:
    """A round pipe of ``length`` and ``diameter`` (m) with joints, water at times, and COUNTS landmarks in 25 m, each apart
    from the next, none in the first or last 1.8 m."""
    spacing = float(rng.uniform(1.1, 1.7))
    joints = np.arange(float(rng.uniform(0.6, 1.2)), length - 0.3, spacing)
    wanted = [label for label, count in COUNTS.items() for _ in range(max(1, round(count * length / 25.0)))]
    rng.shuffle(wanted)
    slots = np.linspace(1.8, length - 1.8, len(wanted) + 1)
    water = float(rng.uniform(0.02, 0.06)) * diameter if rng.random() < 0.6 else 0.0
    things = [
        _thing(label, (float(begin), float(end)), joints, diameter / 2, water, rng)
        for label, begin, end in zip(wanted, slots[:-1], slots[1:], strict=True)
    ]
    return VirtualSewer(
        circular(diameter), length, water, joints=tuple(Joint(float(z), _JOINT_M) for z in joints), things=tuple(things)
    )


def _thing(
    label: str, slot: tuple[float, float], joints: np.ndarray, radius: float, water: float, rng: np.random.Generator
) -> Thing:
    """One landmark of a kind between two chainages; what belongs to a joint lies at one, where there is one, and a deposit
    stands out of the ``water`` (m)."""
    begin, end = slot
    room = end - begin
    at = begin + room * float(rng.uniform(0.25, 0.75))
    own = joints[(joints > begin + 0.1) & (joints < end - 0.1)]
    joint = float(own[np.argmin(np.abs(own - at))]) if len(own) else at
    upper = float(rng.uniform(-math.pi, 0.0))
    if label == "connection":
        return Connection(at, upper, radius * float(rng.uniform(0.66, 1.0)))
    if label == "deposit":
        half = room * float(rng.uniform(0.2, 0.4))
        angle = math.pi / 2 + float(rng.normal(0, 0.15))
        return Patch(
            at - half, at + half, angle, float(rng.uniform(0.3, 0.65)), 1.3 * water + radius * float(rng.uniform(0.08, 0.2))
        )
    if label == "displaced joint":
        return DisplacedJoint(joint, float(rng.uniform(-math.pi, math.pi)), radius * float(rng.uniform(0.07, 0.14)))
    if label == "fracture":
        half, turn = room * float(rng.uniform(0.1, 0.25)), float(rng.normal(0, 0.25))
        return Fracture(at - half, at + half, upper - turn, upper + turn)
    return Roots(joint, upper, float(rng.uniform(0.2, 0.6)), radius * float(rng.uniform(0.4, 0.9)), int(rng.integers(25, 80)))
