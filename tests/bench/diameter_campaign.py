"""The virtual campaign: many recordings of virtual pipes, measured as the survey measures, and what came of them.

It mirrors the paper's field campaign (74 pipes, 101 recordings of 50 frames); thresholds are fitted on it and figures shown.
"""

from __future__ import annotations

import itertools
import json
import math
import os
import pickle
import sys
import time
from collections.abc import Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

import click
import numpy as np

from device.diameter.verdict import TOLERANCE_MM, Thresholds, reasons_to_refuse, shipped
from drivers.virtual.campaign import VirtualRecording, campaign
from estimators.frame import FrameEstimate, estimate_frame
from estimators.recording import ErrorModel, RecordingEstimate, combine

BANDS_MM = (0, 200, 300, 400, 600, 900, 1200)
"""Bands of interior diameter in the tables, as in the paper's Fig. 6."""


@dataclass(frozen=True)
class Outcome:
    """One measured recording beside its truth (m). ``frames`` allow another error model without measuring again."""

    seed: int
    recording_id: str
    pipe_id: str
    position: str
    troubles: tuple[str, ...]
    truth: float
    estimate: RecordingEstimate
    frames: tuple[FrameEstimate, ...]

    @property
    def error_mm(self) -> float:
        """Distance of the median diameter from the truth; infinite where nothing was fitted."""
        return math.inf if self.estimate.fitted == 0 else 1000 * abs(self.estimate.diameter - self.truth)

    @property
    def right(self) -> bool:
        """Within the paper's tolerance."""
        return self.error_mm <= TOLERANCE_MM


def measure(recording: VirtualRecording, seed: int, frames: int) -> Outcome:
    """Render and measure one recording. Runs in a worker process."""
    estimates = [
        replace(estimate_frame(depth, intrinsics, unit, seed=k), profile=None)
        for k, (depth, intrinsics, unit) in enumerate(recording.frames(frames))
    ]
    _, errors = shipped()
    return Outcome(
        seed,
        recording.id,
        recording.pipe_id,
        recording.position,
        tuple(recording.troubles),
        recording.truth_diameter_m,
        replace(combine(estimates, errors), typical=None),
        tuple(estimates),
    )


def run(seeds: Sequence[int], recordings: int, frames: int, workers: int) -> Iterable[Outcome]:
    """Measure whole campaigns, one worker process per core, in no particular order but with the same numbers on every run."""
    jobs = [(recording, seed) for seed in seeds for recording in campaign(seed, recordings)]
    with ProcessPoolExecutor(workers, initializer=_one_thread) as pool:
        futures = [pool.submit(measure, recording, seed, frames) for recording, seed in jobs]
        for future in futures:
            yield future.result()


def _one_thread() -> None:
    import cv2  # in the worker: the thread count is the process's own

    cv2.setNumThreads(1)


def with_errors(outcomes: Sequence[Outcome], errors: ErrorModel) -> list[Outcome]:
    """The same measurements under another error model."""
    return [replace(o, estimate=replace(combine(o.frames, errors), typical=None)) for o in outcomes]


def refused(outcome: Outcome, thresholds: Thresholds) -> tuple[str, ...]:
    """Reasons to refuse this recording."""
    return reasons_to_refuse(outcome.estimate, thresholds)


def chosen_per_pipe(outcomes: Sequence[Outcome], thresholds: Thresholds) -> list[Outcome]:
    """For each pipe the recording with the smaller radius std, accepted ones first (section 5.3 of the paper)."""
    pipes: dict[tuple[int, str], list[Outcome]] = {}
    for outcome in outcomes:
        pipes.setdefault((outcome.seed, outcome.pipe_id), []).append(outcome)

    def unsureness(outcome: Outcome) -> tuple[bool, float]:
        std = outcome.estimate.radius_std
        return bool(refused(outcome, thresholds)), std if math.isfinite(std) else math.inf

    return [min(group, key=unsureness) for group in pipes.values()]


