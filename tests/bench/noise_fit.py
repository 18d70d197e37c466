"""The stereo noise of real frames beside that of virtual ones of the same pipes, from the same statistics.

python -m tests.bench.noise_fit        the real frames of $BORESCOUT_DATA with a pipe in view, and a virtual twin of each

Every real frame is given a cylinder by the estimator; what is measured is how the depth strays from it, where it is missing,
and what lies elsewhere. The twin is a virtual pipe of that radius, seen from that pose through the same lens. How well a wall
is lit is the recording's, so the twin's ``light`` is set until as much of its wall has a depth; everything else is the same in
all twins: the defaults of ``drivers.virtual.noise``, which are set so that the columns agree. Disparities are in pixels at 848
pixels of width.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.virtual.noise import BASELINE_M, Matching, StereoCamera, StereoNoise, Window, coarse_rays
from drivers.virtual.profile import circular
from drivers.virtual.world import VirtualSewer
from estimators.frame import estimate_frame
from estimators.pinhole import Intrinsics, rays
from tests.bench.real_data import RealFrame, distance_outside, real_frames
from tests.bench.table import print_table

RANGES_M = ((0.17, 0.25), (0.25, 0.35), (0.35, 0.5), (0.5, 0.75), (0.75, 1.1), (1.1, 1.6))
COSINES = ((0.0, 0.15), (0.15, 0.3), (0.3, 0.5), (0.5, 0.7), (0.7, 1.0))
SLANTS = ((0.0, 0.1), (0.1, 0.2), (0.2, 0.3), (0.3, 0.4), (0.4, 0.6))
BLOCK = 15
"""Pixels: what is common to such a neighbourhood is the coarse part of the noise, the rest the fine one."""
ON_WALL_PX = 2.5
"""Disparity further than this from the wall's is no noisy measurement of the wall but a false one."""
ROUND_PIPES = ("195mm_concrete", "200mm_PVC", "340mm", "400mm_PVC")
_LEAST = 2000
_FAR_M = 6.0


@dataclass(frozen=True)
class Pipe:
    """What was fitted to a frame: a cylinder about the line through ``point`` along ``axis`` in the camera's frame, closed at
    ``end`` (m) along the axis."""

    axis: NDArray[np.float64]
    point: NDArray[np.float64]
    radius: float
    end: float


@dataclass(frozen=True)
class Sample:
    """Per pixel (H, W): ``wall`` depth that the pipe predicts, the ``cosine`` of incidence, ``slant`` the change of its
    disparity along the row, ``off`` the disparity in excess (NaN where nothing was measured), and ``looked`` where the wall is
    what both eyes see."""

    wall: NDArray[np.float64]
    cosine: NDArray[np.float64]
    slant: NDArray[np.float64]
    off: NDArray[np.float64]
    looked: NDArray[np.bool_]


def pipe_of(frame: RealFrame) -> Pipe | None:
    """The pipe in a frame, or None where the estimator did not find the one that is there."""
    estimate = estimate_frame(frame.depth, frame.intrinsics, frame.depth_unit_m)
    if estimate.fit is None or distance_outside(estimate.diameter, frame.truth_m) > 0.005:
        return None
    axis = np.asarray(estimate.fit.axis, np.float64)
    axis = axis if axis[2] > 0 else -axis
    point = np.asarray(estimate.fit.point, np.float64)
    point = point - (point @ axis) * axis
    return Pipe(axis, point, float(estimate.fit.radius), _end(frame, axis, point, float(estimate.fit.radius)))


def _end(frame: RealFrame, axis: NDArray[np.float64], point: NDArray[np.float64], radius: float) -> float:
    """Where along the axis most of what lies well inside the pipe is: the wall that closes it."""
    depth = frame.depth * frame.depth_unit_m
    points = np.dstack([rays(frame.intrinsics).astype(np.float64), np.ones(depth.shape)])[depth > 0] * depth[depth > 0][:, None]
    along = points @ axis
    aside = np.linalg.norm(points - along[:, None] * axis - point, axis=1)
    inside = along[(aside < 0.8 * radius) & (along < _FAR_M)]
    counts, edges = np.histogram(inside, np.arange(0.2, _FAR_M, 0.1))
    return float(edges[counts.argmax()] + 0.05) if counts.max(initial=0) > _LEAST else _FAR_M


