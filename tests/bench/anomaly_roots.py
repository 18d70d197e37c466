"""Roots that hang free in the pipe, in virtual stereo pairs: how many are found, how many are told to be objects by the wall
that they hide, and how many deposits, which lie on the wall, are falsely called so."""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.virtual.landmarks import Patch, Roots
from drivers.virtual.look import Look
from drivers.virtual.rig import Pose
from drivers.virtual.roots import RootTufts
from drivers.virtual.stereo_camera import StereoLens, StereoPainter
from drivers.virtual.world import VirtualSewer
from estimators.anomaly.pair import PairFindings, inspect_pair
from estimators.anomaly.regions import Region
from estimators.stereo.follow import Refused
from estimators.stereo.rig import StereoRig
from tests.bench.anomaly_virtual import LENS, Scene, look_at, scene
from tests.bench.table import print_table

_LIT = 1.2
"""Light on a root a metre ahead, in the units of the CCTV twin's film: about as bright as the wall behind."""
_ALONG_M, _ASIDE = 0.12, 0.35
"""A region belongs to a root or deposit within so much of it, along the pipe and around it (rad)."""


@dataclass(frozen=True)
class Eye:
    """One camera of the pair as the roots are drawn for: ``aside`` (m) to the right of the pose."""

    lens: StereoLens
    aside: float

    @property
    def fy(self) -> float:
        """Focal length (px)."""
        return self.lens.intrinsics.fy

    def project(self, pose: Pose, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Pixels (n, 2) of points (n, 3) of the pipe frame; nan behind the camera."""
        camera = self.lens.intrinsics
        x, y, z = ((points - pose.position) @ pose.rotation - [self.aside, 0.0, 0.0]).T
        ahead = np.where(z > 0.05, z, np.nan)
        return np.stack([camera.fx * x / ahead + camera.ppx, camera.fy * y / ahead + camera.ppy], axis=1)


def rooted(seed: int) -> Scene:
    """A clean pipe with roots at one place."""
    clean = scene(seed, True)
    rng = np.random.default_rng([seed, 8])
    at = clean.pose.chainage + float(rng.uniform(2.2, 5.0)) * clean.sewer.radius
    length = float(rng.uniform(0.25, 0.6)) * clean.sewer.radius
    roots = Roots(at, float(rng.uniform(-np.pi, 0)), float(rng.uniform(0.2, 0.5)), length, int(rng.integers(40, 160)))
    sewer = VirtualSewer(clean.sewer.profile, clean.sewer.length, joints=clean.sewer.joints, things=(roots,))
    return replace(clean, sewer=sewer)


def pictures(found: Scene) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """The pair (H, W) of a scene with its roots."""
    painter = StereoPainter(found.sewer, LENS, found.look, found.seed)
    pair = []
    for light, aside in zip(painter.scene(found.pose), (0.0, LENS.baseline_m), strict=True):
        drawn = np.repeat(np.clip(light, 0, 255).astype(np.uint8)[..., None], 3, axis=2)
        tufts = RootTufts(found.sewer, Eye(LENS, aside), Look(haze=0.0), found.seed)  # type: ignore[arg-type]
        tufts.draw(drawn, found.pose, lambda depth: np.asarray(_LIT / np.maximum(depth, 0.15), np.float32))
        pair.append(cv2.cvtColor(drawn, cv2.COLOR_BGR2GRAY).astype(np.float32))
    left, right = painter.taken((pair[0], pair[1]), np.random.default_rng([found.seed, 3]))
    return left, right


def at_place(found: Scene, findings: PairFindings, chainage: float, angle: float) -> list[Region]:
    """Inward regions at a place."""
    return [
        region
        for region in findings.regions
        if region.peak < 0
        and region.depths[0] - _ALONG_M < chainage - found.pose.chainage < region.depths[1] + _ALONG_M
        and abs(np.angle(np.exp(1j * (region.theta - angle)))) < _ASIDE + region.width / 2
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--scenes", type=int, default=50, help="pairs with roots, and as many with deposits")
    parser.add_argument("--seed", type=int, default=4001, help="the first; below 1000 served development")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    rig = StereoRig(LENS.intrinsics, LENS.baseline_m, LENS.offset_px)
    looked = found_roots = told = elsewhere = lost = 0
    for seed in range(options.seed, options.seed + options.scenes):
        one = rooted(seed)
        try:
            findings = inspect_pair(*pictures(one), rig, np.random.default_rng(seed))
        except Refused:
            continue
        looked += 1
        (roots,) = one.sewer.things
        there = at_place(one, findings, roots.chainage, roots.angle)
        found_roots += bool(there)
        told += any(region.kind == "object" for region in there)
        for region in findings.regions:
            aside = abs(np.angle(np.exp(1j * (region.theta - roots.angle)))) - region.width / 2
            behind = aside < _ASIDE + roots.spread and region.depths[1] > roots.chainage - one.pose.chainage
            elsewhere += region.kind == "object" and not behind  # in its shadow are more pieces of the same
            lost += region.kind == "loss"
    deposits = found_deposits = wrong = 0
    for seed in range(options.seed, options.seed + options.scenes):
        one = scene(seed, False)
        try:
            findings, _ = look_at(one)
        except Refused:
            continue
        for thing in one.sewer.things:
            if not isinstance(thing, Patch) or thing.height < 0:
                continue
            deposits += 1
            there = at_place(one, findings, (thing.start + thing.end) / 2, thing.angle)
            found_deposits += bool(there)
            wrong += any(region.kind == "object" for region in there)
    print_table(
        "Roots and deposits",
        ("", "of", "found", "called object"),
        [
            ("roots", looked, found_roots, told),
            ("deposits", deposits, found_deposits, wrong),
            ("objects where no root is", "", "", elsewhere),
            ("lost wall in the pairs with roots, where none is", "", lost, ""),
        ],
    )


if __name__ == "__main__":
    main()
