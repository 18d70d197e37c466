"""Items 1 to 3 of what must be shown, from outside: runs ``borescout measure --per-frame --json`` on the real frames.

    python -m tests.bench.real_frames                    run the command, then judge what it printed
    python -m tests.bench.real_frames --results FILE     judge JSON lines that were printed before

The command is given the folder; only this script reads what the manifest says of the truth.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tests.bench.real_data import TOLERANCE_M, data_folder, distance_outside, fail, truth_interval
from tests.bench.table import mm, percent, print_table

JUDGED_FOR_ACCEPTANCE = ("195mm_concrete", "200mm_PVC", "340mm", "400mm_PVC")
JUDGED_FOR_PRECISION = ("195mm_concrete", "200mm_PVC", "400mm_PVC")


@dataclass(frozen=True)
class Judged:
    """One frame: what the manifest says and what the device said. ``error_m`` is the distance outside the truth interval."""

    name: str
    pipe: str
    wall_visible: bool
    emitter: bool
    error_m: float
    result: dict[str, Any]

    @property
    def accepted(self) -> bool:
        return bool(self.result["verdict"] == "accept")

    @property
    def wrong(self) -> bool:
        return self.error_m > TOLERANCE_M


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--results", type=Path, metavar="FILE", help="JSON lines of 'borescout measure --per-frame --json'")
    arguments = parser.parse_args()
    folder = data_folder()
    lines = arguments.results.read_text() if arguments.results else _run_device(folder)
    judged = _judge(folder, lines)
    _print_forced(judged)
    _print_accepted(judged)
    _print_precision(judged)
    _print_refused(judged)
    seconds = [j.result["seconds"] for j in judged]
    print(f"\nArray to verdict: median {np.median(seconds):.3f} s, largest {max(seconds):.3f} s")


def _run_device(folder: Path) -> str:
    """What the command prints. It is shown a copy of the manifest without any word on the truth, to make sure of that."""
    with tempfile.TemporaryDirectory(prefix="borescout-blind-") as blind:
        _blind_copy(folder, Path(blind))
        command = [sys.executable, "-m", "device.cli", "measure", "--replay", blind, "--per-frame", "--json"]
        done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode != 0:
        fail(f"'borescout measure' ended with status {done.returncode}: {done.stderr.strip().splitlines()[-1:]}")
    return done.stdout


def _blind_copy(folder: Path, blind: Path) -> None:
    entries = json.loads((folder / "manifest.json").read_text())
    kept = ("depth", "recording", "depth_unit_m", "intrinsics")
    (blind / "manifest.json").write_text(json.dumps([{key: entry[key] for key in kept} for entry in entries]))
    for pipe in {Path(entry["depth"]).parts[0] for entry in entries}:
        (blind / pipe).symlink_to((folder / pipe).resolve(), target_is_directory=True)


def _judge(folder: Path, lines: str) -> list[Judged]:
    entries = {entry["depth"]: entry for entry in json.loads((folder / "manifest.json").read_text())}
    judged = []
    for line in lines.splitlines():
        result = json.loads(line)
        entry = entries.pop(result["depth"], None)
        if entry is None:
            fail(f"The command printed {result['depth']}, which is not in the manifest, or printed it twice.")
        diameter_mm = result["diameter_mm"]
        error = distance_outside(None if diameter_mm is None else diameter_mm / 1000, truth_interval(entry))
        judged.append(Judged(result["depth"], entry["pipe"], entry["wall_visible"], entry["emitter"], error, result))
    if entries:
        fail(f"The command printed nothing for {len(entries)} frames, the first of them {next(iter(entries))}.")
    return judged


def _print_forced(judged: list[Judged]) -> None:
    rows = []
    for pipe in sorted({j.pipe for j in judged}):
        group = [j for j in judged if j.pipe == pipe and j.wall_visible]
        rows.append((pipe, len(group), sum(not j.wrong for j in group), mm(float(np.median([j.error_m for j in group])))))
    visible = [j for j in judged if j.wall_visible]
    right = sum(not j.wrong for j in visible)
    rows.append(("all", len(visible), right, mm(float(np.median([j.error_m for j in visible])))))
    print_table("1. Frames with a visible wall, estimate forced", ("pipe", "frames", "within 20 mm", "median error mm"), rows)
    print(f"  {percent(right, len(visible))} within 20 mm (wanted: at least 95 %)")
    _print_names("Wrong with the estimate forced", [j for j in visible if j.wrong])


def _print_accepted(judged: list[Judged]) -> None:
    wanted = [j for j in judged if j.emitter and j.pipe in JUDGED_FOR_ACCEPTANCE]
    accepted = [j for j in wanted if j.accepted]
    wrong = [j for j in judged if j.accepted and j.wrong]
    print(f"\n  Accepted and wrong: {len(wrong)} of {sum(j.accepted for j in judged)} accepted (wanted: none)")
    print(
        f"  Emitter on, pipes 195, 200, 340, 400: {len(accepted)} of {len(wanted)} accepted, "
        f"{percent(len(accepted), len(wanted))} (wanted: at least 88 %)"
    )
    _print_names("Accepted and wrong", wrong)
    _print_names("Refused of these", [j for j in wanted if not j.accepted])


def _print_precision(judged: list[Judged]) -> None:
    rows = []
    for pipe in (*JUDGED_FOR_PRECISION, "all"):
        chosen = JUDGED_FOR_PRECISION if pipe == "all" else (pipe,)
        errors = [j.error_m for j in judged if j.accepted and j.pipe in chosen]
        if errors:
            median, high = np.percentile(errors, [50, 95])
            rows.append((pipe, len(errors), mm(median, 2), mm(high, 2), mm(max(errors), 2)))
    print_table(
        "2. Accepted frames of 195, 200, 400: distance to the truth interval (wanted: median <= 1, 95th percentile <= 3)",
        ("pipe", "frames", "median mm", "95th percentile mm", "largest mm"),
        rows,
    )
    _print_names(
        "More than 3 mm off", [j for j in judged if j.accepted and j.pipe in JUDGED_FOR_PRECISION and j.error_m > 0.003]
    )


def _print_refused(judged: list[Judged]) -> None:
    blind = [j for j in judged if not j.wall_visible]
    refused = [j for j in blind if not j.accepted]
    print(f"\n3. Frames without a visible wall: {len(refused)} of {len(blind)} refused (wanted: all), each with its reasons")
    _print_names("Accepted without a visible wall", [j for j in blind if j.accepted])
    _print_names("Refused without a visible wall", refused)


def _print_names(title: str, judged: list[Judged]) -> None:
    if judged:
        rows = [
            (
                j.name,
                j.result["diameter_mm"],
                "-" if j.error_m == float("inf") else mm(j.error_m),
                j.result["radius_std_mm"],
                j.result["verdict"],
                ",".join(j.result["reasons"]),
            )
            for j in judged
        ]
        print_table(f"{title} ({len(rows)})", ("frame", "diameter mm", "error mm", "radius std mm", "verdict", "reasons"), rows)


if __name__ == "__main__":
    main()
