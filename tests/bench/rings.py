"""Joints, f R, the pixels' aspect and the camera's offset from rendered virtual drives, against their truth.

python -m tests.bench.rings

A picture each 0.1 m of way; the rings are looked for around the truth's focus of expansion, off by ``--centre-px``, or around
the dark of the pipe. Positions are the truth's: the tether's errors are the smoother's business.
"""

from __future__ import annotations

import argparse
import itertools
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.virtual.cctv import Renderer
from drivers.virtual.drive import View, straight_drive
from drivers.virtual.look import random_look
from estimators.rings import JointConfig, JointMap, RingMap, axis_view, dark_centre, find
from tests.bench.table import print_table

Array = NDArray[np.float64]
STEP_M = 0.1
POSITION_STD = 0.01
SETTLED = 0.7
"""A joint that the camera came near to, to this share of F / radius in half heights of the picture, should have been found."""


@dataclass(frozen=True)
class Outcome:
    """One drive. ``errors`` of the joints found (m) and what they were said to be, ``focal`` = (found, sigma, truth) or None,
    errors of lean (share of the radius) and centre (px) picture by picture."""

    seed: int
    wanted: int
    found: int
    false: int
    errors: Array
    sigmas: Array
    focal: tuple[float, float, float] | None
    aspect: float
    lean: Array
    centre: Array
    ms: float


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=10, help="drives, seeds from 300 on")
    parser.add_argument("--first", type=int, default=300)
    parser.add_argument("--metres", type=float, default=10.0, help="of each drive")
    parser.add_argument("--centre-px", type=float, default=None, help="around the truth, off by so much; else around the dark")
    arguments = parser.parse_args()
    seeds = range(arguments.first, arguments.first + arguments.seeds)
    with ProcessPoolExecutor(2) as pool:
        outcomes = list(pool.map(drive, seeds, itertools.repeat(arguments.metres), itertools.repeat(arguments.centre_px)))
    header = (
        "seed",
        "joints",
        "false",
        "|error| mm",
        "error/sigma",
        "f R off",
        "off/sigma",
        "aspect",
        "lean",
        "centre px",
        "ms",
    )
    print_table("Rings of virtual drives (medians)", header, [_row(outcome) for outcome in outcomes])
    wanted, found = (sum(getattr(outcome, name) for outcome in outcomes) for name in ("wanted", "found"))
    false = sum(outcome.false for outcome in outcomes)
    errors = np.abs(np.concatenate([outcome.errors for outcome in outcomes]))
    sigmas = np.concatenate([outcome.sigmas for outcome in outcomes])
    told = [abs(outcome.focal[0] - outcome.focal[2]) / outcome.focal[1] for outcome in outcomes if outcome.focal is not None]
    print(f"joints {found} of {wanted}, false {false}; |error| median {1000 * np.median(errors):.0f} mm,")
    print(f"95 % {1000 * np.quantile(errors, 0.95):.0f} mm; within 2 sigma {100 * np.mean(errors < 2 * sigmas):.0f} %")
    print(f"f R told in {len(told)} of {len(outcomes)} drives, within 2 sigma in {sum(one < 2 for one in told)}")


def drive(seed: int, metres: float, centre_px: float | None, step: float = STEP_M) -> Outcome:
    """Render one drive and map its joints."""
    cv2.setNumThreads(1)
    journey = straight_drive(seed)
    camera, rng = journey.camera, np.random.default_rng(seed)
    renderer = Renderer(journey.sewer, camera, random_look(rng), seed)
    found = RingMap(config=JointConfig(position_std=POSITION_STD))
    seconds: list[float] = []
    views: dict[int, tuple[View, tuple[float, float]]] = {}
    t, last = 0.0, -np.inf
    while journey.truth.chainage(t) < metres:
        t += 0.02
        place = journey.truth.chainage(t)
        if place < last + step:
            continue
        last = place
        gray = np.asarray(cv2.cvtColor(renderer.picture(journey.pose(t), rng), cv2.COLOR_BGR2GRAY), np.uint8)
        truth = journey.truth.view(t)
        angle = rng.uniform(0, 2 * np.pi)
        off = 0.0 if centre_px is None else centre_px
        around = truth.centre[0] + off * float(np.cos(angle)), truth.centre[1] + off * float(np.sin(angle))
        started = time.perf_counter()
        rings = find(gray, dark_centre(gray) if centre_px is None else around, aspect=found.aspect)
        seconds.append(time.perf_counter() - started)
        found.add(len(seconds), place, rings)
        views[len(seconds)] = truth, around
    focal = float(np.sqrt(camera.fx * camera.fy)) * journey.sewer.radius
    near = SETTLED * focal / (camera.height / 2)
    passed = [joint for joint in journey.truth.joints if journey.truth.chainage(0.0) + 0.5 < joint < last + near]
    result = found.solve(last=True)
    leans, centres = _axes(result, views, centre_px, journey.sewer.radius)
    errors, sigmas, false = [], [], 0
    owned: set[float] = set()
    for joint in result.joints:
        truth_at = min(journey.truth.joints, key=lambda at: abs(at - joint.chainage))
        if abs(truth_at - joint.chainage) > 0.25:
            false += 1
            continue
        owned.add(truth_at)
        errors.append(joint.chainage - truth_at)
        sigmas.append(joint.std)
    told = result.focal_radius
    return Outcome(
        seed,
        len(passed),
        len(owned & set(passed)),
        false,
        np.array(errors),
        np.array(sigmas),
        None if told is None else (told.value, told.sigma, focal),
        found.aspect * camera.fy / camera.fx,
        np.array(leans),
        np.array(centres),
        1000 * float(np.median(seconds)),
    )


def _axes(
    result: JointMap, views: dict[int, tuple[View, tuple[float, float]]], centre_px: float | None, radius: float
) -> tuple[list[float], list[float]]:
    """Errors of lean and centre in the pictures with rings that are joints: one beside a focus of expansion, else two."""
    leans, centres = [], []
    for frame, (truth, around) in views.items():
        rings = [seen.ring for joint in result.joints for seen in joint.sightings if seen.frame == frame]
        view = axis_view(rings, foe=None if centre_px is None else (around, max(centre_px, 1.0)))
        if view is not None:
            leans.append(float(np.hypot(*(view.lean - np.array(truth.axis) / radius))))
            centres.append(float(np.hypot(*(view.centre - np.array(truth.centre)))))
    return leans, centres


def _row(outcome: Outcome) -> tuple[str, ...]:
    def median(values: Array) -> float:
        return float(np.median(np.abs(values))) if len(values) else float("nan")

    focal = ("-", "-")
    if outcome.focal is not None:
        value, sigma, truth = outcome.focal
        focal = f"{100 * (value / truth - 1):+.1f} %", f"{(value - truth) / sigma:+.1f}"
    return (
        str(outcome.seed),
        f"{outcome.found}/{outcome.wanted}",
        str(outcome.false),
        f"{1000 * median(outcome.errors):.0f}",
        f"{median(outcome.errors / outcome.sigmas):.1f}",
        *focal,
        f"{outcome.aspect:.3f}",
        f"{median(outcome.lean):.3f}",
        f"{median(outcome.centre):.1f}",
        f"{outcome.ms:.0f}",
    )


if __name__ == "__main__":
    main()