def twin(pipe: Pipe, lens: Intrinsics, noise: StereoNoise, seed: int) -> NDArray[np.uint16]:
    """The depth picture (H, W) of a virtual pipe like ``pipe``."""
    across = np.cross([0.0, 1.0, 0.0], pipe.axis)
    across /= np.linalg.norm(across)
    rotation = np.stack([across, np.cross(pipe.axis, across), pipe.axis])
    inside_m = 0.5  # no chamber in view
    position = rotation @ -pipe.point + [0.0, 0.0, inside_m]
    sewer = VirtualSewer(circular(2 * pipe.radius), pipe.end + inside_m)
    hits = sewer.cast(position, rotation, coarse_rays(lens))
    return StereoCamera(lens, noise, Window(), np.random.default_rng(seed)).picture(hits)


def lit_alike(pipe: Pipe, lens: Intrinsics, real: Sample, seed: int) -> tuple[float, NDArray[np.uint16]]:
    """(light, depth picture) of the twin that has depth on as much of its wall as the real frame."""
    wanted = float(np.isnan(real.off[real.looked]).mean())
    low, high = 0.1, 1.6
    for _ in range(7):
        light = (low + high) / 2
        picture = twin(pipe, lens, StereoNoise(light=light), seed)
        low, high = (light, high) if float((picture[real.looked] == 0).mean()) > wanted else (low, light)
    return light, picture


def sample(depth: NDArray[np.uint16], lens: Intrinsics, unit_m: float, pipe: Pipe) -> Sample:
    """How a depth picture strays from the wall of ``pipe``."""
    direction = np.dstack([rays(lens).astype(np.float64), np.ones((lens.height, lens.width))])
    lengthwise = direction @ pipe.axis
    aside = direction - lengthwise[..., None] * pipe.axis
    a, b = np.einsum("ijk,ijk->ij", aside, aside), aside @ pipe.point
    root = np.sqrt(np.maximum(b * b - a * (pipe.point @ pipe.point - pipe.radius**2), 0))
    wall = (b + root) / np.maximum(a, 1e-12)
    normal = (aside * wall[..., None] - pipe.point) / pipe.radius
    cosine = np.abs(np.einsum("ijk,ijk->ij", normal, direction)) / np.linalg.norm(direction, axis=2)
    pixels = lens.fx * BASELINE_M
    measured = np.where(depth > 0, pixels / np.maximum(depth * unit_m, 1e-3), np.nan)
    expected = pixels / wall
    slant = np.abs(np.gradient(expected, axis=1))
    shared = (expected < Matching().search_px) & (np.arange(lens.width) > expected + 3)
    off = (measured - expected) * 848 / lens.width
    return Sample(wall, cosine, slant, off, (wall * lengthwise < pipe.end - 0.1) & shared)


def spread(samples: list[Sample], low: float, high: float) -> tuple[float, float, float]:
    """(fine, coarse, holes): standard deviations in pixels, and the share without a measurement, of walls at these ranges."""
    fine, coarse, seen, missing = [], [], 0, 0
    for found in samples:
        here = found.looked & (found.wall >= low) & (found.wall < high)
        if np.count_nonzero(here) < _LEAST:
            continue
        good = here & (np.abs(np.nan_to_num(found.off, nan=99.0)) < ON_WALL_PX)
        count = _boxed(good.astype(np.float32))
        mean = _boxed(np.where(good, found.off, 0).astype(np.float32)) / np.maximum(count, 1e-6)
        full = good & (count > 0.4)
        fine.append((found.off - mean)[full])
        coarse.append(mean[full])
        seen, missing = seen + np.count_nonzero(here), missing + np.count_nonzero(here & np.isnan(found.off))
    if not seen:
        return np.nan, np.nan, np.nan
    return _robust(np.concatenate(fine)), _robust(np.concatenate(coarse)), missing / seen


