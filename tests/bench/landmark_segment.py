"""Figure 3: the CCTV paper's segment rebuilt from its real odometry and landmarks, and what else a detector may do.

    python -m tests.bench.landmark_segment                 the 28 m segment, the whole 83 m, and variations
    python -m tests.bench.landmark_segment --only segment  (or whole, variations, online)
    python -m tests.bench.landmark_segment --seeds 5 --law centroid

The truth drives smoothly through the counter's 0.1 m steps; the mapper is given the steps. Whether the counter rounds or cuts
off cannot be told from the record: ``--truth nearest`` takes a reading to mean the middle of its step, ``down`` its beginning.
"""

from __future__ import annotations

import argparse
import csv
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from estimators.detections import Detection
from estimators.landmarks.from_detections import Rig, map_detections
from estimators.landmarks.mapper import Mapper
from estimators.landmarks.projection import PipeCamera, View
from estimators.landmarks.types import Landmark, Observation
from estimators.odometry import Odometer
from tests.bench.landmark_scenes import TABLE_II, Detector, Matched, Seen, Truth, compare, detect, nearest, table_rows
from tests.bench.real_data import data_folder
from tests.bench.table import percent, print_table

Array = NDArray[np.float64]

RIG = Rig(500.0, 500.0, 360.0, 288.0, 0.3, 720, 576)
SEGMENT = slice(2499, 4300)
"""Frames 2500 to 4300: the paper's 28 m."""
FPS = 25.0
CENTRE_NOISE = 4.0
"""Error (px) of the focus of expansion in each frame."""
INVERT = np.pi / 2
INTERVAL_95 = 1.96


