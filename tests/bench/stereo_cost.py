"""What a pair of 1920 x 1200 costs (figure 4): processor time and memory, beside the published way in the same run.

Each way runs in a process of its own, so that its peak memory is its own. The published fit draws samples until one finds nine
tenths of its points: on some pairs the first round does, on others three rounds find none, which is most of its time. So the
issue's own three figures for it stand beside, scaled by how fast its matching ran here."""

from __future__ import annotations

import argparse
import multiprocessing
import os
import resource
import time
from pathlib import Path

import cv2

from device.anomaly.result import inspect
from drivers.stereo.replay import pair_folder, read_pair
from estimators.stereo.rig import StereoRig
from tests.bench.real_data import fail
from tests.bench.stereo_reference import reference_pair
from tests.bench.table import print_table

Cost = tuple[float, float, float, float]
"""Processor seconds, seconds on the clock, of a pair; seconds of the reference's matching; peak memory in MB."""
MEASURED_S = 4.9, 1.4, 7.1
"""Matching, reconstruction and fit of the reference, as they were measured beforehand on an idle machine."""


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--pairs", nargs="*", default=["F1 Back", "G2 Front", "R500 Front"])
    options = parser.parse_args()
    root = os.environ.get("BORESCOUT_DATA")
    if not root or not (Path(root) / "stereo_pipes" / "manifest.json").is_file():
        fail("Set BORESCOUT_DATA to the folder of the shared recordings (it holds stereo_pipes).")
    known = {f"{entry.pipe} {entry.end}" for entry in pair_folder(Path(root) / "stereo_pipes").pairs}
    rows = []
    ratios, scaled = [], []
    for pair in options.pairs:
        if pair not in known:
            fail(f"There is no pair {pair}; known are {', '.join(sorted(known))}.")
        ours, theirs = (apart(root, pair, way) for way in ("ours", "reference"))
        ratios.append(theirs[0] / ours[0])
        scaled.append(theirs[2] * sum(MEASURED_S) / MEASURED_S[0] / ours[0])
        for label, cost in (("ours", ours), ("reference", theirs)):
            rows.append((f"{pair}, {label}", f"{cost[0]:.2f}", f"{cost[1]:.2f}", f"{cost[2]:.2f}", f"{cost[3]:.0f}"))
        print(f"{pair}: {ratios[-1]:.1f} times faster; than the scaled sum {scaled[-1]:.1f}", flush=True)
    print_table("One pair of 1920 x 1200", ("", "processor s", "clock s", "matching s", "peak MB"), rows)
    print(f"\nfaster than the reference by (least, most): {min(ratios):.1f}, {max(ratios):.1f}")
    beforehand = " + ".join(f"{part}" for part in MEASURED_S)
    print(f"than {beforehand} s, scaled by its matching time here: {min(scaled):.1f}, {max(scaled):.1f}")


def apart(root: str, pair: str, way: str) -> Cost:
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        cost: Cost = pool.apply(cost_of, (root, pair, way))
    return cost


def cost_of(root: str, pair: str, way: str) -> Cost:
    """Runs in the process of its own. One thread, a first pair to warm up, then the second counts."""
    cv2.setNumThreads(1)
    folder = pair_folder(Path(root) / "stereo_pipes")
    entry = next(entry for entry in folder.pairs if f"{entry.pipe} {entry.end}" == pair)
    frame = read_pair(folder, entry)
    rig = StereoRig(folder.intrinsics, folder.baseline_m, None)
    matching = 0.0
    if way == "ours":
        inspect(frame.left, frame.right, rig)
    begun, clock = time.process_time(), time.perf_counter()
    if way == "ours":
        inspect(frame.left, frame.right, rig)
    else:
        matching = reference_pair(frame.left, frame.right).seconds[0]
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return time.process_time() - begun, time.perf_counter() - clock, matching, peak


if __name__ == "__main__":
    main()
