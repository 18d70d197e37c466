"""Figure 3, first part: our CVFH against PCL's, on objects as scans show them.

    python -m tests.bench.structure_cvfh            50 clouds with noise; needs g++, pkg-config and libpcl-dev
    python -m tests.bench.structure_cvfh --clouds 10
    python -m tests.bench.structure_cvfh --programs PATH PATH    as shipped and in order, where they are compiled already

Both are given the same points and make their own normals. PCL is compared with twice: as it is shipped, and with one word of
its header changed. When PCL grows smooth parts it passes over the first neighbour of each point, which its comment takes for
the point itself; but it asks for neighbours in no order (``KdTree (false)``), so it passes over any of them, and where two
patches are joined by few pairs of points it may part them. With neighbours in order (``true``) it does what its comment says,
and so do we.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from device.structure.database import looked_at, states
from estimators.structure.cloud import surface_of, thinned
from estimators.structure.cvfh import cvfh
from estimators.structure.recognition import DescriptorSettings
from estimators.structure.types import CLASSES
from tests.bench.pcl import build
from tests.bench.real_data import fail
from tests.bench.table import print_table

Array = NDArray[np.float64]

_SOURCE = Path(__file__).with_name("pcl_cvfh.cpp")
_PACKAGES = ("pcl_features", "pcl_search", "pcl_kdtree", "pcl_common")
_HEADER = Path("pcl/features/impl/cvfh.hpp")
NOISES_M = (0.0, 0.002, 0.005)
HEADER = ["noise (mm)", "histograms", "min", "1st percentile", "median", "at least 0.98", "same parts", "ours (ms)", "PCL (ms)"]


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--clouds", type=int, default=50)
    parser.add_argument("--programs", type=Path, nargs=2, help="the compiled oracles: as shipped, in order")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="borescout-pcl-") as name:
        folder = Path(name)
        programs = arguments.programs or (build(folder, _SOURCE, _PACKAGES), in_order(folder / "in order"))
        for program, title in zip(programs, ("as shipped", "its neighbours in order"), strict=True):
            oracle = subprocess.Popen([program], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
            version = _answer(oracle)["pcl"]
            rows = [compare(oracle, folder / "cloud.f32", arguments.clouds, noise) for noise in NOISES_M]
            oracle.kill()
            oracle.wait()
            print_table(f"CVFH against PCL {version}, {title}, on {arguments.clouds} clouds", HEADER, rows)


def in_order(folder: Path) -> Path:
    """The oracle compiled with PCL's header as its comment means it: neighbours nearest first."""
    flags = subprocess.run(["pkg-config", "--cflags-only-I", *_PACKAGES], capture_output=True, text=True).stdout.split()
    headers = [Path(flag[2:]) / _HEADER for flag in flags if (Path(flag[2:]) / _HEADER).exists()]
    if not headers:
        fail(f"PCL's {_HEADER} is not where pkg-config says.")
    text = headers[0].read_text(encoding="utf-8")
    changed = text.replace("KdTree<pcl::PointNormal> (false)", "KdTree<pcl::PointNormal> (true)")
    if changed == text:
        fail(f"{headers[0]} asks for its neighbours in another way than that of PCL 1.13.")
    (folder / _HEADER).parent.mkdir(parents=True)
    (folder / _HEADER).write_text(changed, encoding="utf-8")
    return build(folder, _SOURCE, _PACKAGES, (f"-I{folder}", "-DPCL_NO_PRECOMPILE"))


def compare(oracle: subprocess.Popen[str], path: Path, count: int, noise: float) -> list[object]:
    """One line of the table: correlations of the histograms of ``count`` clouds with range noise (m)."""
    rng = np.random.default_rng(3)
    settings = DescriptorSettings()
    correlations: list[float] = []
    same_parts, seconds, theirs = 0, 0.0, 0.0
    for number in range(count):
        label = CLASSES[number % len(CLASSES)]
        direction = rng.normal(size=3)
        cloud = looked_at(label, states(label)[number % len(states(label))], direction / np.linalg.norm(direction))
        cloud = cloud * (1 + rng.normal(0, noise, (len(cloud), 1)) / np.linalg.norm(cloud, axis=1, keepdims=True))
        points = thinned(cloud, settings.cell).astype(np.float32)
        told = ask(oracle, points, path, settings)
        begun = time.process_time()
        mine = cvfh(surface_of(points.astype(float), settings.neighbours), settings.cvfh)
        seconds += time.process_time() - begun
        theirs += told["normals"] + told["cvfh"]
        other = np.array(told["histograms"])
        same_parts += len(mine) == len(other)
        table = np.corrcoef(np.vstack([mine, other]))[: len(mine), len(mine) :]
        correlations += list(table.max(axis=1 if len(mine) <= len(other) else 0))
    values = np.array(correlations)
    return [
        f"{1000 * noise:.0f}",
        len(values),
        f"{values.min():.4f}",
        f"{np.percentile(values, 1):.4f}",
        f"{np.median(values):.4f}",
        f"{(values >= 0.98).mean():.1%}",
        f"{same_parts} of {count}",
        f"{1000 * seconds / count:.1f}",
        f"{1000 * theirs / count:.1f}",
    ]


def ask(oracle: subprocess.Popen[str], points: NDArray[np.float32], path: Path, settings: DescriptorSettings) -> dict[str, Any]:
    """PCL's histograms of ``points`` (N, 3)."""
    points.tofile(path)
    s = settings.cvfh
    assert oracle.stdin is not None
    oracle.stdin.write(
        f"{path} {len(points)} {settings.neighbours} {s.curvature} {s.reach} {s.angle} {s.least_points} {s.normal_radius}\n"
    )
    oracle.stdin.flush()
    return _answer(oracle)


def _answer(oracle: subprocess.Popen[str]) -> dict[str, Any]:
    assert oracle.stdout is not None
    line = oracle.stdout.readline()
    if not line:
        fail(f"The PCL program ended with status {oracle.wait()}.")
    answer: dict[str, Any] = json.loads(line)
    if "error" in answer:
        fail(f"The PCL program says: {answer['error']}.")
    return answer


if __name__ == "__main__":
    main()
