"""Hostile clients at `borescout serve --virtual` while it measures: what an honest phone and the measurement notice of each.

    python -m tests.bench.hostile [--seconds 10] [--attack NAME]

Each attack (tests/hostile.py) runs beside measurements of 50 frames, one after the other; a phone asks for the status on new
connections meanwhile. Before each attack the same is done in peace, for comparison.
"""

from __future__ import annotations

import argparse
import os
import statistics
import sys
import tempfile
import threading
import time
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import psutil

from tests.bench.daemon import running
from tests.bench.real_data import fail
from tests.bench.table import print_table
from tests.hostile import ATTACKS, under_attack
from tests.pairing import Pass, ask, pair

FRAMES = 50
PAUSE_S = 0.1
LIMIT_S = 120.0


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seconds", type=float, default=10.0, help="at least, of each attack")
    parser.add_argument("--attack", choices=ATTACKS, help="this one alone")
    chosen = parser.parse_args()
    rows, lost = [], 0
    with (
        tempfile.TemporaryDirectory(prefix="borescout-hostile-") as folder,
        running(Path(folder), ["--virtual"]) as (process, port),
    ):
        paired = pair(port)
        _wait_for_camera(port, paired)
        box = psutil.Process(process.pid)
        for attack in [chosen.attack] if chosen.attack else ATTACKS:
            calm = _stretch(port, paired, chosen.seconds / 2, None)
            hit = _stretch(port, paired, chosen.seconds, attack)
            lost += calm.lost + hit.lost
            print(f"  {attack}: {len(hit.measured_s)} measurements, {hit.lost} lost, {hit.unanswered} unanswered", flush=True)
            threads, files = box.num_threads(), box.num_fds()
            rows.append(
                (
                    attack,
                    " ".join(f"{what} {count}" for what, count in sorted(hit.done.items())),
                    f"{statistics.median(calm.measured_s):.1f}",
                    f"{statistics.median(hit.measured_s):.1f}",
                    f"{len(hit.measured_s)}/{hit.lost}",
                    f"{1000 * np.percentile(calm.answers_s, 95):.0f}",
                    f"{1000 * np.percentile(hit.answers_s, 95):.0f}",
                    f"{hit.unanswered}",
                    f"{threads}/{files}",
                )
            )
    header = (
        "attack", "what it did", "calm: s", "hit: s", "saved/lost", "calm: ms", "hit: ms", "unanswered", "threads/files"
    )  # fmt: skip
    print_table(
        f"Measurements of {FRAMES} frames (median s), and answers on new connections (95th percentile ms)", header, rows
    )
    print(f"  Measurements lost: {lost} (wanted: 0). Load of the machine: {os.getloadavg()}")
    sys.exit(1 if lost else 0)


class _Stretch:
    """What was seen in one stretch of time."""

    def __init__(self) -> None:
        self.measured_s: list[float] = []
        self.answers_s: list[float] = []
        self.unanswered = 0
        self.lost = 0
        self.done: dict[str, int] = {}


def _stretch(port: int, paired: Pass, seconds: float, attack: str | None) -> _Stretch:
    seen, stop = _Stretch(), threading.Event()
    asker = threading.Thread(target=_ask, args=(port, paired, seen, stop))
    with under_attack(port, attack) if attack else nullcontext() as attacker:
        asker.start()
        until = time.monotonic() + seconds
        while time.monotonic() < until or not seen.measured_s:
            _measure(port, paired, seen)
        stop.set()
        asker.join()
        seen.done = attacker.end() if attacker else {}
    return seen


def _measure(port: int, paired: Pass, seen: _Stretch) -> None:
    begun = time.monotonic()
    status, answer = ask(port, paired, "POST", "/api/v1/measure", {"frames": FRAMES})
    if status != 202:
        fail(f"A measurement could not be begun: {answer}")
    while True:
        status, survey = ask(port, paired, "GET", f"/api/v1/surveys/{answer['survey_id']}")
        if status == 200 and survey["state"] == "saved" and survey["recordings"]:
            seen.measured_s.append(time.monotonic() - begun)
            return
        gone = ask(port, paired, "GET", "/api/v1/status")[1]["survey"]
        if time.monotonic() - begun > LIMIT_S or (status == 404 and gone["state"] == "idle"):
            seen.lost += 1
            seen.measured_s.append(time.monotonic() - begun)
            return
        time.sleep(0.2)


def _ask(port: int, paired: Pass, seen: _Stretch, stop: threading.Event) -> None:
    while not stop.is_set():
        begun = time.monotonic()
        try:
            ask(port, paired, "GET", "/api/v1/status", patience_s=10.0)
            seen.answers_s.append(time.monotonic() - begun)
        except OSError:
            seen.unanswered += 1
        stop.wait(PAUSE_S)


def _wait_for_camera(port: int, paired: Pass) -> None:
    deadline = time.monotonic() + LIMIT_S
    while ask(port, paired, "GET", "/api/v1/live")[1] is None:
        if time.monotonic() > deadline:
            fail("The virtual camera does not come up.")
        time.sleep(0.5)


if __name__ == "__main__":
    main()
