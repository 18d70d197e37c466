"""Our estimate beside PCL and pyransac3d on the real frames: time as ratios in one run, and error.

    python -m tests.bench.peers                  all frames with a visible wall
    python -m tests.bench.peers --frames 6       six frames, spread over all of them
    python -m tests.bench.peers --points 0       peers get the whole crop (minutes a frame)

All three are given the same crop. The peers get at most ``--points`` points of it, drawn at random, since their time grows
with the cloud: on the whole crop they would need minutes a frame, so thinning flatters them. PCL searches with the normal
weight 0 of the paper, whose inliers are judged by distance alone, and with its own default of 0.1.
One thread for all; the three take turns frame by frame.
"""

from __future__ import annotations

import argparse
import random
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, version

import cv2
import numpy as np
from numpy.typing import NDArray

from estimators.frame import estimate_frame
from estimators.pointcloud import MAX_LATERAL_M, MAX_RANGE_M, MIN_RANGE_M
from tests.bench.pcl import PclCylinder
from tests.bench.real_data import TOLERANCE_M, RealFrame, cropped_cloud, distance_outside, fail, real_frames
from tests.bench.table import mm, percent, print_table

PEER_POINTS = 5_000
PCL_ITERATIONS = 10_000
PCL_NORMAL_WEIGHTS = (0.0, 0.1)
PYRANSAC_THRESHOLD_M = 0.010
PYRANSAC_ITERATIONS = 1000
ERROR_CAP_M = 0.1
OUR_REPEATS = 3
"""Ours takes milliseconds, so one hiccup of the machine would count: the median of three."""


@dataclass
class Row:
    """What one method did on every frame: seconds of the search alone and with normals, distance to the truth in m."""

    search_s: list[float] = field(default_factory=list)
    whole_s: list[float] = field(default_factory=list)
    error_m: list[float] = field(default_factory=list)

    def add(self, search_s: float, whole_s: float, error_m: float) -> None:
        self.search_s.append(search_s)
        self.whole_s.append(whole_s)
        self.error_m.append(error_m)

    def mean_capped_error(self) -> float:
        """Mean distance to the truth in m, none counted above ERROR_CAP_M: one lost frame must not decide the figure."""
        return float(np.mean(np.minimum(self.error_m, ERROR_CAP_M)))

    def share_right(self) -> float:
        return float(np.mean(np.asarray(self.error_m) <= TOLERANCE_M))


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--frames", type=int, metavar="N", help="only N frames, evenly spread")
    parser.add_argument(
        "--points", type=int, metavar="N", default=PEER_POINTS, help="largest cloud the peers get, 0: the whole crop"
    )
    arguments = parser.parse_args()
    try:
        pyransac_version = version("pyransac3d")
    except PackageNotFoundError:
        fail("pyransac3d is not installed: pip install pyransac3d (dependency group 'bench').")
    frames = [frame for frame in real_frames() if frame.wall_visible]
    if arguments.frames:
        frames = [frames[k] for k in np.unique(np.linspace(0, len(frames) - 1, arguments.frames).astype(int))]
    cv2.setNumThreads(1)
    with PclCylinder(PCL_NORMAL_WEIGHTS) as pcl:
        print(f"PCL {pcl.version}, pyransac3d {pyransac_version}, numpy {np.__version__}, OpenCV {cv2.__version__}; one thread")
        rows, sizes = _run(frames, pcl, arguments.points)
    _report(rows, sizes, arguments.points)


def _run(frames: list[RealFrame], pcl: PclCylinder, limit: int) -> tuple[dict[str, Row], list[int]]:
    rows: dict[str, Row] = {}
    sizes = []
    for number, frame in enumerate(frames):
        cloud = _peer_cloud(frame, limit, number)
        sizes.append(len(cloud))
        ours_s, diameter = _ours(frame)
        rows.setdefault("borescout", Row()).add(ours_s, ours_s, distance_outside(diameter, frame.truth_m))
        normals_s, searches = pcl.search(cloud)
        for s in searches:
            for name, radius in (("", s.radius), (", refined", s.refined_radius)):
                error = distance_outside(None if radius is None else 2 * radius, frame.truth_m)
                rows.setdefault(f"PCL {mm(s.d_max, 0)} mm, weight {s.normal_weight:g}{name}", Row()).add(
                    s.seconds, normals_s + s.seconds, error
                )
            if s.iterations < PCL_ITERATIONS and s.radius is not None:
                fail(f"PCL stopped after {s.iterations} iterations on {frame.name}; the figures would flatter it.")
        seconds, diameter = _timed(lambda cloud=cloud, seed=number: _pyransac(cloud, seed))  # type: ignore[misc]  # mypy: lambda defaults
        rows.setdefault("pyransac3d", Row()).add(seconds, seconds, distance_outside(diameter, frame.truth_m))
        print(f"\r{number + 1}/{len(frames)} frames", end="", flush=True)
    print()
    return rows, sizes


