"""Smoothing against the filter alone (issue 3, figure 4): tether scale off by 2 %, three slips of 0.3 m.

Once with f and R given, once with the length from node to node as the only source of scale. The filter is the mapper itself
(``estimators.landmarks.mapper``), fed with detections corrupted as for figure 3: precision and recall of the paper's Table II,
15 px of noise, half of the misses and of the false detections in bursts of 5 to 20 frames, false ones fixed in the picture. The
smoother gets the mapper's sightings, doubles and all, once alone and once with the rings of joints beside them. Eight landmarks
in 28 m, seen to 15 px, tell the scale of the tether to 1.8 % at best: without rings (or a length) there is little to gain.

``bound`` is the mean error that the information in all sightings allows (Cramer and Rao) to one who is told more than ours:
which detection is of which landmark, and at which moments the tether slips. Where half the mapper's error lies below it, no
smoother can halve that error.

Reported over all true landmarks that both hold: error along the pipe of the mapper and of the smoother, and how many truths
the 95 % ellipses (chainage, angle) hold.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass, replace
from multiprocessing import Pool

import numpy as np
from numpy.typing import NDArray

from estimators.detections import Detection
from estimators.landmarks.mapper import Mapper
from estimators.landmarks.projection import PipeCamera, View
from estimators.landmarks.smoothing import (
    NO_RINGS,
    Constraints,
    Frames,
    Known,
    Noise,
    RingSightings,
    Run,
    Sightings,
    moved,
    run_of,
    smooth,
    smooth_survey,
)
from estimators.landmarks.types import Landmark, Observation
from tests.bench.table import percent, print_table

Array = NDArray[np.float64]

CAMERA = PipeCamera(420.0, 420.0, 0.3, 720, 576)
FOCAL_RADIUS = CAMERA.fx * CAMERA.radius
ELLIPSE_95 = 5.991
PRECISION = {"connection": 0.71, "displaced joint": 0.69}
RECALL = {"connection": 0.88, "displaced joint": 0.94}
COLUMNS = (
    *("scale from", "marks", "lost", "too many", "mapper m", "rms", "smooth m", "rms", "ratio", "angle deg"),
    *("bound m", "mapper 95 %", "held 95 %", "binomial", "+- by runs", "slips", "cpu s", "no end"),
)


@dataclass(frozen=True)
class Settings:
    """One simulated drive. ``focal_known``: relative standard deviation of f*R where it is given; ``nominal``: of the f*R that
    the mapper takes where it is not; ``length_std`` (m) of the stated length."""

    length: float = 28.0
    landmarks: int = 8
    fps: float = 10.0
    speed: float = 0.15
    scale_error: float = 0.02
    slips: int = 3
    slip: float = 0.3
    noise_px: float = 15.0
    ring_px: float = 3.0
    sight: float = 5.0
    centre_px: float = 4.0
    axis: float = 0.03
    roll: float = 0.01
    focal_known: float = 0.003
    nominal: float = 0.1
    length_std: float = 0.03


@dataclass(frozen=True)
class Drive:
    """What was observed in a drive, and its truth: landmarks (N, 2), and the moments (s) at which the tether was ``slipping``.

    ``sources`` tells which landmark a detection (frame, u, v) is of.
    """

    observations: list[Observation]
    rings: RingSightings
    sources: dict[tuple[int, float, float], int]
    labels: list[str]
    landmarks: Array
    slipping: tuple[float, ...]


def wander(rng: np.random.Generator, way: Array, std: float, memory: float) -> Array:
    """(n, 2) of an error along a way (n,) that is forgotten over ``memory``."""
    kept = np.exp(-np.abs(np.diff(way)) / memory)
    steps = rng.normal(0, std, (len(way), 2))
    steps[1:] *= np.sqrt(1 - kept**2)[:, None]
    for k, keep in enumerate(kept):
        steps[k + 1] += keep * steps[k]
    return steps


def missed(rng: np.random.Generator, count: int, share: float) -> NDArray[np.bool_]:
    """Frames (count,) without a detection: half of them single, half in bursts of 5 to 20."""
    out = rng.uniform(size=count) < share / 2
    for start in np.flatnonzero(rng.uniform(size=count) < share / 2 / 12.5):
        out[start : start + int(rng.integers(5, 21))] = True
    return out


def way_of(rng: np.random.Generator, settings: Settings) -> tuple[Array, Array, Array, list[float]]:
    """Times, positions and tether of a crawler that does not keep its speed and stands now and then, and the moments (s) at
    which the tether slips."""
    count = int(settings.length / settings.speed * settings.fps) + 1
    clock = np.arange(count) / settings.fps
    speed = np.clip(1 + 0.3 * np.interp(clock, np.linspace(0, clock[-1], 20), rng.normal(0, 1, 20)), 0.2, None)
    for stop in rng.uniform(0.1, 0.9, 3) * clock[-1]:
        speed[(clock > stop) & (clock < stop + 5)] = 0.0
    x = np.concatenate([[0.0], np.cumsum((speed[1:] + speed[:-1]) / 2)])
    x *= settings.length / x[-1]
    scale = 1 + settings.scale_error * rng.choice([-1.0, 1.0])
    counted = x / scale
    moments: list[float] = []
    for _ in range(settings.slips):
        at, lasts = rng.uniform(0.05, 0.95) * clock[-1], rng.uniform(0.5, 3.0)
        counted = counted + settings.slip * rng.choice([-1.0, 1.0]) * np.clip((clock - at) / lasts, 0, 1)
        moments += np.arange(at, at + lasts, 1 / settings.fps).tolist()
    return clock, x, counted + rng.normal(0, 0.003, count), moments


def simulate(rng: np.random.Generator, settings: Settings, focal_radius: float) -> Drive:
    """One drive from node to node."""
    clock, x, counted, moments = way_of(rng, settings)
    count = len(x)
    chainages = np.sort(rng.uniform(1.0, settings.length, settings.landmarks))
    landmarks = np.stack([chainages, rng.uniform(-np.pi, np.pi, settings.landmarks)], axis=1)
    labels = ["displaced joint" if k % 4 == 3 else "connection" for k in range(settings.landmarks)]
    centre = np.array([CAMERA.width / 2, CAMERA.height / 2]) + wander(rng, x, 20.0, 3.0)
    told = centre + wander(rng, x, settings.centre_px, 0.5)
    axis, roll = wander(rng, x, settings.axis, 4.0), wander(rng, x, settings.roll, 4.0)[:, 0]
    seen: list[list[Detection]] = [[] for _ in range(count)]
    sources: dict[tuple[int, float, float], int] = {}
    for k, ((chainage, angle), label) in enumerate(zip(landmarks, labels, strict=True)):
        depth = np.where(chainage - x > 0.1, chainage - x, np.nan)
        direction = np.stack([np.cos(angle + roll), np.sin(angle + roll)], axis=1)
        pixels = centre + focal_radius * (axis + direction) / depth[:, None]
        inside = (depth < settings.sight) & (pixels > 0).all(axis=1) & (pixels < (CAMERA.width, CAMERA.height)).all(axis=1)
        inside &= ~missed(rng, count, 1 - RECALL[label])
        pixels = pixels + rng.normal(0, settings.noise_px, (count, 2))
        for i in np.flatnonzero(inside):
            u, v = float(pixels[i, 0]), float(pixels[i, 1])
            seen[i].append(Detection(u, v, label, 0.9))
            sources[int(i), u, v] = k
    for label, precision in PRECISION.items():
        rate = sum(d.label == label for frame in seen for d in frame) * (1 / precision - 1) / count
        for share, lowest, highest in ((0.5, 1, 1), (0.5, 5, 20)):
            for start in np.flatnonzero(rng.uniform(size=count) < rate * share / ((lowest + highest) / 2)):
                u, v = float(rng.uniform(0, CAMERA.width)), float(rng.uniform(0, CAMERA.height))
                for i in range(start, min(start + int(rng.integers(lowest, highest + 1)), count)):
                    seen[i].append(Detection(u, v, label, 0.7))
    observations = [
        Observation(
            i,
            float(clock[i]),
            View(float(counted[i]), (float(told[i, 0]), float(told[i, 1]))),
            tuple(seen[i]),
            centre_std=settings.centre_px,
        )
        for i in range(count)
    ]
    rings = rings_of(rng, settings, focal_radius, x)
    return Drive(observations, rings, sources, labels, landmarks, tuple(moments))


def rings_of(rng: np.random.Generator, settings: Settings, focal_radius: float, x: Array) -> RingSightings:
    """Joints every 2.5 m, found in half of the frames, one ring in twenty wrong."""
    joint, frame, radius_px = [], [], []
    for number, chainage in enumerate(np.arange(rng.uniform(0.5, 2.5), settings.length, 2.5)):
        depth = np.where(chainage - x > 0.1, chainage - x, np.nan)
        radius = focal_radius / depth
        for i in np.flatnonzero((radius < 280) & (depth < 4) & (rng.uniform(size=len(x)) < 0.5)):
            wrong = rng.uniform(-30, 30) if rng.uniform() < 0.05 else 0.0
            joint.append(number)
            frame.append(int(i))
            radius_px.append(radius[i] + rng.normal(0, settings.ring_px) + wrong)
    std = np.full(len(joint), settings.ring_px)
    return RingSightings(np.array(joint, np.int64), np.array(frame, np.int64), np.array(radius_px), std)


def by_truth(landmarks: list[Landmark], sightings: list[Landmark], drive: Drive) -> tuple[dict[int, Landmark], int]:
    """The landmark that stands for each truth (the one with most hits), by whose detections it was made of, and how many are
    left: false ones and doubles. ``sightings``: the mapper's landmarks, which know them."""
    made_of = {mark.id: [drive.sources.get((s.frame, s.u, s.v), -1) for s in mark.sightings] for mark in sightings}
    found: dict[int, Landmark] = {}
    for mark in landmarks:
        sources = np.array(made_of[mark.id])
        truth = int(np.bincount(sources + 1, minlength=1).argmax()) - 1
        if truth >= 0 and (truth not in found or found[truth].hits < mark.hits):
            found[truth] = mark
    return found, len(landmarks) - len(found)


