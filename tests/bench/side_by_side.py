"""Real depth frames beside virtual ones of the same pipes, as one picture.

python -m tests.bench.side_by_side OUT.png [--frames 8]        real frames to the left, their twins to the right

The real ones are those of $BORESCOUT_DATA. The twin is that of ``tests.bench.noise_fit``: the pipe that was fitted to the
frame, from the same pose through the same lens, lit so that as much of its wall has a depth. Near is red, far is blue, black is
without a measurement.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from tests.bench.noise_fit import ROUND_PIPES, lit_alike, pipe_of, sample
from tests.bench.real_data import RealFrame, fail, real_frames

WIDTH = 480
NEAREST_M = 0.15


def painted(depth: NDArray[np.uint16], unit_m: float, caption: str) -> NDArray[np.uint8]:
    """A depth picture in colours (h, WIDTH, 3) uint8 BGR by inverse range, with its caption."""
    nearness = np.where(depth > 0, NEAREST_M / np.maximum(depth * unit_m, NEAREST_M), 0)
    colours = cv2.applyColorMap((255 * np.sqrt(nearness)).astype(np.uint8), cv2.COLORMAP_TURBO)
    colours[depth == 0] = 0
    small = cv2.resize(colours, (WIDTH, round(WIDTH * depth.shape[0] / depth.shape[1])), interpolation=cv2.INTER_NEAREST)
    strip = np.full((20, WIDTH, 3), 255, np.uint8)
    cv2.putText(strip, caption, (4, 14), cv2.FONT_HERSHEY_SIMPLEX, 0.42, (0, 0, 0), 1, cv2.LINE_AA)
    return np.vstack([strip, np.asarray(small, np.uint8)])


def pair(frame: RealFrame, seed: int) -> NDArray[np.uint8] | None:
    """The frame and its twin, or None where the pipe of the frame is not found."""
    pipe = pipe_of(frame)
    if pipe is None:
        return None
    real = sample(frame.depth, frame.intrinsics, frame.depth_unit_m, pipe)
    light, picture = lit_alike(pipe, frame.intrinsics, real, seed)
    name = frame.name.split("/depth_")[0]
    twin = f"virtual, {2000 * pipe.radius:.0f} mm, light {light:.2f}"
    return np.hstack([painted(frame.depth, frame.depth_unit_m, name), painted(picture, 0.001, twin)])


def chosen(frames: list[RealFrame], count: int) -> list[RealFrame]:
    """``count`` frames, evenly from all pipes."""
    fitting = [frame for frame in frames if frame.emitter and frame.wall_visible and frame.pipe in ROUND_PIPES]
    return [fitting[k] for k in np.unique(np.linspace(0, len(fitting) - 1, count).round().astype(int))]


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.bench.side_by_side", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("out", type=Path, metavar="OUT.png")
    parser.add_argument("--frames", type=int, default=8, help="how many real frames (8)")
    arguments = parser.parse_args()
    if arguments.frames < 1 or arguments.out.suffix.lower() != ".png":
        fail("Name a .png file to write, and at least one frame.")
    rows = [row for seed, frame in enumerate(chosen(real_frames(), arguments.frames)) if (row := pair(frame, seed)) is not None]
    if not rows or not cv2.imwrite(str(arguments.out), np.vstack(rows)):
        fail(f"The picture {arguments.out} could not be written.")
    print(f"{len(rows)} pairs in {arguments.out}")


if __name__ == "__main__":
    main()
