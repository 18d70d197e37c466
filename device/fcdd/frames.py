"""Labelled pictures of the virtual sewer, for what archives of stills lack: connections, and where things are."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.virtual.camera import CctvCamera
from drivers.virtual.cctv import Renderer
from drivers.virtual.detections import SeenLandmark, ideal_at
from drivers.virtual.landmarks import LABELS, Connection, DisplacedJoint, Fracture, Patch, Roots, Thing
from drivers.virtual.look import random_look
from drivers.virtual.profile import circular
from drivers.virtual.rig import Pose
from drivers.virtual.world import Joint, VirtualSewer

_PIPE_M = 7.0
_NEAR_FIELD, _FAR_FIELD = 1.2, 7.0
"""Radii ahead of the camera between which a thing is sure to be seen; what is about to be seen is not labelled at all."""


@dataclass(frozen=True)
class RenderedFrame:
    """``image`` (h, w, 3) BGR; ``seen`` is what it shows; ``unsure`` are classes that may or may not be made out in it."""

    image: NDArray[np.uint8]
    seen: tuple[SeenLandmark, ...]
    unsure: frozenset[str]


def rendered_frames(pipes: int, frames_each: int, seed: int) -> Iterator[RenderedFrame]:
    """Pictures of ``pipes`` random pipes, of every class with and without; the same for the same ``seed``."""
    for number in range(pipes):
        rng = np.random.default_rng([seed, 91, number])
        radius = float(rng.choice([0.1, 0.125, 0.15, 0.2, 0.3]))
        sewer = _pipe(rng, radius)
        camera = CctvCamera()
        renderer = Renderer(sewer, camera, random_look(rng), int(rng.integers(1 << 30)))
        for _ in range(frames_each):
            pose = _pose(rng, radius)
            before = Pose(**{**vars(pose), "chainage": pose.chainage - 0.004})
            image = renderer.picture(pose, rng, before)
            seen, unsure = shown_in(sewer, camera, pose)
            yield RenderedFrame(image, seen, unsure)


def _pipe(rng: np.random.Generator, radius: float) -> VirtualSewer:
    joints = tuple(Joint(float(z), 0.02) for z in np.arange(rng.uniform(0.2, 1.0), _PIPE_M, rng.uniform(0.8, 2.2)))
    wanted = [label for label in LABELS if rng.random() < (0.5 if label == "connection" else 0.25)]
    things = tuple(_thing(label, joints, radius, rng) for label in wanted)
    water = float(rng.uniform(0.03, 0.2)) * radius if rng.random() < 0.4 else 0.0
    return VirtualSewer(circular(2 * radius), _PIPE_M, water, joints=joints, things=things)


def _thing(label: str, joints: tuple[Joint, ...], radius: float, rng: np.random.Generator) -> Thing:
    at = float(rng.uniform(4, 9)) * radius
    joint = min((joint.chainage for joint in joints), key=lambda z: abs(z - at))
    upper, around = float(rng.uniform(-math.pi, 0)), float(rng.uniform(-math.pi, math.pi))
    if label == "connection":
        return Connection(at, upper if rng.random() < 0.8 else around, radius * float(rng.uniform(0.5, 1.2)))
    if label == "deposit":
        length = radius * float(rng.uniform(1.5, 8))
        spread, height = float(rng.uniform(0.3, 0.8)), radius * float(rng.uniform(0.06, 0.2))
        return Patch(at, at + length, math.pi / 2 + float(rng.normal(0, 0.2)), spread, height)
    if label == "displaced joint":
        return DisplacedJoint(joint, around, radius * float(rng.uniform(0.07, 0.16)))
    if label == "fracture":
        return Fracture(at, at + radius * float(rng.uniform(1, 5)), upper, upper + float(rng.normal(0, 0.6)))
    length = radius * float(rng.uniform(0.4, 0.9))
    return Roots(joint, upper, float(rng.uniform(0.2, 0.6)), length, int(rng.integers(25, 80)))


def _pose(rng: np.random.Generator, radius: float) -> Pose:
    right, down = 0.08 * radius * rng.normal(size=2)
    yaw, pitch = 0.09 * rng.normal(size=2)
    return Pose(
        float(right),
        float(down) + 0.08 * radius,
        float(rng.uniform(0.0, 9) * radius),
        float(yaw),
        float(pitch),
        float(rng.normal(0, 0.03)),
    )


def shown_in(sewer: VirtualSewer, camera: CctvCamera, pose: Pose) -> tuple[tuple[SeenLandmark, ...], frozenset[str]]:
    """What lies in the field, and the classes of which something lies at its border."""
    near, far = pose.chainage + _NEAR_FIELD * sewer.radius, pose.chainage + _FAR_FIELD * sewer.radius
    sure = [thing for thing in sewer.landmarks if thing.chainage_to >= near and thing.chainage <= far]
    seen = tuple(ideal_at(camera, pose, sewer.radius, sure))
    labels = {one.label for one in seen}
    around = {
        thing.label
        for thing in sewer.landmarks
        if pose.chainage <= thing.chainage_to <= near or far < thing.chainage <= far + 6 * sewer.radius
    }
    return seen, frozenset((around | {thing.label for thing in sure}) - labels)