def error_of(mark: Landmark, truth: Array) -> tuple[float, float, float]:
    """Along the pipe (m), around it (rad), and squared in standard deviations."""
    error = np.array([mark.chainage, mark.angle]) - truth
    error[1] = float(np.angle(np.exp(1j * error[1])))
    return float(error[0]), float(error[1]), float(error @ np.linalg.solve(mark.covariance, error))


@dataclass(frozen=True)
class Outcome:
    """Errors (N, 3) of mapper and smoother on the truths both hold, as ``error_of``; ``bound`` (N,) of the standard deviation
    (m) along the pipe; landmarks too many before and after."""

    before: Array
    after: Array
    bound: Array
    too_many: tuple[int, int]
    lost: int
    cpu_s: float
    slips_found: float
    converged: bool


def one_run(work: tuple[int, Settings, bool]) -> tuple[Outcome, Outcome]:
    """Simulate, map and smooth one drive, without and with rings; f*R given, else only the length."""
    seed, settings, given = work
    rng = np.random.default_rng([seed, int(given)])
    truth = FOCAL_RADIUS * (1 + rng.normal(0, settings.focal_known if given else settings.nominal))
    drive = simulate(rng, settings, truth)
    mapper = Mapper(CAMERA)
    for observation in drive.observations:
        mapper.update(observation)
    mapper.finish()
    landmarks = mapper.landmarks()
    filtered, too_many = by_truth(landmarks, landmarks, drive)
    if given:
        constraints = Constraints(focal_radius=Known(FOCAL_RADIUS, settings.focal_known * FOCAL_RADIUS))
    else:
        length = settings.length + rng.normal(0, settings.length_std)
        constraints = Constraints(length=Known(length, settings.length_std))
    constraints = replace(constraints, start=Known(0.0, 0.01))
    noise = Noise(centre_std=settings.centre_px, axis_std=settings.axis)
    outcomes = []
    for rings in (NO_RINGS, drive.rings):
        started = time.process_time()
        run = run_of(drive.observations, landmarks, CAMERA, settings.noise_px, rings)
        result, _ = smooth_survey(run, constraints, noise)
        seconds = time.process_time() - started
        smoothed, left = by_truth(moved(landmarks, result), landmarks, drive)
        both = sorted(set(filtered) & set(smoothed))
        outcomes.append(
            Outcome(
                np.array([error_of(filtered[k], drive.landmarks[k]) for k in both]).reshape(-1, 3),
                np.array([error_of(smoothed[k], drive.landmarks[k]) for k in both]).reshape(-1, 3),
                bound_of(drive, settings, rings, constraints, noise)[both],
                (too_many, left),
                settings.landmarks - len(both),
                seconds,
                len(result.slips),
                result.converged,
            )
        )
    return outcomes[0], outcomes[1]


