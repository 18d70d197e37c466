"""Figure 5, the back end: what association, update and management of the landmark mapper cost.

    python -m tests.bench.landmark_cost                 tables
    python -m tests.bench.landmark_cost --plot OUT.png  and the curves as a picture

First the mapper as a whole on a drive on which twenty tracks are in view in every frame, then gating, update and assignment by
themselves over the number of detections M and tracks N. Times are of the process (user and system), one thread.
"""

from __future__ import annotations

import argparse
import os
import platform
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from estimators.detections import CLASSES, Detection
from estimators.landmarks import association, ekf
from estimators.landmarks.mapper import Mapper
from estimators.landmarks.projection import PipeCamera, View, jacobian, project
from estimators.landmarks.types import Observation
from tests.bench.table import print_table

Array = NDArray[np.float64]

CAMERA = PipeCamera(500.0, 500.0, 0.3, 720, 576)
CENTRE = (360.0, 288.0)
SIZES = (5, 10, 20, 40, 60, 80, 100, 125, 150, 175, 200)
REPEATS = 30


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--plot", type=Path, metavar="OUT.png")
    parser.add_argument("--frames", type=int, default=600)
    arguments = parser.parse_args()
    print(f"{platform.machine()}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}, Python {platform.python_version()}")
    whole(arguments.frames)
    curves = parts()
    if arguments.plot:
        plot(arguments.plot, curves)


def whole(frames: int) -> None:
    """ms a frame of ``Mapper.update`` with about 20 tracks in view."""
    rows = []
    for wanted in (5, 10, 20, 40):
        rng = np.random.default_rng(0)
        mapper = Mapper(CAMERA)
        spacing = 2.5 / wanted  # each is in view for 2.5 m
        truths = np.stack(
            [np.arange(1.0, 40.0, spacing), rng.uniform(-np.pi, np.pi, len(np.arange(1.0, 40.0, spacing)))], axis=1
        )
        spent, tracks, seen = [], [], []
        for k in range(frames):
            view = View(2.0 + 0.015 * k, CENTRE)
            ahead = truths[(truths[:, 0] - view.position < 3.0) & (truths[:, 0] - view.position > 0.4)]
            pixels = project(CAMERA, view, ahead) + rng.normal(0, 15.0, (len(ahead), 2))
            pixels = pixels[rng.random(len(pixels)) < 0.85]
            false = rng.uniform((0, 0), (720, 576), (int(rng.poisson(1.0)), 2))
            found = tuple(
                Detection(float(u), float(v), CLASSES[int(rng.integers(len(CLASSES))) if j >= len(pixels) else 0])
                for j, (u, v) in enumerate([*pixels, *false])
            )
            observation = Observation(k, k / 25, view, found, 0.005, 2.0)
            started = time.process_time_ns()
            mapper.update(observation)
            if k > 200:
                spent.append((time.process_time_ns() - started) / 1e6)
                position = mapper.tracks.state[:, 0] - view.position
                tracks.append(int(((position > 0) & (position < 3.2)).sum()))
                seen.append(len(found))
        rows.append(
            (f"{np.mean(tracks):.0f}", f"{np.mean(seen):.0f}", f"{np.mean(spent):.2f}", f"{np.quantile(spent, 0.99):.2f}")
        )
    print_table("Mapper.update, ms a frame", ("tracks ahead", "detections", "mean", "99 %"), rows)