def _peer_cloud(frame: RealFrame, limit: int, seed: int) -> NDArray[np.float32]:
    """The crop that our estimator makes for itself, thinned at random to ``limit`` points (0: not thinned)."""
    cloud = cropped_cloud(frame.depth, frame.intrinsics, frame.depth_unit_m, MIN_RANGE_M, MAX_RANGE_M, MAX_LATERAL_M)
    if limit and len(cloud) > limit:
        cloud = cloud[np.random.default_rng(seed).choice(len(cloud), size=limit, replace=False)]
    return cloud


def _ours(frame: RealFrame) -> tuple[float, float | None]:
    """Median seconds from the depth array to the estimate, and the diameter in m."""
    times = []
    for _ in range(OUR_REPEATS):
        seconds, diameter = _timed(lambda: estimate_frame(frame.depth, frame.intrinsics, frame.depth_unit_m).diameter)
        times.append(seconds)
    return float(np.median(times)), diameter


def _pyransac(cloud: NDArray[np.float32], seed: int) -> float | None:
    import pyransac3d

    random.seed(seed)  # the library draws from the module's generator
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # it divides by zero on equal coordinates and goes on
        found = pyransac3d.Cylinder().fit(
            cloud.astype(np.float64), thresh=PYRANSAC_THRESHOLD_M, maxIteration=PYRANSAC_ITERATIONS
        )
    return 2 * float(found[2]) if len(found[3]) else None


def _timed(work: Callable[[], float | None]) -> tuple[float, float | None]:
    started = time.perf_counter()
    result = work()
    return time.perf_counter() - started, result


def _report(rows: dict[str, Row], sizes: list[int], limit: int) -> None:
    ours = rows["borescout"]
    lines = []
    for name, row in rows.items():
        ratio = np.asarray(row.search_s) / np.asarray(ours.whole_s)
        whole = np.asarray(row.whole_s) / np.asarray(ours.whole_s)
        lines.append(
            (
                name,
                f"{np.median(row.search_s):.3f}",
                f"{np.median(row.whole_s):.3f}",
                f"{np.median(ratio):.0f}",
                f"{ratio.min():.0f}",
                f"{np.median(whole):.0f}",
                percent(row.share_right(), 1),
                mm(float(np.median(row.error_m))),
                mm(row.mean_capped_error()),
            )
        )
    crop = "whole crop" if not limit else f"crop thinned to at most {limit} points"
    title = (
        f"{len(sizes)} real frames, peers on the {crop} (median {np.median(sizes):.0f})\n"
        f"PCL: {PCL_ITERATIONS} iterations, 50 neighbours; "
        f"pyransac3d: {PYRANSAC_ITERATIONS} iterations, threshold {mm(PYRANSAC_THRESHOLD_M, 0)} mm\n"
        f"ours is whole in every column: depth array to estimate; mean error: none counted above {mm(ERROR_CAP_M, 0)} mm"
    )
    header = (
        "method",
        "search s",
        "+ normals s",
        "x ours",
        "least x",
        "x ours + normals",
        "within 20 mm",
        "median error mm",
        "mean error mm",
    )
    print_table(title, header, lines)
    peers = {name: row for name, row in rows.items() if name != "borescout"}
    for family in ("PCL", "pyransac3d"):
        name, best = min(
            ((n, r) for n, r in peers.items() if n.startswith(family)),
            key=lambda pair: pair[1].mean_capped_error(),
        )
        fastest = min(
            float(np.median(np.asarray(r.search_s) / np.asarray(ours.whole_s)))
            for n, r in peers.items()
            if n.startswith(family)
        )
        print(
            f"{family}: its smallest error is that of '{name}' ({percent(best.share_right(), 1)} within 20 mm, "
            f"ours {percent(ours.share_right(), 1)}); its fastest search takes {fastest:.0f} times ours"
        )


if __name__ == "__main__":
    main()