@dataclass
class Tally:
    """What the runs of one setting came to."""

    matched: list[Matched] = field(default_factory=list)
    false: list[Landmark] = field(default_factory=list)
    complete: int = 0
    runs: int = 0
    seconds: float = 0.0

    def add(self, truths: Sequence[Truth], landmarks: Sequence[Landmark], seconds: float) -> None:
        matched, false = compare(truths, landmarks)
        self.matched += matched
        self.false += false
        self.complete += all(m.landmark is not None for m in matched)
        self.runs += 1
        self.seconds += seconds

    def errors(self, label: str) -> tuple[Array, Array]:
        """Errors along (m) and, where the truth states the angle, around (degrees)."""
        ours = [m for m in self.matched if m.landmark is not None and m.truth.label == label]
        along = np.array([m.along for m in ours])
        return along, np.degrees([m.around for m in ours if m.truth.angle_known])

    def covered(self, label: str) -> str:
        """Of the begins and ends of what was found, the share within the 95 % interval of its own sigma, and the mean square of
        its error in sigmas."""
        found = [(m.truth, m.landmark) for m in self.matched if m.landmark is not None and m.truth.label == label]
        errors = [
            (error / std)
            for truth, one in found
            for error, std in zip((one.chainage_from - truth.low, one.chainage_to - truth.high), one.ends_std, strict=True)
        ]
        square = np.square(errors)
        return f"{percent(int((square < INTERVAL_95**2).sum()), len(errors))}, {square.mean():.2f}" if errors else "-"

    def found(self, label: str) -> str:
        ours = [m for m in self.matched if m.truth.label == label]
        return f"{sum(m.landmark is not None for m in ours)}/{len(ours)}"


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--only", choices=("segment", "whole", "variations", "online"))
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first", type=int, default=0, help="seed of the first")
    parser.add_argument("--law", choices=("anywhere", "centroid", "middle"), help="what the detector makes of a long deposit")
    parser.add_argument("--truth", choices=("nearest", "down"), help="what the counter's readings mean")
    arguments = parser.parse_args()
    laws = [arguments.law] if arguments.law else ["anywhere", "centroid", "middle"]
    means = [arguments.truth] if arguments.truth else ["nearest", "down"]
    camera = f"f {RIG.fx:.0f} px, {RIG.width} x {RIG.height}, R {RIG.radius} m"
    print(f"{camera}; seen from 3 m ahead until out of the picture (at the crown {nearest(RIG, INVERT):.2f} m);")
    print(
        f"noise 15 px, error of the focus of expansion {CENTRE_NOISE:.0f} px a frame; false: no landmark of that class within"
    )
    print("1 m and 45 degrees; landmarks of the last 0.5 m, not yet passed, do not count.")
    if arguments.only in (None, "segment"):
        record("Frames 2500 to 4300 (28 m)", SEGMENT, arguments.seeds, arguments.first, laws, means)
    if arguments.only in (None, "online"):
        online(min(arguments.seeds, 20))
    if arguments.only in (None, "whole"):
        record("The whole 83 m", slice(0, None), max(1, arguments.seeds // 5), arguments.first, laws, means)
    if arguments.only in (None, "variations"):
        variations(max(1, arguments.seeds // 2))


# ---- the paper's pipe


def recorded() -> tuple[Array, list[Truth]]:
    """What the counter showed in each frame (m), and the landmarks. A landmark stands at the readings of the frames that are
    marked with it; deposits lie in the invert where the record has no angle, connections at 10 o'clock to 2 o'clock."""
    path = data_folder().parent / "cctv_pipe1" / "sewerPipe_groundTruthAnomaly.csv"
    with path.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    shown = np.array([float(row["Distance"]) for row in rows])
    truths: list[Truth] = []
    for label, column in (("connection", "Connection"), ("deposit", "Deposit")):
        marked = np.array([row[column] == "1" for row in rows])
        edges = np.flatnonzero(np.diff(marked.astype(int), prepend=0, append=0))
        for first, after in zip(edges[::2], edges[1::2], strict=True):
            text = rows[first][f"{column}_theta"]
            if text:
                angle = -np.radians(float(text))  # counted the other way round than in the picture
            else:
                angle = INVERT if label == "deposit" else -INVERT + 0.3 * (len(truths) % 5 - 2)
            truths.append(Truth(label, shown[first], shown[after - 1], float(angle), bool(text)))
    return shown, truths


def smooth(shown: Array, means: str) -> Array:
    """A drive that makes the counter show this: evenly from each step to the next, a step falling between two frames."""
    first = np.flatnonzero(np.diff(shown, prepend=-1.0)) - 0.5
    value = shown[np.ceil(first).astype(int)] - (0.05 if means == "nearest" else 0.0)
    end = shown[-1] + (0.0 if means == "nearest" else 0.05)
    return np.interp(np.arange(len(shown)), np.append(first, len(shown) - 1), np.append(value, end))


def scene(part: slice, means: str, law: str, seed: int) -> tuple[Array, Array, list[Truth], Seen, Array]:
    """Positions, what the counter showed, truths, detections, and the centres (n, 2) as the mapper is given them."""
    shown, everything = recorded()
    positions, shown = smooth(shown, means)[part], shown[part]
    truths = [t for t in everything if t.low >= positions[0] and t.low < positions[-1] - 0.5]
    rng = np.random.default_rng(seed)
    seen = detect(RIG, positions, truths, Detector(TABLE_II, law=law), rng)
    centres = np.array([RIG.cx, RIG.cy]) + rng.normal(0, CENTRE_NOISE, (len(positions), 2))
    return positions, shown, truths, seen, centres


def record(title: str, part: slice, seeds: int, first: int, laws: Sequence[str], means: Sequence[str]) -> None:
    """The figure: found, false, errors, for each reading of what the record leaves open."""
    rows = []
    reached: dict[str, list[int]] = {}
    for law in laws:
        for mean in means:
            tally = Tally()
            for seed in range(first, first + seeds):
                positions, shown, truths, seen, centres = scene(part, mean, law, seed)
                for label in TABLE_II:
                    counts = reached.setdefault(label, [0, 0, 0])
                    counts[0] += sum(name == label and k >= 0 for name, k in zip(seen.label, seen.truth, strict=True))
                    counts[1] += seen.label.count(label)
                    counts[2] += seen.visible[label]
                started = time.process_time()
                times = np.arange(len(positions)) / FPS
                landmarks = map_detections(table_rows(seen, shown, times, centres), RIG)
                tally.add(truths, landmarks, time.process_time() - started)
            rows.append(_row(f"{law}, {mean}", tally))
            print(f"  {rows[-1][0]}: {rows[-1][1]} complete, {rows[-1][4]} false a run", flush=True)
    print_table(f"{title}, {seeds} seeds", _HEADER, rows)
    print_table(
        "Precision and recall reached (Table II)",
        ("class", "precision", "", "recall", ""),
        [
            (label, percent(right, all_), f"({TABLE_II[label][0]:.2f})", percent(right, visible), f"({TABLE_II[label][1]:.2f})")
            for label, (right, all_, visible) in reached.items()
        ],
    )


_HEADER = (
    "deposits show, counter", "complete", "connections", "deposits", "false a run",
    "connections m", "worst", "deg", "worst", "95 %, z^2", "deposits m", "worst", "deg", "95 %, z^2", "s a run",
)  # fmt: skip


def _row(name: str, tally: Tally) -> tuple[str, ...]:
    cells = [name, f"{tally.complete}/{tally.runs}", tally.found("connection"), tally.found("deposit")]
    cells.append(f"{len(tally.false) / tally.runs:.2f}")
    for label in ("connection", "deposit"):
        along, around = tally.errors(label)
        cells += [f"{along.mean():.3f}", f"{along.max():.2f}"] if len(along) else ["-", "-"]
        if label == "connection":
            cells += [f"{around.mean():.1f}", f"{around.max():.1f}"] if len(around) else ["-", "-"]
        else:
            cells += [f"{around.mean():.1f}"] if len(around) else ["-"]
        cells.append(tally.covered(label))
    return (*cells, f"{tally.seconds / tally.runs:.1f}")


def online(seeds: int) -> None:
    """The segment live: only what has been seen so far, the counter extrapolated between its steps, no second look."""
    tally = Tally()
    camera = PipeCamera(RIG.fx, RIG.fy, RIG.radius, RIG.width, RIG.height)
    for seed in range(seeds):
        positions, shown, truths, seen, centres = scene(SEGMENT, "nearest", "anywhere", seed)
        started = time.process_time()
        mapper, odometer = Mapper(camera), Odometer(0.1)
        frames: list[list[Detection]] = [[] for _ in positions]
        for frame, (u, v), label in zip(seen.frame, seen.pixels, seen.label, strict=True):
            frames[frame].append(Detection(float(u), float(v), label))
        for k in range(len(positions)):
            odometer.add(k / FPS, float(shown[k]))
            where = odometer.at(k / FPS)
            view = View(where.chainage, (float(centres[k, 0]), float(centres[k, 1])))
            mapper.update(Observation(k, k / FPS, view, tuple(frames[k]), where.std, CENTRE_NOISE))
        mapper.finish()
        tally.add(truths, mapper.landmarks(with_sightings=False), time.process_time() - started)
    print_table(f"The segment live (mapper alone), {seeds} seeds", _HEADER, [_row("anywhere, nearest", tally)])


# ---- other pipes, detectors, drives


@dataclass(frozen=True)
class Case:
    """A setting of the variations: what differs from the paper's."""

    rig: Rig = RIG
    detector: Detector = field(default_factory=lambda: Detector(TABLE_II))
    speed: float = 0.0155
    length: float = 20.0
    connections: int = 6
    step: float = 0.0
    stops: int = 0
    back: bool = False
    pair: bool = False
    empty: bool = False


def _worse(precision: float, recall: float) -> dict[str, tuple[float, float]]:
    return {label: (p * precision, r * recall) for label, (p, r) in TABLE_II.items()}


BASE = Detector(TABLE_II)
CASES: dict[str, Case] = {
    "as the paper's": Case(),
    "noise 5 px": Case(detector=replace(BASE, noise=5.0)),
    "noise 25 px": Case(detector=replace(BASE, noise=25.0)),
    "precision x 0.7": Case(detector=replace(BASE, table=_worse(0.7, 1))),
    "precision x 0.5": Case(detector=replace(BASE, table=_worse(0.5, 1))),
    "recall x 0.7": Case(detector=replace(BASE, table=_worse(1, 0.7))),
    "recall x 0.55": Case(detector=replace(BASE, table=_worse(1, 0.55))),
    "bursts of 20 to 40": Case(detector=replace(BASE, burst=(20, 40))),
    "trembling bursts": Case(detector=replace(BASE, jitter=15.0)),
    "radius 0.1 m": Case(rig=replace(RIG, radius=0.1)),
    "radius 0.6 m, seen from 5 m": Case(rig=replace(RIG, radius=0.6), detector=replace(BASE, sees=5.0)),
    "f 300 px": Case(rig=replace(RIG, fx=300.0, fy=300.0)),
    "f 800 px": Case(rig=replace(RIG, fx=800.0, fy=800.0)),
    "1280 x 720, f 900": Case(rig=Rig(900.0, 900.0, 640.0, 360.0, 0.3, 1280, 720)),
    "seen from 1.5 m": Case(detector=replace(BASE, sees=1.5)),
    "seen from 5 m": Case(detector=replace(BASE, sees=5.0)),
    "5 mm a frame": Case(speed=0.005, length=12.0),
    "50 mm a frame": Case(speed=0.05),
    "counter steps 0.1 m": Case(step=0.1),
    "four long stops, steps": Case(stops=4, step=0.1),
    "back and forth, steps": Case(back=True, step=0.1),
    "a pair 0.3 m apart": Case(pair=True),
    "twenty connections": Case(connections=20),
    "no landmarks at all": Case(empty=True, detector=replace(BASE, absent_rate=0.25)),
    "deposits: middle": Case(detector=replace(BASE, law="middle")),
    "deposits: centroid": Case(detector=replace(BASE, law="centroid")),
}


def variations(seeds: int) -> None:
    """Random pipes: one thing after the other is not as in the paper."""
    rows = []
    for name, case in CASES.items():
        tally = Tally()
        for seed in range(seeds):
            rng = np.random.default_rng([seed, 3])
            truths = _pipe(case, rng)
            positions = _drive(case, rng)
            seen = detect(case.rig, positions, truths, case.detector, rng)
            shown = np.round(positions / case.step) * case.step if case.step else positions
            started = time.process_time()
            landmarks = map_detections(table_rows(seen, shown, np.arange(len(shown)) / FPS), case.rig)
            tally.add(truths, landmarks, time.process_time() - started)
        rows.append(_row(name, tally))
        print(f"  {rows[-1][0]}: {rows[-1][1]} complete", flush=True)
    print_table(f"Random pipes, {seeds} seeds each", ("what differs", *_HEADER[1:]), rows)


def _pipe(case: Case, rng: np.random.Generator) -> list[Truth]:
    if case.empty:
        return []
    spots = [(float(c), float(a)) for c, a in zip(
        rng.uniform(3.5, case.length - 1.0, case.connections), rng.uniform(-np.pi, np.pi, case.connections), strict=True
    )]  # fmt: skip
    if case.pair:
        middle = case.length / 2
        spots = [spot for spot in spots if abs(spot[0] - middle) > 1.0] + [(middle, -2.4), (middle + 0.3, -0.8)]
    kept: list[Truth] = []
    for chainage, angle in spots:
        clear: Callable[[Truth], bool] = lambda t, c=chainage, a=angle: (  # noqa: E731
            abs(t.low - c) > 0.5 or abs((t.angle - a + np.pi) % (2 * np.pi) - np.pi) > 1.0
        )
        if all(clear(truth) for truth in kept):
            kept.append(Truth("connection", chainage, chainage, angle))
    start = float(rng.uniform(4.0, case.length - 6.0))
    return [*kept, Truth("deposit", start, start + float(rng.uniform(0.3, 3.5)), INVERT)]


def _drive(case: Case, rng: np.random.Generator) -> Array:
    positions = np.arange(0.0, case.length, case.speed)
    if case.stops:
        at = np.sort(rng.integers(0, len(positions), case.stops))
        positions = np.insert(positions, np.repeat(at, 300), np.repeat(positions[at], 300))
    if case.back:
        turn, reach = len(positions) // 2, int(4.0 / case.speed)
        positions = np.concatenate([positions[:turn], positions[turn - reach : turn][::-1], positions[turn - reach :]])
    return positions


if __name__ == "__main__":
    main()