def table(outcomes: Sequence[Outcome], thresholds: Thresholds) -> list[dict[str, object]]:
    """One row per diameter band and one for all: shares in per cent, errors in mm."""
    rows = []
    edges = [*itertools.pairwise(BANDS_MM), (BANDS_MM[0], BANDS_MM[-1])]
    for low, high in edges:
        band = [o for o in outcomes if low < 1000 * o.truth <= high]
        if not band:
            continue
        accepted = [o for o in band if not refused(o, thresholds)]
        right = [o for o in band if o.right]
        fitted = [o for o in band if o.estimate.fitted]
        covered = [o for o in fitted if o.estimate.interval[0] <= o.truth <= o.estimate.interval[1]]
        covered_accepted = [o for o in accepted if o.estimate.interval[0] <= o.truth <= o.estimate.interval[1]]
        rows.append(
            {
                "band_mm": f"{low}-{high}",
                "recordings": len(band),
                "within_20_mm": _share(len(right), len(band)),
                "accepted": len(accepted),
                "accepted_wrong": sum(not o.right for o in accepted),
                "right_accepted": _share(sum(o.right for o in accepted), len(right)),
                "median_error_mm": round(float(np.median([o.error_mm for o in band])), 2),
                "covered": _share(len(covered), len(fitted)),
                "covered_accepted": _share(len(covered_accepted), len(accepted)),
                "half_interval_mm": round(
                    float(np.median([500 * (o.estimate.interval[1] - o.estimate.interval[0]) for o in fitted])), 2
                )
                if fitted
                else None,
            }
        )
    return rows


def _share(part: int, whole: int) -> float | None:
    return round(100 * part / whole, 1) if whole else None


def save(outcomes: Sequence[Outcome], path: Path) -> None:
    """Keep the measurements, for fitting thresholds without rendering again. Only for files that this program wrote itself."""
    path.write_bytes(pickle.dumps(list(outcomes)))


def load(path: Path) -> list[Outcome]:
    """What ``save`` wrote."""
    loaded: list[Outcome] = pickle.loads(path.read_bytes())
    return loaded


@click.command("virtual-campaign")
@click.option("--seed", default=1000, show_default=True, help="First seed; the thresholds were fitted on seeds below 1000.")
@click.option("--campaigns", default=1, show_default=True, type=click.IntRange(1), help="How many campaigns, one seed each.")
@click.option("--recordings", default=101, show_default=True, type=click.IntRange(1), help="Recordings in a campaign.")
@click.option("--frames", default=50, show_default=True, type=click.IntRange(1), help="Frames in a recording.")
@click.option("--workers", default=os.cpu_count() or 1, show_default=True, type=click.IntRange(1), help="Processes.")
@click.option("--save", "save_to", type=click.Path(dir_okay=False, path_type=Path), help="Keep the measurements here.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON instead of tables.")
def virtual_campaign(
    seed: int, campaigns: int, recordings: int, frames: int, workers: int, save_to: Path | None, as_json: bool
) -> None:
    """Measure a campaign of virtual pipes and show how right and how careful the survey is."""
    thresholds, _ = shipped()
    started = time.monotonic()
    seeds = range(seed, seed + campaigns)
    outcomes: list[Outcome] = []
    with click.progressbar(length=campaigns * recordings, label="Measuring", file=sys.stderr) as bar:
        for outcome in run(seeds, recordings, frames, workers):
            outcomes.append(outcome)
            bar.update(1)
    if save_to is not None:
        save(outcomes, save_to)
    pipes = chosen_per_pipe(outcomes, thresholds)
    rows = table(outcomes, thresholds)
    if as_json:
        click.echo(json.dumps({"seeds": list(seeds), "recordings": rows, "pipes": table(pipes, thresholds)}))
        return
    click.echo(f"Recordings of {frames} frames, seeds {seeds[0]} to {seeds[-1]}, {time.monotonic() - started:.0f} s")
    _print_table(rows)
    click.echo(f"\nPipes, the surer of their recordings each: {len(pipes)}")
    _print_table(table(pipes, thresholds)[-1:])
    for o in sorted(outcomes, key=lambda o: -o.error_mm):
        reasons = refused(o, thresholds)
        if not o.right or reasons:
            error = "nothing fitted" if math.isinf(o.error_mm) else f"{o.error_mm:6.1f} mm off"
            flag = "WRONG AND ACCEPTED " if not o.right and not reasons else ""
            click.echo(
                f"{flag}{o.seed}/{o.recording_id} {1000 * o.truth:.0f} mm {error}, {', '.join(reasons) or 'accepted'}; "
                f"{', '.join(o.troubles) or 'no trouble'}"
            )


def _print_table(rows: Sequence[dict[str, object]]) -> None:
    if not rows:
        return
    names = list(rows[0])
    click.echo("  ".join(f"{name:>{max(len(name), 9)}}" for name in names))
    for row in rows:
        click.echo("  ".join(f"{'-' if row[name] is None else row[name]!s:>{max(len(name), 9)}}" for name in names))
