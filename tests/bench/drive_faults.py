"""Figure 6, faults during a drive: a stream that dies and returns, an encoder unplugged and returned, a counter that jumps,
pictures that stall, all in one drive. What is lost, what is doubled, and is each fault on the page and in the record?

    python -m tests.bench.drive_faults [--drives 10] [--first 1]

The whole survey runs on the crawler of tests/hil (drawn pictures, a detector that errs by 1.5 px, a counter of millimetres);
landmarks, the places of the faults, their order and their sizes are drawn anew for each drive. While the encoder is gone the
crawler stands, as the page tells the operator to do.
"""

from __future__ import annotations

import argparse
import math
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tests.bench.table import print_table
from tests.hil.crawler_rig import Bench, Thing

CLASSES = ("connection", "displaced joint", "fracture", "roots", "deposit")
END_M, LANDMARKS = 8.0, 6
FAULTS = ("stream", "encoder", "jump", "stalls")
TOLD = {"stream": ("grabber_lost", "grabber_back"), "encoder": ("encoder_lost", "encoder_back"), "jump": ("encoder_jump",)}
PROMPTED = {"stream": "signal_lost", "encoder": "encoder_lost"}
WITHIN_M = 0.4
"""A landmark further off is another: what was driven while nothing told the way is known to that."""
PATIENCE_S = 300.0


@dataclass(frozen=True)
class Outcome:
    """Of one drive: the faults in their order, errors (m) of the landmarks found, how many were lost, and false or doubled;
    which faults were not told once each in the record, or not prompted on the page."""

    faults: tuple[str, ...]
    jump_m: float
    errors: tuple[float, ...]
    lost: int
    too_many: int
    untold: tuple[str, ...]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--drives", type=int, default=10)
    parser.add_argument("--first", type=int, default=1, help="seed of the first")
    arguments = parser.parse_args()
    outcomes = []
    for seed in range(arguments.first, arguments.first + arguments.drives):
        with tempfile.TemporaryDirectory(prefix="borescout-") as folder:
            outcomes.append(one_drive(seed, Path(folder)))
    print_table(
        "Drives with faults",
        ("seed", "faults in order", "jump m", "found", "lost", "too many", "worst m", "not told"),
        [
            (
                seed,
                ", ".join(one.faults),
                f"{one.jump_m:+.1f}",
                f"{len(one.errors)} of {LANDMARKS}",
                one.lost,
                one.too_many,
                f"{max(one.errors, default=math.nan):.2f}",
                ", ".join(one.untold) or "-",
            )
            for seed, one in enumerate(outcomes, arguments.first)
        ],
    )
    lost, doubled = sum(one.lost for one in outcomes), sum(one.too_many for one in outcomes)
    print(f"lost {lost}, too many {doubled}, of {LANDMARKS * len(outcomes)} landmarks in {len(outcomes)} drives;")
    print(f"faults not told once each: {sum(len(one.untold) for one in outcomes)}")


def one_drive(seed: int, folder: Path) -> Outcome:
    """A whole drive with one of each of FAULTS."""
    rng = np.random.default_rng([seed, 6])
    places = 1.0 + (END_M - 1.8) * (np.arange(LANDMARKS) + rng.uniform(0.1, 0.7, LANDMARKS)) / LANDMARKS
    things = [Thing(str(rng.choice(CLASSES)), float(place), float(rng.uniform(-np.pi, np.pi))) for place in places]
    faults = tuple(str(name) for name in rng.permutation(FAULTS))
    jump = -float(rng.uniform(0.5, 3.0))
    starts = 1.0 + (END_M - 2.5) * (np.arange(len(faults)) + rng.uniform(0, 0.6, len(faults))) / len(faults)
    box = Bench(folder / "data", things).up()
    shown: set[str] = set()
    try:
        box.moving, box.position = False, 0.0
        box.wait(lambda: abs(box.device.drive.state()["encoder"]["counts"]) < 1, PATIENCE_S)
        survey_id = box.device.drive.begin()["survey_id"]
        box.moving = True
        for fault, start in zip(faults, starts, strict=True):
            box.drive_to(float(start), PATIENCE_S)
            _befall(box, fault, jump, rng)
            if fault in PROMPTED:
                shown.add(fault)  # it waited for the prompt
        box.drive_to(END_M, PATIENCE_S)
        box.device.drive.end()
        box.finished(PATIENCE_S)
        return _judged(box.device.drive.map(survey_id), things, faults, jump, shown)
    finally:
        box.close()


def _befall(box: Bench, fault: str, jump: float, rng: np.random.Generator) -> None:
    """One fault, from its begin to its end."""

    def prompted() -> bool:
        return PROMPTED[fault] in [prompt["code"] for prompt in box.device.drive.state()["prompts"]]

    if fault == "stream":
        box.grabber.fault = "lost"
        box.wait(prompted, PATIENCE_S)
        box.grabber.fault = ""
        box.wait(lambda: box.device.drive.state()["grabber"]["state"] == "up", PATIENCE_S)
    elif fault == "encoder":
        box.encoder.fault = "unplugged"
        box.wait(lambda: box.device.drive.state()["encoder"]["state"] != "up", PATIENCE_S)
        box.moving = False
        box.wait(prompted, PATIENCE_S)
        box.encoder.fault = ""
        box.wait(lambda: box.device.drive.state()["encoder"]["state"] == "up", PATIENCE_S)
        box.moving = True
    elif fault == "jump":
        box.counter_offset += jump
    else:
        for _ in range(int(rng.integers(2, 6))):
            box.grabber.fault = "stall"
            box.wait(lambda: not box.grabber.fault, PATIENCE_S)


def _judged(found: dict[str, Any], things: Sequence[Thing], faults: tuple[str, ...], jump: float, shown: set[str]) -> Outcome:
    free = list(found["landmarks"])
    errors = []
    for thing in things:
        near = [(abs((row["chainage_m"] + row["chainage_to_m"]) / 2 - thing.chainage), k) for k, row in enumerate(free)
                if row["class"] == thing.label]  # fmt: skip
        off, k = min(near, default=(math.inf, -1))
        if off <= WITHIN_M:
            errors.append(off)
            free.pop(k)
    what = [event["what"] for event in found["faults"]]
    untold = [code for fault in faults for code in TOLD.get(fault, ()) if what.count(code) != 1]
    untold += [f"{code} on the page" for fault, code in PROMPTED.items() if fault not in shown]
    return Outcome(faults, jump, tuple(errors), len(things) - len(errors), len(free), tuple(untold))


if __name__ == "__main__":
    main()
