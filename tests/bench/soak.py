"""The soak: virtual surveys one after the other, pages open, a fault every minute; memory, handles, threads, drops.

    make soak                                   two hours
    python -m tests.bench.soak --minutes 45     or as long as you like

The box runs in a process of its own and is looked at from outside every ten seconds. The slope is fitted to what comes after
the first third: until then caches, heaps and the longest survey find their size.
"""

from __future__ import annotations

import argparse
import csv
import itertools
import random
import shutil
import tempfile
import threading
import time
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np
import psutil

from tests.bench.faulty_box import FaultyBox, faulty_box
from tests.bench.table import print_table

FAULTS = {
    "camera": ("freeze", "disconnect", "garbage", "all zero", "wrong size", "never comes", "hang", "late"),
    "grabber": ("freeze", "disconnect", "garbage", "wrong size", "never comes", "hang", "stall"),
    "encoder": ("freeze", "disconnect", "garbage", "slip", "jump back", "never comes", "hang", "stall"),
}
SAMPLE_S = 10.0
FAULT_S = (2.0, 8.0)


@dataclass(frozen=True)
class Sample:
    """The box at one moment. ``own_mb`` is memory that no other process shares, ``workers_mb`` that of its children."""

    at_s: float
    own_mb: float
    workers_mb: float
    handles: int
    threads: int


@dataclass
class Run:
    """What a soak came to."""

    samples: list[Sample] = field(default_factory=list)
    ended: dict[str, int] = field(default_factory=dict)
    faults: int = 0
    requests: int = 0
    refused: int = 0
    before: dict[str, Any] = field(default_factory=dict)
    after: dict[str, Any] = field(default_factory=dict)
    alive: bool = True
    """The process at the end is the one of the beginning."""

    def slope(self, value: str) -> tuple[float, float]:
        """Change an hour of a field of ``Sample`` after the first third, and its standard error."""
        end = self.samples[-1].at_s
        late = [sample for sample in self.samples if sample.at_s >= end / 3]
        hours = np.array([sample.at_s / 3600 for sample in late])
        values = np.array([float(getattr(sample, value)) for sample in late])
        if len(late) < 3:
            return float("nan"), float("nan")
        centred = hours - hours.mean()
        slope = float(centred @ values / (centred @ centred))
        rest = values - values.mean() - slope * centred
        return slope, float(np.sqrt(rest @ rest / (len(late) - 2) / (centred @ centred)))


def sample(process: psutil.Process, begun: float) -> Sample:
    """One look at the process and its workers."""
    children = 0.0
    for child in process.children(recursive=True):
        try:
            children += child.memory_full_info().uss
        except psutil.Error:
            continue  # it has just been replaced
    with process.oneshot():
        own = process.memory_full_info().uss
        return Sample(time.monotonic() - begun, own / 1e6, children / 1e6, process.num_fds(), process.num_threads())