def bound_of(drive: Drive, settings: Settings, rings: RingSightings, constraints: Constraints, noise: Noise) -> Array:
    """Standard deviation (m) of each true landmark along the pipe by the information of all that was seen, inf for one that was
    not: the smoother's own covariance where it is told which detection is of which landmark, and when the tether slips."""
    views = [seen.view for seen in drive.observations]
    frames = Frames(
        np.array([seen.time_s for seen in drive.observations]),
        np.array([view.position for view in views]),
        np.array([view.centre for view in views]),
        np.zeros((len(views), 2)),
    )
    rows = [(truth, frame, u, v) for (frame, u, v), truth in drive.sources.items()]
    truth, frame, u, v = (np.array(column) for column in zip(*rows, strict=True))
    seen = Sightings(truth.astype(np.int64), frame.astype(np.int64), np.stack([u, v], 1), np.full(len(rows), settings.noise_px))
    run = Run(frames, seen, rings, suspected=drive.slipping)
    told = smooth(run, constraints, replace(noise, slip_rate=1e-9, drift=1e-4, outliers=1e-6))
    found = np.full(len(drive.landmarks), np.inf)
    for mark in told.landmarks:
        found[mark.id] = np.sqrt(mark.covariance[0, 0])
    return found


def binomial_interval(held: int, count: int) -> tuple[float, float]:
    """95 % interval of a share (Wilson)."""
    z, share = 1.96, held / count
    middle = (share + z**2 / (2 * count)) / (1 + z**2 / count)
    half = z * np.sqrt(share * (1 - share) / count + z**2 / (4 * count**2)) / (1 + z**2 / count)
    return middle - half, middle + half


