"""Joints in virtual stereo pairs whose truth is known: how many are found, and how wide their gap and how far the next pipe is
displaced come out."""

from __future__ import annotations

import argparse
from typing import NamedTuple

import cv2
import numpy as np

from drivers.virtual.landmarks import DisplacedJoint
from drivers.virtual.profile import circular
from drivers.virtual.rig import Pose
from drivers.virtual.stereo_camera import StereoLens, StereoLook, StereoPainter
from drivers.virtual.world import Joint, VirtualSewer
from estimators.anomaly.pair import inspect_pair
from estimators.stereo.follow import Refused
from estimators.stereo.rig import StereoRig
from tests.bench.table import print_table

LENS = StereoLens()
START = 2.0
SEAL = 0.35
"""How bright the inside of a joint is against the wall."""


class Row(NamedTuple):
    """One joint: true gap, its depth, and displacement of the pipe behind (mm); what became of it; gap and displacement found
    (mm), by how much the direction is wrong (degrees), and the sigmas (mm) of both."""

    seed: int
    gap: float
    deep: float
    step: float
    what: str
    found_gap: float
    offset: float
    turned: float
    gap_std: float
    offset_std: float


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--pairs", type=int, default=40)
    parser.add_argument("--first", type=int, default=0, help="seed of the first one")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    rows = []
    for seed in range(options.first, options.first + options.pairs):
        rows.append(look_at(seed))
        print(*(f"{value:8.1f}" if isinstance(value, float) else value for value in rows[-1]), flush=True)
    report(rows)


def look_at(seed: int) -> Row:
    """See Row."""
    rng = np.random.default_rng([seed, 17])
    radius = float(rng.uniform(0.125, 0.25))
    at = START + float(rng.uniform(2.8, 4.5)) * radius
    gap = float(rng.uniform(0.006, 0.04))
    deep = float(rng.uniform(0.006, 0.015))
    angle = float(rng.uniform(-np.pi, np.pi))
    step = float(rng.uniform(0.005, 0.12 * radius)) if rng.random() < 0.6 else 0.0
    things = (DisplacedJoint(at + gap / 2, angle, step),) if step else ()
    sewer = VirtualSewer(circular(2 * radius), START + 8 * radius, joints=(Joint(at, gap, deep),), things=things)
    right, down = rng.uniform(-0.1, 0.1, 2) * radius
    pose = Pose(float(right), float(down), START, *map(float, rng.uniform(-0.03, 0.03, 2)))
    look = StereoLook(grain=float(rng.uniform(0.1, 0.3)), noise=float(rng.uniform(1.0, 2.5)), gap=SEAL)
    left, other = StereoPainter(sewer, LENS, look, seed).pair(pose, np.random.default_rng([seed, 3]))
    nan = float("nan")
    truth = seed, 1000 * gap, 1000 * deep, 1000 * step
    try:
        found = inspect_pair(
            left, other, StereoRig(LENS.intrinsics, LENS.baseline_m, LENS.offset_px), np.random.default_rng(seed)
        )
    except Refused:
        return Row(*truth, "refused", *[nan] * 5)
    if not found.map.depth[0] + 0.1 < at - START < found.map.depth[-1] - 0.1:
        return Row(*truth, "one side", *[nan] * 5)
    near = [joint for joint in found.joints if abs(joint.depth + START - at) < 0.04]
    extra = len(found.joints) - len(near)
    if not near:
        return Row(*truth, "missed", *[nan] * 5)
    joint = near[0]
    what = "found" if not extra else f"found +{extra}"
    if joint.offset is None or joint.offset_theta is None:
        return Row(*truth, what, 1000 * joint.gap, nan, nan, 1000 * joint.gap_std, nan)
    # the wall stands in at the angle: the pipe is displaced to the other side
    turned = float(np.degrees(np.angle(np.exp(1j * (joint.offset_theta - angle - np.pi))))) if step else nan
    found_mm = 1000 * joint.gap, 1000 * joint.offset, turned
    return Row(*truth, what, *found_mm, 1000 * joint.gap_std, 1000 * joint.offset_std)


def report(rows: list[Row]) -> None:
    seen = [row for row in rows if row.what not in ("refused", "one side")]
    displaced, straight = ([row for row in seen if (row.step > 0) == wanted] for wanted in (True, False))
    told = [row for row in displaced if np.isfinite(row.offset)]
    off = np.array([row.offset - row.step for row in told])
    gapped = [row for row in seen if np.isfinite(row.found_gap)]
    gaps = np.array([row.found_gap - row.gap for row in gapped])
    print_table(
        "Joints in virtual stereo pairs",
        ["", "value"],
        [
            [
                "pairs, refused, joint not seen from both sides",
                f"{len(rows)}, {_count(rows, 'refused')}, {_count(rows, 'one side')}",
            ],
            ["displaced joints told", f"{len(told)} of {len(displaced)}"],
            ["displacement: rms and worst error, mm", f"{_rms(off):.1f}, {np.abs(off).max(initial=0):.1f}"],
            ["its direction: worst error, degrees", f"{max((abs(row.turned) for row in told), default=float('nan')):.0f}"],
            [
                "straight joints told as displaced by 3 mm or more",
                f"{sum(row.offset >= 3 for row in straight)} of {len(straight)}",
            ],
            ["straight joints found", f"{sum(row.what.startswith('found') for row in straight)} of {len(straight)}"],
            ["rings where there is no joint", f"{sum(row.what.count('+') for row in seen)} pairs"],
            ["gaps told: rms and worst error, mm", f"{len(gaps)}, {_rms(gaps):.1f}, {np.abs(gaps).max(initial=0):.1f}"],
            ["error over sigma, rms: gaps", f"{_rms(gaps / np.array([row.gap_std for row in gapped])):.1f}"],
            ["error over sigma, rms: displacements", f"{_rms(off / np.array([row.offset_std for row in told])):.1f}"],
        ],
    )


def _count(rows: list[Row], what: str) -> int:
    return sum(row.what == what for row in rows)


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else float("nan")


if __name__ == "__main__":
    main()
