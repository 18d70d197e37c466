"""Smoothing against the filter alone (issue 3, figure 4): tether scale off by 2 %, three slips of 0.3 m.

Once with f and R given, once with the length from node to node as the only source of scale: the mean error along the pipe of the
filter and of the smoother, and how many truths their 95 % ellipses hold.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimators.landmarks.projection import PipeCamera, View, back_project, jacobian, project
from estimators.landmarks.smoothing import Constraints, Frames, Known, Noise, RingSightings, Run, Sightings, smooth
from tests.bench.table import percent, print_table

Array = NDArray[np.float64]
CAMERA = PipeCamera(420.0, 420.0, 0.3, 720, 576)
FOCAL_RADIUS = CAMERA.fx * CAMERA.radius
ELLIPSE_95 = 5.991


@dataclass(frozen=True)
class Settings:
    """One simulated drive."""

    length: float = 28.0
    landmarks: int = 8
    rings: bool = False
    fps: float = 5.0
    speed: float = 0.15
    scale_error: float = 0.02
    slips: int = 3
    slip: float = 0.3
    noise_px: float = 15.0
    ring_px: float = 3.0
    wrong: float = 0.05
    recall: float = 0.85
    sight: float = 5.0
    centre_px: float = 4.0
    axis: float = 0.03
    focal_known: float = 0.003
    """Relative standard deviation of f*R where it is given."""
    length_std: float = 0.03
    nominal_std: float = 0.1
    """Relative standard deviation of the f*R the filter takes where none is given."""


@dataclass(frozen=True)
class Drive:
    """A run and its truth: landmarks (N, 2), camera (n,), metres travelled per metre counted, f*R."""

    run: Run
    landmarks: Array
    positions: Array
    scale: float
    focal_radius: float


def wander(rng: np.random.Generator, way: Array, std: float, memory: float) -> Array:
    """(n, 2) of a Gauss-Markov error along a way (n,)."""
    kept = np.exp(-np.abs(np.diff(way)) / memory)
    out = np.empty((len(way), 2))
    out[0] = rng.normal(0, std, 2)
    for k, keep in enumerate(kept):
        out[k + 1] = keep * out[k] + rng.normal(0, 1, 2) * std * np.sqrt(1 - keep**2)
    return out


def simulate(rng: np.random.Generator, settings: Settings, focal_radius: float = FOCAL_RADIUS) -> Drive:
    """One drive from node to node."""
    count = int(settings.length / settings.speed * settings.fps) + 1
    clock = np.arange(count) / settings.fps
    # the crawler does not keep its speed, and stands now and then
    speed = np.clip(1 + 0.3 * np.interp(clock, np.linspace(0, clock[-1], 20), rng.normal(0, 1, 20)), 0.2, None)
    for stop in rng.uniform(0.1, 0.9, 3) * clock[-1]:
        speed[(clock > stop) & (clock < stop + 5)] = 0.0
    x = np.concatenate([[0.0], np.cumsum((speed[1:] + speed[:-1]) / 2)])
    x *= settings.length / x[-1]
    scale = 1 + settings.scale_error * rng.choice([-1.0, 1.0])
    counted = x / scale
    for _ in range(settings.slips):
        at, lasts = rng.uniform(0.05, 0.95) * clock[-1], rng.uniform(0.5, 3.0)
        counted = counted + settings.slip * rng.choice([-1.0, 1.0]) * np.clip((clock - at) / lasts, 0, 1)
    counted = counted - counted[0] + rng.normal(0, 0.003, count)
    landmarks = np.stack(
        [
            np.sort(rng.uniform(1.0, settings.length, settings.landmarks)),
            rng.uniform(-np.pi, np.pi, settings.landmarks),
        ],
        axis=1,
    )
    centre = np.array([360.0, 288.0]) + wander(rng, x, 20.0, 3.0)
    told = centre + wander(rng, x, settings.centre_px, 0.5)
    axis = wander(rng, x, settings.axis, 4.0)
    seen: list[tuple[int, int, float, float]] = []
    for k, (chainage, angle) in enumerate(landmarks):
        depth = chainage - x
        with np.errstate(divide="ignore"):
            u = centre[:, 0] + focal_radius * (axis[:, 0] + np.cos(angle)) / depth
            v = centre[:, 1] + focal_radius * (axis[:, 1] + np.sin(angle)) / depth
        inside = (depth > 0.1) & (depth < settings.sight) & (u > 0) & (u < 720) & (v > 0) & (v < 576)
        inside &= rng.uniform(size=count) < settings.recall
        error = rng.normal(0, settings.noise_px, (count, 2))
        # what is taken for the landmark and is not: anywhere within some gate, for a burst of frames
        burst, left = np.zeros(2), 0
        for i in np.flatnonzero(inside):
            if left == 0 and rng.uniform() < settings.wrong / 8:
                burst, left = rng.uniform(-60, 60, 2), int(rng.integers(5, 12))
            if left > 0:
                error[i], left = burst, left - 1
            seen.append((k, int(i), float(u[i] + error[i, 0]), float(v[i] + error[i, 1])))
    table = np.array(seen).reshape(-1, 4)
    rings = []
    if settings.rings:
        for joint, chainage in enumerate(np.arange(rng.uniform(0.5, 2.5), settings.length, 2.5)):
            depth = chainage - x
            with np.errstate(divide="ignore"):
                radius = focal_radius / depth
            for i in np.flatnonzero((depth > 0.1) & (radius < 280) & (depth < 4) & (rng.uniform(size=count) < 0.6)):
                wrong = rng.uniform(-30, 30) if rng.uniform() < settings.wrong else 0.0
                rings.append((joint, int(i), radius[i] + rng.normal(0, settings.ring_px) + wrong))
    circles = np.array(rings).reshape(-1, 3)
    run = Run(
        Frames(clock, counted, told, np.zeros((count, 2))),
        Sightings(
            table[:, 0].astype(np.int64), table[:, 1].astype(np.int64), table[:, 2:], np.full(len(table), settings.noise_px)
        ),
        RingSightings(
            circles[:, 0].astype(np.int64),
            circles[:, 1].astype(np.int64),
            circles[:, 2],
            np.full(len(circles), settings.ring_px),
        ),
    )
    return Drive(run, landmarks, x, scale, focal_radius)


def plain_filter(run: Run, focal_radius: float) -> dict[int, tuple[Array, Array]]:
    """State and covariance per landmark id by the paper's filter (eqs. 5 to 21), the associations given."""
    camera = PipeCamera(focal_radius, focal_radius, 1.0, 720, 576)
    states: dict[int, tuple[Array, Array]] = {}
    seen = run.sightings
    for i in np.argsort(seen.frame, kind="stable"):
        frame, name = seen.frame[i], int(seen.landmark[i])
        centre = run.frames.centre[frame]
        view = View(float(run.frames.encoder[frame]), (float(centre[0]), float(centre[1])))
        scatter = np.eye(2) * (seen.std[i] ** 2 + 16.0)
        if name not in states:
            start = back_project(camera, view, seen.pixels[i : i + 1])
            slope = np.linalg.inv(jacobian(camera, view, start)[0])
            states[name] = start[0], slope @ scatter @ slope.T
            continue
        state, covariance = states[name]
        predicted = project(camera, view, state[None])[0]
        if not np.isfinite(predicted).all():
            continue
        slope = jacobian(camera, view, state[None])[0]
        innovation = seen.pixels[i] - predicted
        spread = slope @ covariance @ slope.T + scatter
        if innovation @ np.linalg.solve(spread, innovation) > 9.21:
            continue
        gain = covariance @ slope.T @ np.linalg.inv(spread)
        states[name] = state + gain @ innovation, (np.eye(2) - gain @ slope) @ covariance
    return states