def parts() -> dict[str, list[tuple[int, float]]]:
    """ms of gating, update, components and assignment over M x N, M = N."""
    curves: dict[str, list[tuple[int, float]]] = {"gating": [], "update": [], "components, assignment": []}
    rows = []
    for size in SIZES:
        states, covariances, pixels, view = _scene(size)
        noise = (15.0, 4.0, 0.01)
        reach = (np.zeros(size), np.zeros(size))
        gated = association.gate(CAMERA, view, states, covariances, pixels, reach, noise)
        cost = np.where(np.isfinite(gated.distance2), gated.distance2 - association.GATE - 1.0, np.inf)
        groups = association.components(cost < 0)
        pixel_noise = ekf.measurement_noise(jacobian(CAMERA, view, states), *noise)
        gating = _ms(lambda: association.gate(CAMERA, view, states, covariances, pixels, reach, noise))  # noqa: B023
        update = _ms(lambda: ekf.update(CAMERA, view, states, covariances, pixels, pixel_noise))  # noqa: B023
        assigning = _ms(lambda: association.assign(cost))  # noqa: B023
        largest = max((max(len(r), len(c)) for r, c in groups), default=0)
        rows.append((f"{size} x {size}", f"{gating:.2f}", f"{update:.2f}", f"{assigning:.2f}", len(groups), largest))
        for name, value in zip(curves, (gating, update, assigning), strict=True):
            curves[name].append((size * size, value))
    print_table("The parts, ms", ("M x N", "gating", "update", "components, assignment", "components", "largest"), rows)
    pairs = np.array([p for p, _ in curves["gating"]], dtype=np.float64)
    for name in ("gating", "update"):
        ms = np.array([value for _, value in curves[name]])
        slope, start = np.polyfit(pairs, ms, 1)
        left = 1 - ((ms - slope * pairs - start) ** 2).sum() / ((ms - ms.mean()) ** 2).sum()
        big = pairs >= 1600
        power = np.polyfit(np.log(pairs[big]), np.log(ms[big]), 1)[0]
        grows = f"grows with (M N)^{power:.2f} from 40 x 40 on"
        print(f"  {name}: {start:.2f} ms + {1e6 * slope:.0f} ns a pair, R^2 {left:.2f}; {grows}")
    return curves


def _scene(size: int) -> tuple[Array, Array, Array, View]:
    """So many tracks all over the wall ahead, each seen once."""
    rng = np.random.default_rng(size)
    view = View(1.0, CENTRE)
    states = np.stack([1.0 + rng.uniform(0.55, 3.0, size), rng.uniform(-np.pi, np.pi, size)], axis=1)
    covariances = np.repeat(np.diag([0.01**2, 0.02**2])[None], size, axis=0)
    pixels = project(CAMERA, view, states) + rng.normal(0, 10.0, (size, 2))
    return states, covariances, pixels[rng.permutation(size)], view


def _ms(call: Callable[[], object]) -> float:
    """Median ms of a call."""
    call()
    spent = []
    for _ in range(REPEATS):
        started = time.perf_counter_ns()
        call()
        spent.append((time.perf_counter_ns() - started) / 1e6)
    return float(np.median(spent))


def plot(path: Path, curves: dict[str, list[tuple[int, float]]]) -> None:
    """The curves over M x N as a PNG."""
    width, height, left, bottom = 900, 560, 80, 60
    picture = np.full((height, width, 3), 255, dtype=np.uint8)
    most_x = max(x for curve in curves.values() for x, _ in curve)
    most_y = 1.1 * max(y for curve in curves.values() for _, y in curve)

    def place(x: float, y: float) -> tuple[int, int]:
        return int(left + x / most_x * (width - left - 30)), int(height - bottom - y / most_y * (height - bottom - 30))

    black = (0, 0, 0)
    cv2.line(picture, place(0, 0), place(most_x, 0), black, 1, cv2.LINE_AA)
    cv2.line(picture, place(0, 0), place(0, most_y), black, 1, cv2.LINE_AA)
    for share in np.linspace(0, 1, 5):
        _text(picture, f"{share * most_x:.0f}", place(share * most_x, 0), (-15, 22))
        _text(picture, f"{share * most_y:.1f}", place(0, share * most_y), (-50, 5))
    _text(picture, "detections x tracks", place(most_x / 2, 0), (-70, 48))
    _text(picture, "ms", place(0, most_y), (-30, -8))
    colours = ((200, 90, 20), (30, 140, 30), (40, 40, 200))
    for number, ((name, curve), colour) in enumerate(zip(curves.items(), colours, strict=True)):
        points = np.array([place(x, y) for x, y in curve], dtype=np.int32)
        cv2.polylines(picture, [points], False, colour, 2, cv2.LINE_AA)
        for point in points:
            cv2.circle(picture, (int(point[0]), int(point[1])), 4, colour, -1, cv2.LINE_AA)
        _text(picture, name, (left + 30, 40 + 26 * number), (0, 0), colour)
    if not cv2.imwrite(str(path), picture):
        raise SystemExit(f"The plot cannot be written to {path}.")
    print(f"  plot: {path}")


def _text(
    picture: NDArray[np.uint8], text: str, at: tuple[int, int], by: tuple[int, int], colour: tuple[int, int, int] = (0, 0, 0)
) -> None:
    cv2.putText(picture, text, (at[0] + by[0], at[1] + by[1]), cv2.FONT_HERSHEY_SIMPLEX, 0.5, colour, 1, cv2.LINE_AA)


if __name__ == "__main__":
    main()
