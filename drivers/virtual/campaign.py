"""A field campaign of virtual pipes that mirrors the paper's: 74 pipes, 101 recordings, 150 to 1100 mm, with what goes wrong
in sewers.

Every recording is settled by its seed alone, and renders its frames when they are asked for, so that worker processes can
share the work.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from drivers.depth.base import STEREO_SCALE_STD
from drivers.virtual.noise import UNIT_M, StereoCamera, StereoNoise, Window, coarse_rays
from drivers.virtual.profile import PipeProfile, circular, dented, oval
from drivers.virtual.rig import HandMotion, Pose, sway
from drivers.virtual.world import Deposit, Joint, VirtualSewer
from estimators.pinhole import Intrinsics

CAMERA = Intrinsics(640, 480, 381.41, 381.41, 322.6, 237.3)
"""The paper's resolution, with the intrinsics of the shared recordings."""
SIZES_MM = {150: 9, 200: 22, 250: 16, 300: 9, 400: 6, 500: 4, 600: 3, 700: 1, 800: 1, 900: 1, 1100: 2}
"""Pipes of each size: 74, of which the 27 above 250 mm are recorded at two positions, which makes 101 recordings."""
_BOX_M = 0.06
"""Nearest that the camera's eye comes to a wall: half the box."""

TROUBLES = {
    "water": 0.50,
    "end in view": 0.30,
    "chamber in view": 0.30,
    "tilt": 0.17,
    "poor light": 0.22,
    "speckle": 0.20,
    "dirt": 0.17,
    "drops": 0.15,
    "deposit": 0.20,
    "hand motion": 0.15,
    "out of round": 0.15,
    "dent": 0.08,
    "hopeless": 0.015,
}
"""How often each trouble befalls a recording (water, deposit and shape: a pipe). The one place where the difficulty is set."""


@dataclass(frozen=True)
class VirtualRecording:
    """One recording: the sewer, the box in it, and the camera's troubles. Truth is the mean interior diameter of the
    profile."""

    id: str
    pipe_id: str
    dn: int
    truth_diameter_m: float
    position: str
    troubles: tuple[str, ...]
    sewer: VirtualSewer
    pose: Pose
    motion: HandMotion
    noise: StereoNoise
    window: Window
    blur: float
    seed: tuple[int, ...]

    def frames(self, count: int = 50) -> Iterator[tuple[NDArray[np.uint16], Intrinsics, float]]:
        """Depth pictures with their intrinsics and unit, the same on every call."""
        rng = np.random.default_rng(self.seed)
        camera = StereoCamera(CAMERA, self.noise, self.window, rng, self.blur)
        coarse = coarse_rays(CAMERA)
        for pose in islice(sway(self.pose, self.motion, rng), count):
            yield camera.picture(self.sewer.cast(pose.position, pose.rotation, coarse)), CAMERA, UNIT_M


def campaign(seed: int, recordings: int = 101) -> list[VirtualRecording]:
    """The recordings of one campaign; fewer than 101 are a fair sample of its sizes."""
    rng = np.random.default_rng([74, seed])
    sizes = rng.permutation([size for size, count in SIZES_MM.items() for _ in range(count)])
    found: list[VirtualRecording] = []
    for number, dn in enumerate(sizes):
        found += _pipe(seed, number, int(dn), np.random.default_rng([seed, number]))
    return found[:recordings]


def _pipe(seed: int, number: int, dn: int, rng: np.random.Generator) -> list[VirtualRecording]:
    """One pipe with its one or two recordings."""
    troubles = {name for name in ("water", "deposit", "out of round", "dent") if rng.random() < TROUBLES[name]}
    diameter = dn / 1000 * (1 + 0.01 * float(np.clip(rng.normal(), -2, 2)))
    profile = _profile(diameter, troubles, rng)
    height = 2 * profile.below()
    sewer = VirtualSewer(
        profile,
        length=float(rng.uniform(4, 12)),
        water=float(rng.uniform(0.05, 0.38)) * height if "water" in troubles else 0.0,
        deposit=_deposit(height, rng) if "deposit" in troubles else None,
        joints=tuple(Joint(float(z)) for z in np.arange(rng.uniform(0.3, 1.0), 6.0, 1.0)),
    )
    scale = float(rng.normal(0, STEREO_SCALE_STD))
    positions = ("top", "middle") if dn > 250 else ("top",)
    return [
        _recording(seed, number, dn, sewer, position, troubles, scale, np.random.default_rng([seed, number, k + 1]), k)
        for k, position in enumerate(positions)
    ]