@dataclass(frozen=True)
class Outcome:
    """Errors along the pipe (N,) and whether the ellipse holds the truth (N,), filter and smoother; seconds."""

    filtered: Array
    smoothed: Array
    held_filter: NDArray[np.bool_]
    held: NDArray[np.bool_]
    distance: Array
    angle_error: Array
    seconds: float
    scale_error: float
    iterations: int
    converged: bool
    slips: int


def one_run(seed: int, settings: Settings, given: bool) -> Outcome:
    """Simulate, filter and smooth one drive; ``given``: f*R is told, else only the length."""
    rng = np.random.default_rng(seed)
    truth = FOCAL_RADIUS * (1 + rng.normal(0, settings.focal_known if given else settings.nominal_std))
    drive = simulate(rng, settings, truth)
    filtered = plain_filter(drive.run, FOCAL_RADIUS)
    if given:
        constraints = Constraints(focal_radius=Known(FOCAL_RADIUS, settings.focal_known * FOCAL_RADIUS))
    else:
        length = settings.length + rng.normal(0, settings.length_std)
        constraints = Constraints(length=Known(length, settings.length_std))
    noise = Noise(centre_std=settings.centre_px, axis_std=settings.axis)
    started = time.process_time()
    result = smooth(drive.run, constraints, noise)
    seconds = time.process_time() - started

    def compare(state: Array, covariance: Array, truth: Array) -> tuple[float, float]:
        error = state - truth
        error[1] = (error[1] + np.pi) % (2 * np.pi) - np.pi
        return float(error[0]), float(error @ np.linalg.solve(covariance, error))

    before = np.array([compare(*filtered[mark.id], drive.landmarks[mark.id]) for mark in result.landmarks]).reshape(-1, 2)
    after = np.array(
        [compare(np.array([mark.chainage, mark.angle]), mark.covariance, drive.landmarks[mark.id]) for mark in result.landmarks]
    ).reshape(-1, 2)
    angle = np.array([np.angle(np.exp(1j * (mark.angle - drive.landmarks[mark.id, 1]))) for mark in result.landmarks])
    return Outcome(
        before[:, 0],
        after[:, 0],
        before[:, 1] < ELLIPSE_95,
        after[:, 1] < ELLIPSE_95,
        after[:, 1],
        angle,
        seconds,
        result.scale.value - drive.scale,
        result.iterations,
        result.converged,
        len(result.slips),
    )


