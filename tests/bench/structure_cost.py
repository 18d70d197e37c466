"""Figure 3, second part: seconds of a scan by step, and of the filter by the number of its features.

    python -m tests.bench.structure_cost               10 scans of the paper's structure, filters of 8 to 256 features
    python -m tests.bench.structure_cost --plot OUT.png

CPU seconds of one thread; beside them the same machine's time for a product of two 500 x 500 matrices, as a yardstick.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from device.structure.database import shipped_knowledge
from device.structure.run import VirtualChamber
from drivers.virtual.chamber.structure import load_structure
from estimators.structure.apart import take_apart
from estimators.structure.recognition import describe, nearest_class
from estimators.structure.slam import StructureFilter
from estimators.structure.types import Segment, Sighting
from estimators.structure.vehicle import SensorMount
from tests.bench.table import print_table

FEATURES = (8, 16, 32, 64, 128, 256)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--scans", type=int, default=10)
    parser.add_argument("--plot", type=Path, help="save the growth with the number of features")
    arguments = parser.parse_args()
    matrix = np.random.default_rng(0).normal(size=(500, 500))
    yardstick = min(_seconds(lambda: matrix @ matrix) for _ in range(5))
    print(f"Yardstick: {1000 * yardstick:.1f} ms for a product of two 500 x 500 matrices")
    scans(arguments.scans)
    grown = [(count, *filter_cost(count)) for count in FEATURES]
    print_table(
        "Filter: one scan with 12 observations, by the number of features in the state",
        ["features", "association and update (ms)", "one prediction and one reading (ms)"],
        [[count, f"{1000 * scan:.1f}", f"{1000 * reading:.2f}"] for count, scan, reading in grown],
    )
    if arguments.plot is not None:
        plot(arguments.plot, grown)


def scans(count: int) -> None:
    """Segmentation and recognition."""
    chamber = VirtualChamber(load_structure(), 1)
    knowledge = shipped_knowledge()
    rng = np.random.default_rng(0)
    apart, recognised, objects, points = [], [], [], []
    for time_s in np.linspace(5.0, chamber.path.duration_s - 5.0, count):
        scan = chamber.scanner.scan(float(time_s), rng)
        points.append(len(scan.points))
        begun = time.process_time()
        parts = take_apart(scan.points, rng)
        between = time.process_time()
        for sighting in parts.sightings:
            found = describe(sighting.cloud)
            if found is not None:
                nearest_class(found, knowledge.views)
        apart.append(between - begun)
        recognised.append(time.process_time() - between)
        objects.append(len(parts.sightings))
    both = np.array(apart) + recognised
    print_table(
        f"A scan ({np.mean(points):.0f} points, {np.mean(objects):.1f} objects), mean of {count}",
        ["segmentation (s)", "recognition (s)", "both (s)", "slowest (s)"],
        [[f"{np.mean(apart):.3f}", f"{np.mean(recognised):.3f}", f"{both.mean():.3f}", f"{both.max():.3f}"]],
    )


def filter_cost(count: int) -> tuple[float, float]:
    """CPU seconds of one scan and of one navigation step with ``count`` features, of which 3 in 8 are lines."""
    rng = np.random.default_rng(1)
    slam = StructureFilter(np.zeros(3), np.zeros(3), SensorMount(np.eye(3), np.zeros(3)))
    lines, points = count * 3 // 8, count - count * 3 // 8
    across = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    segments = [_upright(np.array([1.5 * k, 0.0, 4.0]), across) for k in range(lines)]
    sightings = [
        Sighting(np.array([1.5 * k + 0.7, 0.0, 4.0]), np.eye(3) * 1e-4, np.zeros((0, 3)), np.zeros((0, 3)), "inline")
        for k in range(points)
    ]
    slam.scan(tuple(segments), tuple(sightings))
    assert len(slam.features) == count
    some_lines = [segments[int(k)] for k in rng.choice(lines, min(5, lines), replace=False)]
    some_points = [sightings[int(k)] for k in rng.choice(points, min(7, points), replace=False)]
    scan = min(_seconds(lambda: slam.scan(tuple(some_lines), tuple(some_points))) for _ in range(5))

    def step() -> None:
        slam.predict(0.03, np.zeros(3))
        slam.attitude(slam.vehicle[3:6], 0.005)

    return scan, min(_seconds(step) for _ in range(5))


def _upright(middle: np.ndarray, across: np.ndarray) -> Segment:
    half = np.array([0.0, 0.5, 0.0])
    return Segment(middle - half, middle + half, across, np.diag([1e-6, 1e-6, 4e-6, 4e-6]), np.zeros(1))


def _seconds(work: Callable[[], object]) -> float:
    begun = time.process_time()
    work()
    return time.process_time() - begun


def plot(path: Path, grown: list[tuple[int, float, float]]) -> None:
    """Milliseconds by the number of features."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(6, 4))
    counts, scan, reading = zip(*grown, strict=True)
    axes.loglog(counts, 1000 * np.array(scan), "o-", label="a scan")
    axes.loglog(counts, 1000 * np.array(reading), "s-", label="a reading")
    axes.set(xlabel="features in the state", ylabel="CPU (ms)")
    axes.legend()
    figure.tight_layout()
    figure.savefig(path, dpi=110)


if __name__ == "__main__":
    main()
