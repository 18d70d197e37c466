"""Virtual stereo pairs with known truth (figure 3): deposits of 5 to 60 mm, lost wall, joints, smooth stretches, in round and
egg-shaped pipes. Prints the point-wise AUROC, regions found and false ones in clean pictures, and how scores follow the true
volumes."""

from __future__ import annotations

import argparse
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.virtual.landmarks import Patch
from drivers.virtual.profile import circular, egg
from drivers.virtual.rig import Pose
from drivers.virtual.stereo_camera import StereoLens, StereoLook, StereoPainter
from drivers.virtual.world import Joint, VirtualSewer
from estimators.anomaly.pair import PairFindings, inspect_pair
from estimators.stereo.follow import Refused
from estimators.stereo.rig import StereoRig
from tests.bench.table import print_table

LENS = StereoLens()
LARGE_M = 0.015
"""Regions of this height or more must be found."""
_POSITIVE_M, _NEGATIVE_M = 0.004, 0.001


@dataclass(frozen=True)
class Scene:
    """One pair: what is rendered, and from where."""

    sewer: VirtualSewer
    look: StereoLook
    pose: Pose
    seed: int


def scene(seed: int, clean: bool) -> Scene:
    """A pipe of 250 to 500 mm, round or egg-shaped, with up to three defects (none where ``clean``), joints and smooth
    stretches."""
    rng = np.random.default_rng([seed, int(clean)])
    profile = circular(float(rng.uniform(0.25, 0.5))) if rng.random() < 0.6 else egg(float(rng.uniform(0.25, 0.4)))
    radius = float(np.mean(profile.radii))
    start = 2.0
    things = []
    if not clean:
        for _ in range(int(rng.integers(1, 4))):
            height = float(rng.uniform(0.005, min(0.06, 0.3 * radius))) * (1.0 if rng.random() < 0.65 else -0.5)
            at = start + float(rng.uniform(2.2, 5.0)) * radius
            length = float(rng.uniform(2.0, 5.0)) * max(abs(height), 0.015)
            spread = float(rng.uniform(1.0, 2.5)) * max(abs(height), 0.015) / radius
            things.append(Patch(at, at + length, float(rng.uniform(-np.pi, np.pi)), min(spread, 0.9), height))
    joints = (Joint(start + float(rng.uniform(3.0, 5.0)) * radius),) if rng.random() < 0.4 else ()
    smooth = ((start + 3.0 * radius, start + 3.8 * radius),) if rng.random() < 0.3 else ()
    sewer = VirtualSewer(profile, start + 8.0 * radius, joints=joints, things=tuple(things))
    right, down = rng.uniform(-0.1, 0.1, 2) * radius
    yaw, pitch = rng.uniform(-0.03, 0.03, 2)
    look = StereoLook(grain=float(rng.uniform(0.08, 0.3)), smooth=smooth, noise=float(rng.uniform(1.0, 2.5)))
    return Scene(sewer, look, Pose(float(right), float(down), start, float(yaw), float(pitch)), seed)


def plastic(seed: int) -> Scene:
    """A clean pipe as smooth as new plastic."""
    found = scene(seed, True)
    return Scene(found.sewer, StereoLook(grain=0.02, noise=2.0), found.pose, seed)


def look_at(found: Scene) -> PairFindings:
    """The survey's findings. Raises Refused."""
    painter = StereoPainter(found.sewer, LENS, found.look, found.seed)
    left, right = painter.pair(found.pose, np.random.default_rng([found.seed, 3]))
    rig = StereoRig(LENS.intrinsics, LENS.baseline_m, LENS.offset_px)
    return inspect_pair(left, right, rig, np.random.default_rng(found.seed))


