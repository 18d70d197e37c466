"""Virtual stereo pairs with known truth (figure 3): deposits of 5 to 60 mm, lost wall, joints, smooth stretches, in round and
egg-shaped pipes. Prints the point-wise AUROC, regions found and false ones in clean pictures, and how scores follow the true
volumes."""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.virtual.landmarks import Patch, Thing
from drivers.virtual.profile import circular, egg
from drivers.virtual.relief import Relief
from drivers.virtual.rig import Pose
from drivers.virtual.stereo_camera import StereoLens, StereoLook, StereoPainter
from drivers.virtual.world import DEPOSIT, WALL, Joint, VirtualSewer
from estimators.anomaly.deviation import DeviationMap, PointDeviations, deviation_map
from estimators.anomaly.joints import ring_cells
from estimators.anomaly.pair import PairFindings, inspect_pair
from estimators.anomaly.score import lost_wall
from estimators.stereo.follow import Refused
from estimators.stereo.rig import StereoRig
from tests.bench.table import print_table

LENS = StereoLens()
LARGE_M = 0.015
"""Regions of this height or more must be found. Of a hole in the wall as much can be seen as a ray goes in over its length: the
near edge hides the rest."""
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


class Found:
    """Counts what was found, and names what was not."""

    def __init__(self) -> None:
        self.hits = self.total = 0
        self.names: list[str] = []

    def count(self, hit: bool, what: str) -> None:
        self.total += 1
        self.hits += hit
        if not hit:
            self.names.append(what)

    @property
    def share(self) -> str:
        return f"{self.hits} of {self.total}"

    @property
    def missed(self) -> str:
        return "; ".join(self.names)


def look_at(found: Scene) -> tuple[PairFindings, float]:
    """The survey's findings, and the processor time they took. Raises Refused."""
    painter = StereoPainter(found.sewer, LENS, found.look, found.seed)
    left, right = painter.pair(found.pose, np.random.default_rng([found.seed, 3]))
    rig = StereoRig(LENS.intrinsics, LENS.baseline_m, LENS.offset_px)
    begun = time.process_time()
    findings = inspect_pair(left, right, rig, np.random.default_rng(found.seed))
    return findings, time.process_time() - begun


@dataclass(frozen=True)
class Truth:
    """What a perfect sensor would see from the same place, on the map of the findings, (Z, A): how far the wall stands ``out``
    (m, inwards negative), and of each thing how far it alone does. Where no ray ends (hidden, or moved there by an error), what
    the world says of that place."""

    out: NDArray[np.float32]
    alone: list[NDArray[np.float32]]
    world: NDArray[np.float32]


def truth_of(found: Scene, findings: PairFindings) -> Truth:
    """From the rays of the unrolled wall, cast into the world."""
    followed, at = findings.followed, findings.map
    grid = followed.grid
    hits = found.sewer.cast(found.pose.position, found.pose.rotation, np.stack([grid.u, grid.v], axis=-1).astype(np.float32))
    depth = hits.depth.astype(np.float64)
    theta, radius = followed.wall.about(grid.u, grid.v, depth)
    missed = (hits.material != WALL) & (hits.material != DEPOSIT) | ~followed.ends.inside | ~grid.seen
    camera = np.stack([grid.u * depth, grid.v * depth, depth], axis=-1)
    world = heights(found, at.points, found.sewer.things)

    def on_map(things: tuple[Thing, ...]) -> NDArray[np.float32]:
        out = np.where(missed, np.nan, -heights(found, camera, things)).astype(np.float32)
        points = PointDeviations(
            *(values.astype(np.float32) for values in (depth, radius, out, np.full_like(out, 1e-3), theta))
        )
        return deviation_map(followed, points).deviation

    seen = on_map(found.sewer.things)
    alone = [np.nan_to_num(on_map((thing,))) for thing in found.sewer.things]
    return Truth(np.where(np.isfinite(seen), seen, -world), alone, -world)


