"""Figures 1 and 2: classes by descriptor, Bayes, semantics and fused scans (Tables 3 and 4); map, edges, position, consistency.

    python -m tests.bench.structure_recognition --first 100           the paper's structure, seeds 100 to 109, all 245 scans
    python -m tests.bench.structure_recognition --seeds 3 --rate 0.1  fewer seeds, a scan every 10 s on the same way
    python -m tests.bench.structure_recognition --first 200 --seeds 30 --scans 10   only the beginning: for NEES, see below
    python -m tests.bench.structure_recognition --variations          ten other structures (seeds 1 to 10)
    python -m tests.bench.structure_recognition --plot OUT.png        uncertainty volumes as in Figs. 11 and 12
    python -m tests.bench.structure_recognition --first 100 --json F  keeps each seed that is done; goes on where it was stopped

A seed with all scans takes about two minutes of one core. Accuracy and F1 are counted over sightings, as in the paper; each
with what was believed at that scan. NEES of the position hardly changes after the first scans, since the map is fixed to where
they put it: a run is one draw of it, and many beginnings say more of the filter than few whole ways.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from device.json_text import dumps
from device.structure.database import shipped_knowledge
from device.structure.run import Run, VirtualChamber, run_events
from device.structure.scores import accuracy, confusion_tables, errors, f1_scores, matching, mean_f1, scores
from device.structure.told import warnings
from drivers.virtual.chamber.structure import Structure, load_structure, structure_of
from drivers.virtual.chamber.variations import varied
from estimators.structure.types import CLASSES
from tests.bench.real_data import fail
from tests.bench.table import print_table

STAGES = {
    "descriptor": "descriptor",
    "bayes": "with Bayes",
    "semantic": "with semantics",
    "fused descriptor": "descriptor, fused scans",
    "fused": "all, fused scans",
}

Volumes = dict[int, list[tuple[float, float]]]


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--first", type=int, default=1, help="the first seed: 1 to 9 served to build it, report on 100 and on")
    parser.add_argument("--scans", type=int, help="only the first so many scans of each")
    parser.add_argument("--rate", type=float, help="scans a second; the structure's own if not given")
    parser.add_argument("--noise", type=float, help="range noise (m); the structure's own if not given")
    parser.add_argument("--variations", action="store_true", help="another structure for each seed")
    parser.add_argument("--json", type=Path, help="save the scores of each seed")
    parser.add_argument("--plot", type=Path, help="save the uncertainty volumes of the last run")
    arguments = parser.parse_args()
    asked = {
        "first": arguments.first,
        "scans": arguments.scans,
        "rate": arguments.rate,
        "noise": arguments.noise,
        "variations": arguments.variations,
    }
    every = saved(arguments.json, asked)
    for seed in range(arguments.first, arguments.first + arguments.seeds):
        if seed not in [one["seed"] for one in every]:
            structure = adjusted(varied(seed) if arguments.variations else load_structure(), arguments.rate, arguments.noise)
            run, told, volumes = one_run(structure, seed, arguments.scans)
            every.append({"seed": seed, "asked": asked, **told})
            if arguments.json is not None:
                arguments.json.write_text(dumps(every), encoding="utf-8")
            if arguments.plot is not None:
                plot_volumes(arguments.plot, run, volumes)
        rows = [map_row(one) for one in every]
        print_table(f"Map after seed {seed}", MAP_HEADER, rows)
    recognition({stage: np.sum([one["tables"][stage] for one in every], axis=0) for stage in STAGES})
    right = [one["objects_right"] for one in every]
    there = sum(one["objects_found"] for one in every)
    print_table(
        "Class of each object in the end",
        ["", *right[0]],
        [["right of " + str(there), *(str(sum(one[stage] for one in right)) for stage in right[0])]],
    )
    consistency([np.array(one["nees"]) for one in every])


def saved(path: Path | None, asked: dict[str, Any]) -> list[dict[str, Any]]:
    """The seeds that a run before has saved. Ends the program where they were of something else."""
    if path is None or not path.exists():
        return []
    every: list[dict[str, Any]] = json.loads(path.read_text(encoding="utf-8"))
    if any(one["asked"] != asked for one in every):
        fail(f"{path} holds a run with other options: name another file.")
    return every


def adjusted(structure: Structure, rate: float | None, noise: float | None) -> Structure:
    """The structure with another scanner."""
    description = structure.description
    changes = {name: value for name, value in (("rate_hz", rate), ("noise_m", noise)) if value is not None}
    scanner = description.scanner.model_copy(update=changes)
    return structure_of(description.model_copy(update={"scanner": scanner}))


def one_run(structure: Structure, seed: int, scans: int | None = None) -> tuple[Run, dict[str, Any], Volumes]:
    """A whole way around: run, what is told of it, and for each feature its volume (Sec. 5.2) after each scan."""
    chamber = VirtualChamber(structure, seed)
    volumes: Volumes = {}

    def note(run: Run) -> None:
        for number in run.mapper.slam.features:
            volumes.setdefault(number, []).append((run.track.times[-1], run.mapper.slam.volume(number)))

    run = run_events(chamber.mapper(shipped_knowledge()), chamber.events(scans), note)
    states = run.mapper.smooth()
    found = run.mapper.result()
    told = scores(run, found, chamber, states)
    told["tables"] = {s: table.tolist() for s, table in confusion_tables(run, matching(found, structure), structure).items()}
    told["nees"] = [round(float(value), 4) for value in errors(run, chamber)["nees"]]
    told["inconsistent"] = run.mapper.doubts.unexpected
    told["beside"] = run.mapper.doubts.beside / max(run.mapper.doubts.near, 1)
    told["warnings"] = warnings(run.mapper)
    told["seconds_a_scan"] = float(np.mean(run.seconds))
    return run, told, volumes


MAP_HEADER = (
    "seed",
    "pipes",
    "false",
    "objects",
    "false",
    "edge F1",
    "RMS (m)",
    "smoothed (m)",
    "dead reck. (m)",
    "ratio",
    "NEES",
    "inconsistent",
    "beside",
    "warnings",
    "s a scan (CPU)",
)


def map_row(told: dict[str, Any]) -> list[object]:
    """One line of the table of maps."""
    return [
        told["seed"],
        f"{told['pipes_found']} of {told['pipes_true']}",
        told["pipes_false"],
        f"{told['objects_found']} of {told['objects_true']}",
        told["objects_false"],
        f"{told['edge_f1']:.3f}",
        f"{told['position_rms_m']:.4f}",
        f"{told['smoothed_rms_m']:.4f}",
        f"{told['dead_reckoning_rms_m']:.3f}",
        f"{told['dead_reckoning_rms_m'] / told['position_rms_m']:.1f}",
        f"{told['nees_mean']:.2f}",
        told["inconsistent"],
        f"{told['beside']:.3f}",
        len(told["warnings"]),
        f"{told['seconds_a_scan']:.2f}",
    ]


def consistency(nees: list[NDArray[np.float64]]) -> None:
    """Whether the filter's covariance of the position is as large as its errors: NEES has 3 degrees of freedom in each run."""
    count = len(nees)
    length = min(len(one) for one in nees)
    mean = np.mean([one[:length] for one in nees], axis=0)
    low, high = chi2.ppf([0.025, 0.975], 3 * count) / count
    every = np.concatenate(nees)
    print_table(
        f"NEES of position, {count} runs (3 expected; over the runs, at each scan, in {low:.2f} to {high:.2f} at 95 %)",
        ["mean", "least", "median", "greatest", "below the band", "in it", "above it", "single ones below 7.81"],
        [
            [
                f"{every.mean():.2f}",
                *(f"{np.percentile(mean, share):.2f}" for share in (0, 50, 100)),
                *(f"{np.mean(part):.1%}" for part in (mean < low, (mean >= low) & (mean <= high), mean > high)),
                f"{(every < chi2.ppf(0.95, 3)).mean():.1%}",
            ]
        ],
    )