class Soak:
    """One run over ``minutes``, with a fault every ``fault_every_s`` seconds, on a box that is up."""

    def __init__(self, box: FaultyBox, minutes: float, fault_every_s: float, drive_s: float, seed: int = 1) -> None:
        self._box = box
        self._length_s = minutes * 60
        self._fault_every_s = fault_every_s
        self._drive_s = drive_s
        self._rng = random.Random(seed)
        self._over = threading.Event()
        self._stopped = ""
        self.run = Run()

    def go(self) -> Run:
        """Everything at once: surveys here, faults, pages and samples in threads of their own."""
        run, begun = self.run, time.monotonic()
        run.before = self._counts()
        helpers = [threading.Thread(target=one, daemon=True) for one in (self._break, self._look)]
        page = self._box.listen(self._length_s + 60)
        for helper in helpers:
            helper.start()
        surveys = threading.Thread(target=self._survey, daemon=True)
        surveys.start()
        while (time.monotonic() - begun) < self._length_s and self._box.alive and surveys.is_alive():
            run.samples.append(sample(self._box.process, begun))
            self._over.wait(min(SAMPLE_S, self._length_s / 12))
        if not surveys.is_alive():
            raise SystemExit(f"The surveys stopped after {(time.monotonic() - begun) / 60:.0f} minutes: {self._stopped}")
        self._over.set()
        for helper in (*helpers, surveys):
            helper.join(90)
        for sensor in FAULTS:
            self._box.mend(sensor)
        self._box.wait(lambda: all(one["state"] in ("up", "resting") for one in self._box.ask("/health")["sensors"]), 60)
        run.samples.append(sample(self._box.process, begun))
        run.after = self._counts()
        run.alive = self._box.alive
        assert page.daemon
        return run

    def _survey(self) -> None:
        try:
            self._survey_on()
        except (AssertionError, RuntimeError, OSError) as error:
            self._stopped = str(error)

    def _survey_on(self) -> None:
        """A measurement, a drive, and so on; every fourth drive is given up."""
        for number in itertools.count():
            if self._over.is_set():
                return
            self._post("/measure", {"frames": 20})
            self._idle(lambda: self._box.ask("/status")["survey"]["state"] == "idle", 90)
            self._post("/drive", {"direction": "downstream"})
            self._over.wait(self._drive_s)
            self._post("/drive/cancel" if number % 4 == 3 else "/drive/end", {})
            self._idle(lambda: self._box.ask("/drive")["state"] == "idle", 120)

    def _idle(self, condition: Any, within_s: float) -> None:
        if not self._box.wait(condition, within_s):
            raise RuntimeError(f"a survey did not end within {within_s:.0f} s, see {self._box.log}")

    def _break(self) -> None:
        """One fault after the other, now of this sensor, now of that."""
        turns = itertools.cycle(FAULTS)
        while not self._over.wait(self._rng.uniform(0.5, 1.0) * self._fault_every_s):
            sensor = next(turns)
            cure = self._rng.choice(("none", "restart", "reset"))
            self._box.fail(sensor, self._rng.choice(FAULTS[sensor]), self._rng.uniform(*FAULT_S), cure)
            self.run.faults += 1
            self._over.wait(FAULT_S[1])
            self._box.mend(sensor)  # what is unplugged is plugged in again

    def _look(self) -> None:
        """A phone on the measuring page and one on the driving page."""
        while not self._over.wait(0.5):
            for path in ("/picture/depth.jpg", "/drive/picture.jpg?overlay=1", "/status", "/health", "/surveys?limit=5"):
                self._post(path, None, "GET")

    def _post(self, path: str, body: dict[str, Any] | None, method: str = "POST") -> None:
        self.run.requests += 1
        try:
            self._box.ask(path, method, body)
        except AssertionError as refusal:
            if ": 403 " in str(refusal):
                raise RuntimeError(f"the box does not let us: {refusal}") from None
            self.run.refused += 1  # a camera that is lost cannot measure, and says so

    def _counts(self) -> dict[str, Any]:
        health = self._box.ask("/health")
        surveys = self._box.ask("/surveys?limit=200")
        states = [one["state"] for one in surveys]
        counted: dict[str, Any] = {state: states.count(state) for state in sorted(set(states))}
        for one in health["sensors"]:
            counted |= {f"{one['role']} {what}": one[what] for what in ("drops", "bad", "reconnects")}
        return {**counted, "workers replaced": self._box.ask("/status")["workers_replaced"]}


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.bench.soak", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--minutes", type=float, default=120.0)
    parser.add_argument("--fault-every", type=float, default=60.0, metavar="SECONDS")
    parser.add_argument("--folder", type=Path, help="keep the box's data, log and samples here")
    options = parser.parse_args()
    if options.folder is not None and options.folder.exists() and any(options.folder.iterdir()):
        parser.error(f"{options.folder} is not empty: the soak wants a box of its own")
    folder = options.folder or Path(tempfile.mkdtemp(prefix="borescout-soak-"))
    try:
        with faulty_box(folder) as box:
            box.wait(lambda: box.sensor("camera")["state"] == "up", 60)
            run = Soak(box, options.minutes, options.fault_every, drive_s=35.0).go()
            report(run)
            if options.folder is not None:
                keep(run, folder / "samples.csv")
    finally:
        if options.folder is None:
            shutil.rmtree(folder, ignore_errors=True)


def keep(run: Run, path: Path) -> None:
    """Every look at the process, for whoever asks when it grew."""
    with path.open("w", newline="") as file:
        rows = csv.DictWriter(file, [one.name for one in fields(Sample)])
        rows.writeheader()
        rows.writerows(asdict(one) for one in run.samples)


def report(run: Run) -> None:
    """The tables of one run."""
    first, last = run.samples[0], run.samples[-1]
    third = next(one for one in run.samples if one.at_s >= last.at_s / 3)
    names = {"own_mb": "memory, MB", "workers_mb": "workers' memory, MB", "handles": "file handles", "threads": "threads"}
    rows = []
    for key, name in names.items():
        slope, error = run.slope(key)
        values = [f"{getattr(one, key):.0f}" for one in (first, third, last)]
        most = max(getattr(one, key) for one in run.samples)
        rows.append((name, *values, f"{most:.0f}", f"{slope:+.1f} ± {error:.1f}"))
    title = f"{last.at_s / 60:.0f} minutes, {run.faults} faults, {run.requests} requests, {run.refused} of them refused"
    print_table(title, ("", "first", "after a third", "last", "most", "slope an hour"), rows)
    keys = sorted({*run.before, *run.after})
    print_table("Counts", ("", "before", "after"), [(key, run.before.get(key, 0), run.after.get(key, 0)) for key in keys])
    print(f"\nthe daemon {'ran through' if run.alive else 'did NOT run through'}")


if __name__ == "__main__":
    main()
