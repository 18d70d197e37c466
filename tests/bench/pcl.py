"""PCL's cylinder search behind a pipe: builds tests/bench/pcl_cylinder.cpp into a temporary folder and talks to it."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tests.bench.real_data import fail

_SOURCE = Path(__file__).with_name("pcl_cylinder.cpp")
_PACKAGES = ("pcl_segmentation", "pcl_features", "pcl_search", "pcl_sample_consensus", "pcl_common")


@dataclass(frozen=True)
class PclSearch:
    """One search: ``d_max`` m, PCL's normal weight, seconds of the search alone, iterations the library counted.

    Radii in m, None where nothing was found: ``radius`` is the winner of the search, ``refined_radius`` the same after PCL's
    optimisation over the inliers.
    """

    d_max: float
    normal_weight: float
    seconds: float
    iterations: int
    radius: float | None
    refined_radius: float | None


class PclCylinder:
    """A running PCL process; ``version`` is the library's. Ends the program with one sentence where it cannot be built."""

    def __init__(self, normal_weights: Sequence[float]) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="borescout-pcl-")
        program = build(Path(self._folder.name), _SOURCE, _PACKAGES)
        self._points = Path(self._folder.name) / "cloud.f32"
        self._process = subprocess.Popen(
            [program, *map(str, normal_weights)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env={**os.environ, "OMP_NUM_THREADS": "1"},
        )
        self.version = str(self._answer()["pcl"])

    def search(self, cloud: NDArray[np.float32]) -> tuple[float, list[PclSearch]]:
        """Seconds for the normals of ``cloud`` (N, 3), and one search for each normal weight and d_max."""
        np.ascontiguousarray(cloud, dtype=np.float32).tofile(self._points)
        assert self._process.stdin is not None
        self._process.stdin.write(f"{self._points} {len(cloud)}\n")
        self._process.stdin.flush()
        answer = self._answer()
        searches = [
            PclSearch(
                d_max=s["d_max"],
                normal_weight=s["normal_weight"],
                seconds=s["search_ms"] / 1000,
                iterations=s["iterations"],
                radius=s.get("radius"),
                refined_radius=s.get("refined_radius"),
            )
            for s in answer["searches"]
        ]
        return answer["normals_ms"] / 1000, searches

    def _answer(self) -> dict[str, Any]:
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        if not line:
            fail(f"The PCL program ended with status {self._process.wait()}.")
        answer: dict[str, Any] = json.loads(line)
        if "error" in answer:
            fail(f"The PCL program says: {answer['error']}.")
        return answer

    def __enter__(self) -> PclCylinder:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._process.kill()
        self._process.wait()
        self._folder.cleanup()


def build(folder: Path, source: Path, packages: Sequence[str], more: Sequence[str] = ()) -> Path:
    """Compile ``source`` against PCL's ``packages`` into ``folder``, with ``more`` flags before PCL's own. Ends the program
    with one sentence where it cannot be."""
    for tool in ("g++", "pkg-config"):
        if shutil.which(tool) is None:
            fail(f"The PCL benchmark needs {tool}: apt-get install g++ pkg-config libpcl-dev")
    flags = subprocess.run(["pkg-config", "--cflags", "--libs", *packages], capture_output=True, text=True)
    if flags.returncode != 0:
        fail("PCL is not installed: apt-get install libpcl-dev")
    program = folder / source.stem
    command = ["g++", "-std=c++17", "-O3", "-DNDEBUG", *more, str(source), "-o", str(program), *flags.stdout.split()]
    compiled = subprocess.run(command, capture_output=True, text=True)
    if compiled.returncode != 0:
        fail(f"The PCL program did not compile: {compiled.stderr.strip().splitlines()[-1]}")
    return program