def _profile(diameter: float, troubles: set[str], rng: np.random.Generator) -> PipeProfile:
    if "dent" in troubles:
        return dented(diameter, float(rng.uniform(0.02, 0.07)) * diameter, float(rng.uniform(-np.pi, np.pi)), 0.4)
    if "out of round" in troubles:
        squeeze = float(rng.uniform(0.005, 0.025))
        return oval(diameter * (1 + squeeze), diameter * (1 - squeeze))
    return circular(diameter)


def _deposit(height: float, rng: np.random.Generator) -> Deposit:
    start = float(rng.uniform(0.2, 1.2))
    return Deposit(start, start + float(rng.uniform(0.2, 1.5)), float(rng.uniform(0.05, 0.2)) * height)


def _recording(
    seed: int,
    number: int,
    dn: int,
    sewer: VirtualSewer,
    position: str,
    pipe_troubles: set[str],
    scale: float,
    rng: np.random.Generator,
    order: int,
) -> VirtualRecording:
    own = [name for name in TROUBLES if name not in ("water", "deposit", "out of round", "dent")]
    troubles = pipe_troubles | {name for name in own if rng.random() < TROUBLES[name]}
    radius = float(np.mean(sewer.profile.radii))
    if "end in view" in troubles:
        sewer = VirtualSewer(
            sewer.profile, float(rng.uniform(3, 10)) * max(radius, 0.12), sewer.water, sewer.deposit, sewer.joints
        )
    poor, hopeless = "poor light" in troubles, "hopeless" in troubles
    noise = StereoNoise(
        fine=0.14 * float(rng.uniform(0.8, 1.6)),
        coarse=0.16 * float(rng.uniform(0.8, 1.8)),
        light=0.25 if hopeless else float(rng.uniform(0.42, 0.6)) if poor else float(rng.uniform(0.75, 1.05)),
        speckles=float(rng.uniform(200, 700)) if "speckle" in troubles or hopeless else float(rng.uniform(20, 90)),
    )
    moving = "hand motion" in troubles
    return VirtualRecording(
        id=f"{number:02d}-{'ab'[order]}",
        pipe_id=f"{number:02d}",
        dn=dn,
        truth_diameter_m=sewer.profile.mean_diameter,
        position=position,
        troubles=tuple(sorted(troubles)),
        sewer=sewer,
        pose=_pose(radius, sewer, position, troubles, rng),
        motion=HandMotion(0.008, 0.02, 12.0) if moving else HandMotion(0.0015, 0.003, 25.0),
        noise=noise,
        window=Window(scale, _smears(troubles, rng)),
        blur=float(rng.uniform(1.5, 4.0)) if moving else 0.0,
        seed=(seed, number, order, 2),
    )


def _pose(radius: float, sewer: VirtualSewer, position: str, troubles: set[str], rng: np.random.Generator) -> Pose:
    """At the top of the pipe or in its middle, clear of walls and water; in front of the mouth where the chamber is in view."""
    room = max(radius - _BOX_M, 0.0)
    floor = max(sewer.profile.below() - sewer.water - _BOX_M, -0.5 * radius)
    height = -0.75 * room if position == "top" else float(rng.uniform(-0.2, 0.2)) * room
    down = min(height + float(rng.normal(0, 0.1)) * room, floor)
    right = float(np.clip(rng.normal(0, 0.15), -0.4, 0.4)) * np.sqrt(max(room**2 - down**2, 0.0))
    tilt = np.radians(rng.normal(0, 3, 3) + (rng.uniform(8, 18) * rng.choice([-1, 1], 3) if "tilt" in troubles else 0.0))
    chainage = -float(rng.uniform(0.05, 0.45)) if "chamber in view" in troubles else float(rng.uniform(0.0, 0.3))
    yaw, pitch = (float(a) for a in np.clip(tilt[:2], *np.radians([-20, 20])))
    return Pose(right, down, chainage, yaw, pitch, float(np.radians(rng.normal(0, 3))))


def _smears(troubles: set[str], rng: np.random.Generator) -> tuple[tuple[float, float, float], ...]:
    """Dirt is a few large blobs, drops are many small ones."""
    found = []
    if "dirt" in troubles:
        found += [(*rng.uniform(0, 1, 2) * [1, 0.75], rng.uniform(0.06, 0.2)) for _ in range(int(rng.integers(2, 6)))]
    if "drops" in troubles:
        found += [(*rng.uniform(0, 1, 2) * [1, 0.75], rng.uniform(0.015, 0.05)) for _ in range(int(rng.integers(8, 25)))]
    return tuple((float(x), float(y), float(r)) for x, y, r in found)