def recognition(tables: dict[str, NDArray[np.int64]]) -> None:
    """Tables 3 and 4."""
    rows: list[list[object]] = []
    for stage, title in STAGES.items():
        table = tables[stage]
        rows.append(
            [title, f"{accuracy(table):.3f}", f"{mean_f1(table):.3f}", *(f"{f1:.2f}" for f1 in f1_scores(table)), table.sum()]
        )
    print_table("Recognition over sightings (Table 4)", ["stage", "accuracy", "mean F1", *CLASSES, "sightings"], rows)
    for stage, title in STAGES.items():
        shares = tables[stage] / np.maximum(tables[stage].sum(axis=1, keepdims=True), 1)
        print_table(
            f"Confusion (%), {title} (Table 3; rows: actual)",
            ["", *CLASSES],
            [[label, *(f"{100 * share:.0f}" for share in shares[k])] for k, label in enumerate(CLASSES)],
        )


def plot_volumes(path: Path, run: Run, volumes: Volumes) -> None:
    """Figs. 11 and 12."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, both = plt.subplots(1, 2, figsize=(12, 4), sharex=True)
    found = run.mapper.result()
    numbers = ([pipe.number for pipe in found.pipes], [thing.number for thing in found.objects])
    for axes, title, ours in zip(both, ("pipes", "objects"), numbers, strict=True):
        for number in ours:
            axes.plot(*np.array(volumes[number]).T, lw=1)
        axes.set(title=f"Uncertainty volumes of {title}", xlabel="time (s)", ylabel="sum of log eigenvalues")
    figure.tight_layout()
    figure.savefig(path, dpi=110)


if __name__ == "__main__":
    main()