def holes(samples: list[Sample], quantity: str, low: float, high: float) -> float:
    """Share without a measurement where ``quantity`` ("cosine" or "slant") of the wall lies between."""
    chosen = [
        np.isnan(found.off[found.looked & (getattr(found, quantity) >= low) & (getattr(found, quantity) < high)])
        for found in samples
    ]
    together = np.concatenate(chosen)
    return float(together.mean()) if together.size > _LEAST else np.nan


def speckle(found: Sample) -> tuple[float, float]:
    """(blobs a picture, their median size in pixels at 848 of width) of what was measured off the wall, the end left out."""
    false = (found.looked & (np.abs(np.nan_to_num(found.off, nan=0.0)) >= ON_WALL_PX)).astype(np.uint8)
    _, _, stats, _ = cv2.connectedComponentsWithStats(false, connectivity=4)
    sizes = stats[1:, cv2.CC_STAT_AREA] * (848 / found.wall.shape[1]) ** 2
    sizes = sizes[sizes >= 9]
    return float(sizes.size), float(np.median(sizes)) if sizes.size else np.nan


def _boxed(values: NDArray[np.float32]) -> NDArray[np.float32]:
    return np.asarray(cv2.boxFilter(values, -1, (BLOCK, BLOCK)), np.float32)


def _robust(values: NDArray[np.floating]) -> float:
    return float(1.4826 * np.median(np.abs(values - np.median(values)))) if values.size > _LEAST else np.nan


def _shown(value: float, digits: int = 2) -> str:
    return "-" if np.isnan(value) else f"{value:.{digits}f}"


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.bench.noise_fit", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--per-frame", action="store_true", help="also one line for each frame")
    per_frame = parser.parse_args().per_frame
    real: list[Sample] = []
    virtual: list[Sample] = []
    lines = []
    for number, frame in enumerate(real_frames()):
        pipe = pipe_of(frame) if frame.emitter and frame.wall_visible and frame.pipe in ROUND_PIPES else None
        if pipe is None:
            continue
        lens = frame.intrinsics
        real.append(sample(frame.depth, lens, frame.depth_unit_m, pipe))
        light, picture = lit_alike(pipe, lens, real[-1], number)
        virtual.append(sample(picture, lens, 0.001, pipe))
        measured = [float((~np.isnan(pair.off)).mean()) for pair in (real[-1], virtual[-1])]
        blobs = [speckle(pair) for pair in (real[-1], virtual[-1])]
        lines.append(
            [frame.name.removesuffix(".png"), f"{2000 * pipe.radius:.1f}", f"{pipe.end:.2f}", f"{light:.2f}"]
            + [f"{share:.2f}" for share in measured]
            + [f"{count:.0f} of {_shown(size, 0)} px" for count, size in blobs]
        )
    if per_frame:
        print_table("Frames", ("frame", "mm", "end m", "light", "measured", "virtual", "speckle", "virtual"), lines)
    rows = []
    for low, high in RANGES_M:
        pairs = list(zip(spread(real, low, high), spread(virtual, low, high), strict=True))
        rows.append([f"{low:.2f} to {high:.2f} m", *(_shown(value) for pair in pairs for value in pair)])
    header = ("range of the wall", "fine px", "virtual", "coarse px", "virtual", "holes", "virtual")
    print_table(f"How {len(real)} real frames and their virtual twins stray from the wall", header, rows)
    for quantity, bands in (("cosine", COSINES), ("slant", SLANTS)):
        rows = [
            [f"{low:.2f} to {high:.2f}", *(_shown(holes(group, quantity, low, high)) for group in (real, virtual))]
            for low, high in bands
        ]
        what = "cosine of incidence" if quantity == "cosine" else "change of disparity along the row, pixels per pixel"
        print_table(f"Holes by the {what}", (quantity, "real", "virtual"), rows)
    counts = [np.array([speckle(found) for found in found_list]) for found_list in (real, virtual)]
    rows = [
        [name, *(f"{np.nanmedian(values[:, k]):.0f}" for values in counts)]
        for k, name in enumerate(("blobs a picture, median", "pixels a blob, median"))
    ]
    print_table("False matches, off the wall", ("", "real", "virtual"), rows)


if __name__ == "__main__":
    main()