def binomial_interval(held: int, count: int) -> tuple[float, float]:
    """95 % interval of a share (Wilson)."""
    z, share = 1.96, held / count
    middle = (share + z**2 / (2 * count)) / (1 + z**2 / count)
    half = z * np.sqrt(share * (1 - share) / count + z**2 / (4 * count**2)) / (1 + z**2 / count)
    return middle - half, middle + half


def main() -> None:
    parser = argparse.ArgumentParser(
        prog="python -m tests.bench.landmark_smoothing", description=(__doc__ or "").splitlines()[0]
    )
    parser.add_argument("--runs", type=int, default=120)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--length", type=float, default=28.0)
    parser.add_argument("--landmarks", type=int, default=8)
    arguments = parser.parse_args()
    rows = []
    for rings in (False, True):
        settings = Settings(length=arguments.length, landmarks=arguments.landmarks, rings=rings)
        for given in (True, False):
            outcomes = [one_run(arguments.seed + k, settings, given) for k in range(arguments.runs)]
            before, after = np.concatenate([o.filtered for o in outcomes]), np.concatenate([o.smoothed for o in outcomes])
            held = np.concatenate([o.held for o in outcomes])
            held_filter = np.concatenate([o.held_filter for o in outcomes])
            low, high = binomial_interval(int(held.sum()), len(held))
            mean_before, mean_after = np.abs(before).mean(), np.abs(after).mean()
            rows.append(
                (
                    ("f, R given" if given else "length only") + (", rings" if rings else ""),
                    f"{mean_before:.3f}",
                    f"{np.sqrt((before**2).mean()):.3f}",
                    f"{mean_after:.3f}",
                    f"{np.sqrt((after**2).mean()):.3f}",
                    f"{mean_after / mean_before:.2f}",
                    percent(int(held_filter.sum()), len(held)),
                    percent(int(held.sum()), len(held)),
                    f"{100 * low:.1f} to {100 * high:.1f}",
                    f"{np.mean([o.seconds for o in outcomes]):.2f}",
                    f"{np.mean([o.iterations for o in outcomes]):.0f}",
                    sum(not o.converged for o in outcomes),
                )
            )
    print_table(
        f"{arguments.runs} runs of {arguments.length:g} m with {arguments.landmarks} landmarks, tether scale off by 2 %, three slips of 0.3 m",
        (
            "scale from",
            "filter m",
            "rms",
            "smooth m",
            "rms",
            "ratio",
            "filter 95 %",
            "held 95 %",
            "interval",
            "s",
            "iter",
            "unconv",
        ),
        rows,
    )


if __name__ == "__main__":
    main()
