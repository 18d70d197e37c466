"""The real depth frames of ``$BORESCOUT_DATA/realsense_pipes`` with what a tape measure said of them.

Only benchmarks read the truth; every estimator is handed depth, intrinsics and unit alone.
"""

from __future__ import annotations

import json
import os
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

import cv2
import numpy as np
from numpy.typing import NDArray

from estimators.pinhole import Intrinsics, rays

TOLERANCE_M = 0.020
"""The paper's allowed error (section 4.4)."""

WIDENED_TRUTH_M = {"180mm": (0.160, 0.200), "340mm": (0.320, 0.360)}
"""Pipes whose label is known only roughly: nobody measured their inside, so an error counts outside these bounds."""


@dataclass(frozen=True)
class RealFrame:
    """One depth frame: ``name`` is the manifest's path, ``truth_m`` the interval of the interior diameter."""

    name: str
    pipe: str
    depth: NDArray[np.uint16]
    intrinsics: Intrinsics
    depth_unit_m: float
    truth_m: tuple[float, float]
    wall_visible: bool
    emitter: bool


def fail(sentence: str) -> NoReturn:
    """End a benchmark with one sentence and exit status 2."""
    print(sentence, file=sys.stderr)
    raise SystemExit(2)


def data_folder() -> Path:
    """Folder of the real depth frames; ends the program with one sentence where there is none."""
    root = os.environ.get("BORESCOUT_DATA")
    if not root:
        fail("Set BORESCOUT_DATA to the folder of the shared recordings (it holds realsense_pipes).")
    folder = Path(root) / "realsense_pipes"
    if not (folder / "manifest.json").is_file():
        fail(f"There is no manifest.json in {folder}, so there are no real frames to measure.")
    return folder


def real_frames(folder: Path | None = None) -> list[RealFrame]:
    """Every frame of the manifest, in its order."""
    folder = folder or data_folder()
    return [_read(folder, entry) for entry in json.loads((folder / "manifest.json").read_text())]


def truth_interval(entry: dict[str, Any]) -> tuple[float, float]:
    """Interior diameter interval in metres of one manifest entry."""
    pipe = str(entry["pipe"])
    if pipe in WIDENED_TRUTH_M:
        return WIDENED_TRUTH_M[pipe]
    low, high = entry["interior_diameter_mm"]
    return float(low) / 1000, float(high) / 1000


def distance_outside(diameter_m: float | None, truth_m: tuple[float, float]) -> float:
    """How far a diameter lies outside the truth interval, in metres; infinite where there is no diameter."""
    if diameter_m is None or not np.isfinite(diameter_m):
        return float("inf")
    return max(truth_m[0] - diameter_m, diameter_m - truth_m[1], 0.0)


def cropped_cloud(
    depth: NDArray[np.uint16],
    intrinsics: Intrinsics,
    depth_unit_m: float,
    z_min: float = 0.0,
    z_max: float = 2.5,
    lateral: float = 1.0,
) -> NDArray[np.float32]:
    """Points (N, 3) in metres with |X|, |Y| <= ``lateral`` and ``z_min`` < Z <= ``z_max``.

    The defaults are the paper's eqs. 3 to 5 and step 1 of its Algorithm 1.
    """
    z = depth.astype(np.float32) * np.float32(depth_unit_m)
    xy = rays(intrinsics) * z[..., None]
    keep = (z > z_min) & (z <= z_max) & (np.abs(xy) <= lateral).all(axis=2)
    return np.concatenate([xy[keep], z[keep][:, None]], axis=1)


def _read(folder: Path, entry: dict[str, Any]) -> RealFrame:
    path = folder / str(entry["depth"])
    depth = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    if depth is None or depth.dtype != np.uint16:
        fail(f"{path} is not a 16-bit depth picture.")
    fields = entry["intrinsics"]
    intrinsics = Intrinsics(**{**fields, "coeffs": tuple(fields["coeffs"])})
    return RealFrame(
        name=str(entry["depth"]),
        pipe=str(entry["pipe"]),
        depth=np.asarray(depth, dtype=np.uint16),
        intrinsics=intrinsics,
        depth_unit_m=float(entry["depth_unit_m"]),
        truth_m=truth_interval(entry),
        wall_visible=bool(entry["wall_visible"]),
        emitter=bool(entry["emitter"]),
    )