def true_heights(found: Scene, findings: PairFindings) -> NDArray[np.float32]:
    """How far the wall stands in (m) at each cell of the map, by the world itself."""
    at = findings.map
    place = at.points @ found.pose.rotation.T + found.pose.position
    if not found.sewer.relief:
        return np.zeros(at.radius.shape, np.float32)
    angle = np.arctan2(place[..., 1], place[..., 0]).astype(np.float32)
    return found.sewer.relief.height(place[..., 2].astype(np.float32), angle)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--scenes", type=int, default=100, help="pairs with defects")
    parser.add_argument("--clean", type=int, default=100, help="clean pairs")
    parser.add_argument("--smooth", type=int, default=20, help="clean pairs as smooth as plastic")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    cv2.setNumThreads(1)
    scores: list[NDArray[np.float32]] = []
    labels: list[NDArray[np.bool_]] = []
    volumes: list[tuple[float, float, float, float]] = []
    large = found_large = refused = 0
    missed = []
    for seed in range(options.seed, options.seed + options.scenes):
        one = scene(seed, False)
        try:
            findings = look_at(one)
        except Refused as refusal:
            refused += 1
            print(f"seed {seed}: {refusal.reason}", flush=True)
            continue
        heights = true_heights(one, findings)
        at = findings.map
        rings = (
            np.any([np.abs(at.depth - joint.depth) < 0.03 for joint in findings.joints], axis=0) if findings.joints else False
        )
        usable = at.measured & ~np.broadcast_to(np.asarray(rings).reshape(-1, 1), at.measured.shape)
        clear = usable & ((np.abs(heights) > _POSITIVE_M) | (np.abs(heights) < _NEGATIVE_M))
        if one.sewer.joints:
            clear &= ~near_joint(one, findings)
        scores.append(np.abs(at.deviation[clear]))
        labels.append(np.abs(heights[clear]) > _POSITIVE_M)
        area = at.area * usable
        inward, outward = ((area * np.maximum(sign * heights, 0)).sum() / area.sum() for sign in (1, -1))
        volumes.append((findings.inward, float(inward), findings.outward, float(outward)))
        for patch in one.sewer.things:
            assert isinstance(patch, Patch)
            if abs(patch.height) < LARGE_M:
                continue
            alone = VirtualSewer(one.sewer.profile, one.sewer.length, things=(patch,))
            its = true_heights(Scene(alone, one.look, one.pose, seed), findings)
            core = at.wall & (np.abs(its) > 0.5 * abs(patch.height))
            # counted where the survey says that it looked: what lies beyond the band's ends is not its claim
            if core.sum() < 20 or (core & (at.measured | at.hidden)).sum() < 0.3 * core.sum():
                continue
            large += 1
            hit = any(
                core.ravel()[region.cells].any() and np.sign(region.peak) == -np.sign(patch.height) and not region.expected
                for region in findings.regions
            )
            found_large += hit
            if not hit:
                missed.append(f"seed {seed}: {1000 * patch.height:.0f} mm")
    every, truth = np.concatenate(scores), np.concatenate(labels)
    false, clean_refused = count_false(options.seed, options.clean, lambda seed: scene(seed, True))
    smooth_false, smooth_refused = count_false(options.seed, options.smooth, plastic)
    columns = np.array(volumes).T
    rows = [
        ("point-wise AUROC", f"{auroc(every, truth):.4f}", f"{truth.sum()} of {truth.size} points off the wall"),
        (f"regions of {1000 * LARGE_M:.0f} mm or more found", f"{found_large} of {large}", "; ".join(missed)),
        ("false regions in clean pairs", f"{false} in {options.clean - clean_refused}", f"{clean_refused} refused"),
        ("false regions in smooth pipes", f"{smooth_false} in {options.smooth - smooth_refused}", f"{smooth_refused} refused"),
        ("Pearson, inward score and deposits", f"{np.corrcoef(columns[0], columns[1])[0, 1]:.3f}", f"{len(volumes)} pairs"),
        ("Pearson, outward score and lost wall", f"{np.corrcoef(columns[2], columns[3])[0, 1]:.3f}", f"{refused} refused"),
    ]
    print_table("Virtual pairs", ("", "figure", ""), rows)


def near_joint(found: Scene, findings: PairFindings) -> NDArray[np.bool_]:
    """Cells within 2 cm of a true joint: neither defect nor plain wall."""
    at = findings.map
    near = np.zeros(len(at.depth), bool)
    for joint in found.sewer.joints:
        near |= np.abs(at.depth + found.pose.chainage - joint.chainage) < 0.02 + joint.width
    return np.broadcast_to(near[:, None], at.measured.shape)


def count_false(first: int, count: int, make: object) -> tuple[int, int]:
    """(regions that are not expected, pairs refused) in clean scenes."""
    false = refused = 0
    for seed in range(first, first + count):
        try:
            findings = look_at(make(seed))  # type: ignore[operator]
        except Refused:
            refused += 1
            continue
        wrong = [region for region in findings.regions if not region.expected]
        for region in wrong:
            print(f"false, seed {seed}: {region.kind} {1000 * region.peak:.1f} mm {1e6 * region.area:.0f} mm2", flush=True)
        false += len(wrong)
    return false, refused


def auroc(score: NDArray[np.float32], truth: NDArray[np.bool_]) -> float:
    """Chance that a point off the wall scores higher than one on it."""
    order = np.argsort(score)
    ranks = np.empty(len(score))
    ranks[order] = np.arange(1, len(score) + 1)
    positive = int(truth.sum())
    negative = len(truth) - positive
    if not positive or not negative:
        return float("nan")
    return float((ranks[truth].sum() - positive * (positive + 1) / 2) / (positive * negative))


if __name__ == "__main__":
    main()
