"""A whole virtual drive, there and back, as ``borescout map --virtual`` maps it, against its truth.

python -m tests.bench.virtual_map [--seed 1]

Printed are each true landmark and what the mapper made of it while it drove, what the second look at all pictures made of it
(``refine``), and where smoothing put it; then the joints. All 4000 pictures are rendered: it takes some minutes.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence

import numpy as np

from device.landmarks.pipeline import LandmarkPipeline
from device.landmarks.virtual_crawler import VirtualRun
from drivers.virtual.drive import demo_drive
from drivers.virtual.landmarks import LandmarkTruth
from estimators.landmarks.ekf import wrap
from estimators.landmarks.types import Landmark
from tests.bench.table import print_table

NEAR_M = 1.0
"""A landmark of the same class whose middle is no further off is that of the truth."""


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--seconds", type=float, default=float("inf"), help="so much of the drive")
    arguments = parser.parse_args()
    seed = arguments.seed
    run, truth = VirtualRun(seed), demo_drive(seed).truth
    pipeline, way = LandmarkPipeline(run.setup(), run.detector()), run.way()
    started = time.perf_counter()
    for frame in run.frames():
        if frame.time_s > arguments.seconds:
            break
        pipeline.step(frame, way.at(frame.time_s))
    driven = time.perf_counter()
    live = pipeline.landmarks()
    pipeline.finish()
    looked = time.perf_counter()
    refined, joints = pipeline.landmarks(), pipeline.joints()
    smoothed = pipeline.smooth()
    maps = {"mapper": live, "refined": refined}
    if smoothed is not None:
        maps["smoothed"] = list(smoothed.landmarks)
    rows = [
        (f"{one.label} {one.chainage:.2f}", *(cell for found in maps.values() for cell in _cells(one, found, truth.landmarks)))
        for one in truth.landmarks
    ]
    header = ("truth", *(name for stage in maps for name in (stage, "from, to m", "degrees")))
    print_table(f"Landmarks of virtual drive {seed}: errors", header, rows)
    for stage, found in maps.items():
        owned = _owners(truth.landmarks, found)
        print(f"{stage}: {len(owned)} of {len(truth.landmarks)} found, {len(found) - len(owned)} too many")
    _joints("joints", [joint["chainage_m"] for joint in joints], truth.joints)
    if smoothed is not None and smoothed.joints:
        _joints("joints, smoothed", [joint["chainage_m"] for joint in smoothed.joints], truth.joints)
        scale = smoothed.summary["scale"]
        print(f"scale of the tether {scale['value']:.4f} +- {scale['sigma']:.4f} (truth 1)")
    print(f"{pipeline.frames} pictures in {driven - started:.0f} s with drawing, second look {looked - driven:.1f} s")


def _owners(truths: Sequence[LandmarkTruth], found: Sequence[Landmark]) -> dict[int, Landmark]:
    """The landmark of each truth (by its id), nearest pairs first."""
    pairs = sorted(
        (abs(_middle(mark) - truth.centre[0]), truth.id, k)
        for truth in truths
        for k, mark in enumerate(found)
        if mark.label == truth.label
    )
    owners: dict[int, Landmark] = {}
    taken: set[int] = set()
    for off, truth, k in pairs:
        if off < NEAR_M and truth not in owners and k not in taken:
            owners[truth] = found[k]
            taken.add(k)
    return owners


def _cells(truth: LandmarkTruth, found: Sequence[Landmark], truths: Sequence[LandmarkTruth]) -> tuple[str, str, str]:
    mark = _owners(truths, found).get(truth.id)
    if mark is None:
        return "missed", "", ""
    ends = f"{mark.chainage_from - truth.chainage:+.2f}, {mark.chainage_to - truth.chainage_to:+.2f}"
    around = np.degrees(wrap(np.array([0.5 * (mark.angle_from + mark.angle_to) - truth.centre[1]])))[0]
    sigma = float(np.sqrt(mark.covariance[0, 0]))
    return f"{_middle(mark) - truth.centre[0]:+.2f} +- {sigma:.2f}", ends, f"{around:+.0f}"


def _middle(mark: Landmark) -> float:
    return 0.5 * (mark.chainage_from + mark.chainage_to)


def _joints(name: str, found: Sequence[float], truth: Sequence[float]) -> None:
    places = np.array(truth)
    if not found:
        print(f"{name}: none")
        return
    off = np.array([value - places[np.abs(places - value).argmin()] for value in found])
    good = off[np.abs(off) < 0.5]
    print(f"{name}: {len(good)} of {len(places)}, {len(off) - len(good)} false; mean error {good.mean():+.3f} m", end=", ")
    print(f"mean |error| {np.abs(good).mean():.3f} m")


if __name__ == "__main__":
    main()