def heights(found: Scene, points: NDArray[np.float64], things: tuple[Thing, ...]) -> NDArray[np.float32]:
    """How far ``things`` stand in (m) at points (..., 3) of the camera's frame."""
    relief = Relief(things, found.sewer.radius, pockets=True)
    place = points @ found.pose.rotation.T + found.pose.position
    if not relief:
        return np.zeros(place.shape[:-1], np.float32)
    return relief.height(place[..., 2].astype(np.float32), np.arctan2(place[..., 1], place[..., 0]).astype(np.float32))


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--scenes", type=int, default=100, help="pairs with defects")
    parser.add_argument("--clean", type=int, default=100, help="clean pairs")
    parser.add_argument("--smooth", type=int, default=20, help="clean pairs as smooth as plastic")
    parser.add_argument("--seed", type=int, default=1001, help="the first; 1 to 100 served development")
    options = parser.parse_args()
    if options.scenes < 4:
        parser.error("Correlations need at least 4 pairs with defects.")
    cv2.setNumThreads(1)
    scores: list[NDArray[np.float32]] = []
    labels: list[NDArray[np.bool_]] = []
    volumes: list[tuple[float, float, float, float]] = []
    others: list[tuple[float, float, float, float]] = []
    refused = 0
    seconds = []
    large, deep = Found(), Found()
    for seed in range(options.seed, options.seed + options.scenes):
        one = scene(seed, False)
        try:
            findings, spent = look_at(one)
        except Refused as refusal:
            refused += 1
            print(f"seed {seed}: {refusal.reason}", flush=True)
            continue
        seconds.append(spent)
        at, true = findings.map, truth_of(one, findings)
        usable = at.measured & ~ring_cells(at, findings.joints)
        clear = usable & ((np.abs(true.out) > _POSITIVE_M) | (np.abs(true.out) < _NEGATIVE_M))
        if one.sewer.joints:
            clear &= ~near_joint(one, findings)
        scores.append(np.abs(at.deviation[clear]))
        labels.append(np.abs(true.out[clear]) > _POSITIVE_M)
        outward = mean(at, true.out, usable & np.isfinite(lost_wall(at)))
        volumes.append((findings.inward, mean(at, -true.out, usable), findings.outward, outward))
        others.append((findings.sure[0], findings.plain[1], mean(at, true.out, usable), findings.told))
        for patch, its in zip(one.sewer.things, true.alone, strict=True):
            assert isinstance(patch, Patch)
            its = np.where(its * true.out > 0, its, 0.0)  # a hole that a deposit covers is none that can be seen
            seen = float(np.percentile(np.abs(its[np.abs(its) > 1e-3]), 98)) if (np.abs(its) > 1e-3).any() else 0.0
            core = at.wall & (np.abs(its) > 0.5 * seen) & (seen > 0)
            # counted where the survey says that it looked: what lies beyond the band's ends is not its claim
            if core.sum() < 20 or (core & (at.measured | at.hidden)).sum() < 0.3 * core.sum():
                continue
            hit = any(
                core.ravel()[region.cells].any() and np.sign(region.peak) == -np.sign(patch.height) and not region.expected
                for region in findings.regions
            )
            what = f"seed {seed}: {1000 * patch.height:.0f} mm, seen {1000 * seen:.0f}"
            if seen >= LARGE_M:
                large.count(hit, what)
            if abs(patch.height) >= LARGE_M:
                deep.count(hit, what)
    every, truth = np.concatenate(scores), np.concatenate(labels)
    false, clean_refused = count_false(options.seed, options.clean, lambda seed: scene(seed, True))
    smooth_false, smooth_refused = count_false(options.seed, options.smooth, plastic)
    columns, noisy = np.array(volumes).T, np.array(others).T
    rows = [
        ("point-wise AUROC", f"{auroc(every, truth):.4f}", f"{truth.sum()} of {truth.size} points off the wall"),
        (f"regions found of which {1000 * LARGE_M:.0f} mm or more can be seen", large.share, large.missed),
        (f"regions found that are {1000 * LARGE_M:.0f} mm or more, seen or not", deep.share, deep.missed),
        ("false regions in clean pairs", f"{false} in {options.clean - clean_refused}", f"{clean_refused} refused"),
        ("false regions in smooth pipes", f"{smooth_false} in {options.smooth - smooth_refused}", f"{smooth_refused} refused"),
        ("Pearson, inward score and deposits", f"{pearson(columns[0], columns[1])}", f"{len(volumes)} pairs"),
        (
            "Pearson, outward score and lost wall",
            f"{pearson(columns[2], columns[3])}",
            f"of the wall that tells of losses, {np.nanmean(noisy[3]):.0%}; {refused} refused",
        ),
        ("Pearson, outward score and all wall lost", f"{pearson(columns[2], noisy[2])}", "of all wall that was measured"),
        ("Pearson, inward score beyond the noise", f"{pearson(noisy[0], columns[1])}", ""),
        ("Pearson, outward score with the noise in it", f"{pearson(noisy[1], noisy[2])}", ""),
        ("processor time a pair, s", f"{np.mean(seconds):.2f}", "960 x 600"),
    ]
    print_table("Virtual pairs", ("", "figure", ""), rows)


def mean(at: DeviationMap, heights_m: NDArray[np.float32], cells: NDArray[np.bool_]) -> float:
    """Volume per area of wall (m) of what is above 0 in ``cells``."""
    area = at.area * cells
    return float((area * np.maximum(heights_m, 0)).sum() / max(float(area.sum()), 1e-12))


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
            findings = look_at(make(seed))[0]  # type: ignore[operator]
        except Refused:
            refused += 1
            continue
        wrong = [region for region in findings.regions if not region.expected]
        for region in wrong:
            print(f"false, seed {seed}: {region.kind} {1000 * region.peak:.1f} mm {1e6 * region.area:.0f} mm2", flush=True)
        false += len(wrong)
    return false, refused


def pearson(one: NDArray[np.float64], other: NDArray[np.float64]) -> str:
    """With its 95 % interval, by Fisher's transformation; of the pairs that have both."""
    both = np.isfinite(one) & np.isfinite(other)
    one, other = one[both], other[both]
    if len(one) < 4 or not one.std() or not other.std():
        return "-"
    found = float(np.corrcoef(one, other)[0, 1])
    low, high = np.tanh(np.arctanh(min(found, 1 - 1e-9)) + np.array([-1.96, 1.96]) / np.sqrt(len(one) - 3))
    return f"{found:.3f} ({low:.2f} to {high:.2f})"


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
