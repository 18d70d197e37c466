"""Can the device tell that its diameter is wrong? Every proxy of the paper's Table 2 on real frames and spoiled copies of them.

    python -m tests.bench.proxies                 all frames, plain and with each of the fixed degradations
    python -m tests.bench.proxies --frames 10     ten frames, evenly spread

Each estimate is forced; "wrong" is more than 20 mm outside the truth interval. AUROC ranks wrong before right; F1 is that of
a threshold by five-fold cross-validation (frames of one recording may fall into different folds, as in the paper).
"""

from __future__ import annotations

import argparse
import itertools
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from typing import Any

import cv2
import numpy as np

from device.diameter.result import frame_result
from tests.bench.degradations import DEGRADATIONS, degrade
from tests.bench.ranking import FOLDS, auroc, cross_validated_f1
from tests.bench.real_data import TOLERANCE_M, RealFrame, distance_outside, real_frames
from tests.bench.table import mm, percent, print_table

PLAIN = "as recorded"
SUSPICIOUS_WHEN_HIGH = {"inlier_share": -1, "mse_mm2": 1, "radius_mm": 1, "orientation": -1}
"""Settled beforehand: few inliers, a large error, a large radius, an axis across the view are suspicious; of a spread, more."""
FOLD_SEED = 0
WORKERS = 2


@dataclass(frozen=True)
class Sample:
    """One forced estimate: its origin, its distance to the truth in m (infinite where nothing was fitted), the result."""

    frame: str
    degradation: str
    error_m: float
    result: dict[str, Any]

    @property
    def wrong(self) -> bool:
        return self.error_m > TOLERANCE_M

    @property
    def fitted(self) -> bool:
        return self.result["diameter_mm"] is not None


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--frames", type=int, metavar="N", help="only N frames, evenly spread")
    parser.add_argument("--list-wrong", action="store_true", help="name every wrong estimate")
    arguments = parser.parse_args()
    frames = real_frames()
    if arguments.frames:
        frames = [frames[k] for k in np.unique(np.linspace(0, len(frames) - 1, arguments.frames).astype(int))]
    samples = measure(frames)
    _print_counts(samples)
    _print_proxies(samples)
    if arguments.list_wrong:
        _print_wrong(samples)


def measure(frames: list[RealFrame]) -> list[Sample]:
    """Every frame plain and with each degradation, each with its estimate forced; two processes."""
    with ProcessPoolExecutor(WORKERS, mp_context=get_context("spawn"), initializer=cv2.setNumThreads, initargs=(1,)) as pool:
        return list(itertools.chain.from_iterable(pool.map(_measure_frame, frames)))


def _measure_frame(frame: RealFrame) -> list[Sample]:
    samples = []
    for name in (PLAIN, *DEGRADATIONS):
        depth = frame.depth if name == PLAIN else degrade(name, frame.depth, frame.name)
        result = frame_result(depth, frame.intrinsics, frame.depth_unit_m)
        diameter_mm = result["diameter_mm"]
        error = distance_outside(None if diameter_mm is None else diameter_mm / 1000, frame.truth_m)
        samples.append(Sample(frame.name, name, error, result))
    return samples


def _print_counts(samples: list[Sample]) -> None:
    rows: list[tuple[object, ...]] = []
    for name in (PLAIN, *DEGRADATIONS):
        group = [s for s in samples if s.degradation == name]
        accepted = [s for s in group if s.result["verdict"] == "accept"]
        rows.append(
            (
                name,
                len(group),
                sum(not s.fitted for s in group),
                sum(s.fitted and s.wrong for s in group),
                len(accepted),
                sum(s.wrong for s in accepted),
            )
        )
    rows.append(("all", *(sum(int(str(row[column])) for row in rows) for column in range(1, 6))))
    header = ("frames", "number", "nothing fitted", "wrong > 20 mm", "accepted", "accepted and wrong")
    print_table("Real frames and their fixed degradations, estimates forced", header, rows)


def _print_proxies(samples: list[Sample]) -> None:
    fitted = [s for s in samples if s.fitted]
    wrong = np.array([s.wrong for s in fitted])
    rows = []
    for name, sign in SUSPICIOUS_WHEN_HIGH.items():
        for kind in ("mean", "std"):
            rows.append(
                _row(f"{name} {kind}", [s.result["proxies"][name][kind] for s in fitted], sign if kind == "mean" else 1, wrong)
            )
    title = (
        f"Proxies for 'wrong by more than 20 mm' over {len(fitted)} fitted estimates, {int(wrong.sum())} of them wrong "
        f"(paper's Table 2; {FOLDS} folds, seed {FOLD_SEED})"
    )
    print_table(title, ("proxy", "AUROC", "F1 mean", "F1 std"), rows)
    spread = np.array([np.inf if s.result["radius_std_mm"] is None else s.result["radius_std_mm"] for s in samples])
    every = auroc(spread, [s.wrong for s in samples])
    unfitted = len(samples) - len(fitted)
    print(f"Radius std, the {unfitted} frames where nothing was fitted counted as wrong and most suspicious: AUROC {every:.3f}")


def _row(name: str, values: list[float | None], sign: int, wrong: np.ndarray[Any, np.dtype[np.bool_]]) -> tuple[str, ...]:
    # a spread that could not be had, since most resampled fits found nothing, is the most suspicious of all
    suspicion = np.array([np.inf if value is None else sign * value for value in values], dtype=np.float64)
    mean, std = cross_validated_f1(suspicion, wrong, FOLD_SEED)
    return name, f"{auroc(suspicion, wrong):.3f}", f"{mean:.2f}", f"{std:.2f}"


def _print_wrong(samples: list[Sample]) -> None:
    rows = [
        (s.frame, s.degradation, mm(s.error_m), s.result["radius_std_mm"], s.result["verdict"], ",".join(s.result["reasons"]))
        for s in sorted(samples, key=lambda s: -(s.result["radius_std_mm"] or 0))
        if s.fitted and s.wrong
    ]
    print_table("Wrong estimates", ("frame", "degradation", "error mm", "radius std mm", "verdict", "reasons"), rows)
    right = [s for s in samples if s.fitted and not s.wrong]
    worst = sorted(right, key=lambda s: -(s.result["radius_std_mm"] or 0))[:15]
    rows = [(s.frame, s.degradation, mm(s.error_m), s.result["radius_std_mm"], s.result["verdict"], "") for s in worst]
    print_table(
        "Right estimates with the largest radius std",
        ("frame", "degradation", "error mm", "radius std mm", "verdict", ""),
        rows,
    )
    print(percent(len(right), len(samples)), "right")


if __name__ == "__main__":
    main()