def run_interval(outcomes: list[Outcome]) -> float:
    """Standard deviation of the share held, the landmarks of one run being alike: over the runs."""
    held = np.array([np.sum(outcome.after[:, 2] < ELLIPSE_95) for outcome in outcomes])
    count = np.array([len(outcome.after) for outcome in outcomes])
    share = held.sum() / count.sum()
    return float(np.sqrt(np.sum((held - share * count) ** 2)) / count.sum())


def row_of(name: str, outcomes: list[Outcome]) -> tuple[object, ...]:
    before, after = np.concatenate([o.before for o in outcomes]), np.concatenate([o.after for o in outcomes])
    held = int((after[:, 2] < ELLIPSE_95).sum())
    low, high = binomial_interval(held, len(after))
    mean_before, mean_after = np.abs(before[:, 0]).mean(), np.abs(after[:, 0]).mean()
    return (
        name,
        len(after),
        sum(o.lost for o in outcomes),
        f"{sum(o.too_many[0] for o in outcomes)} / {sum(o.too_many[1] for o in outcomes)}",
        f"{mean_before:.3f}",
        f"{np.sqrt((before[:, 0] ** 2).mean()):.3f}",
        f"{mean_after:.3f}",
        f"{np.sqrt((after[:, 0] ** 2).mean()):.3f}",
        f"{mean_after / mean_before:.2f}",
        f"{np.degrees(np.abs(before[:, 1]).mean()):.1f} / {np.degrees(np.abs(after[:, 1]).mean()):.1f}",
        f"{np.sqrt(2 / np.pi) * np.concatenate([o.bound for o in outcomes]).mean():.3f}",
        percent(int((before[:, 2] < ELLIPSE_95).sum()), len(after)),
        percent(held, len(after)),
        f"{100 * low:.1f} to {100 * high:.1f}",
        f"{100 * run_interval(outcomes):.1f}",
        f"{np.mean([o.slips_found for o in outcomes]):.1f}",
        f"{np.mean([o.cpu_s for o in outcomes]):.2f}",
        sum(not o.converged for o in outcomes),
    )


def main() -> None:
    parser = argparse.ArgumentParser(
        prog="python -m tests.bench.landmark_smoothing", description=(__doc__ or "").splitlines()[0]
    )
    parser.add_argument("--runs", type=int, default=120)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--length", type=float, default=28.0)
    parser.add_argument("--landmarks", type=int, default=8)
    parser.add_argument("--slips", type=int, default=3)
    parser.add_argument("--scale-error", type=float, default=0.02)
    parser.add_argument("--jobs", type=int, default=2)
    asked = parser.parse_args()
    settings = Settings(length=asked.length, landmarks=asked.landmarks, slips=asked.slips, scale_error=asked.scale_error)
    rows = []
    with Pool(asked.jobs) as pool:
        for name, given in (("f and R given", True), ("length only", False)):
            pairs = pool.map(one_run, [(asked.seed + k, settings, given) for k in range(asked.runs)], chunksize=4)
            rows.append(row_of(name, [pair[0] for pair in pairs]))
            rows.append(row_of(f"{name}, rings", [pair[1] for pair in pairs]))
    print_table(
        f"{asked.runs} runs of {asked.length:g} m with {asked.landmarks} landmarks; tether scale off by"
        f" {100 * asked.scale_error:g} %, {asked.slips} slips of {settings.slip:g} m",
        COLUMNS,
        rows,
    )


if __name__ == "__main__":
    main()
