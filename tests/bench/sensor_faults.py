"""Sensors killed, frozen and flooded with garbage while pages are open and a drive goes on: when it is shown, how it ends.

    python -m tests.bench.sensor_faults [--faults 200]

Each sensor gets its faults in a thread of its own, one after the other, over all three at the same time. "Shown" is the time
from the command to the first answer of the health page that does not call the sensor up; "recovered" the time from the end of
the fault until it is up again; "lost" counts how often the sensor was declared lost meanwhile, in a sentence.
"""

from __future__ import annotations

import argparse
import itertools
import shutil
import tempfile
import threading
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from tests.bench.faulty_box import FaultyBox, faulty_box
from tests.bench.table import print_table

FAULTS = {
    "killed": "disconnect",
    "frozen": "freeze",
    "garbage": "garbage",
    "silent": "never comes",
    "hung": "hang",
}
KNOWN = {
    "camera": ("killed", "frozen", "garbage", "silent", "hung"),
    "grabber": ("killed", "frozen", "garbage", "silent", "hung"),
    "encoder": ("killed", "garbage", "silent", "hung"),
}
"""A tether that stands still is no fault that anybody could see at the encoder; the drive tells it from the picture, see
``encoder_stands``."""
SHOWN_WITHIN_S = 2.0
RECOVERED_WITHIN_S = 60.0
LASTS_S = (2.5, 5.0)


@dataclass(frozen=True)
class Outcome:
    """One fault: seconds until it was shown (None: never) and until the sensor was up again (None: never)."""

    sensor: str
    fault: str
    shown_s: float | None
    recovered_s: float | None
    declared_lost: bool


def one_fault(box: FaultyBox, sensor: str, fault: str, lasts_s: float) -> Outcome:
    """Inject one fault into a sensor that is up, and see how it goes."""
    if not box.wait(lambda: box.sensor(sensor)["state"] == "up", RECOVERED_WITHIN_S):
        return Outcome(sensor, fault, None, None, False)
    begun = time.monotonic()
    box.fail(sensor, FAULTS[fault])
    shown_s: float | None = None
    lost = False
    while time.monotonic() - begun < max(lasts_s, SHOWN_WITHIN_S + 0.5):
        state = box.sensor(sensor)["state"]
        lost |= state == "lost"
        if shown_s is None and state != "up":
            shown_s = time.monotonic() - begun
        time.sleep(0.05)
    box.mend(sensor)
    ended = time.monotonic()
    up = box.wait(lambda: box.sensor(sensor)["state"] == "up", RECOVERED_WITHIN_S)
    return Outcome(sensor, fault, shown_s, time.monotonic() - ended if up else None, lost)


def inject(box: FaultyBox, faults: int) -> list[Outcome]:
    """So many faults, spread over the sensors, with a drive under way all the time."""
    outcomes: list[Outcome] = []
    over = threading.Event()

    def work(sensor: str, count: int) -> None:
        for number, fault in enumerate(itertools.islice(itertools.cycle(KNOWN[sensor]), count)):
            outcomes.append(one_fault(box, sensor, fault, LASTS_S[number % 2]))

    def drive() -> None:
        """The virtual drive ends by itself; the grabber is only read while one goes on."""
        while not over.is_set():
            if box.ask("/drive")["state"] == "idle":
                box.ask("/drive", "POST", {"direction": "downstream"})
            over.wait(2.0)

    driver = threading.Thread(target=drive, daemon=True)
    driver.start()
    shares = [faults // 3 + (faults % 3 > k) for k in range(3)]
    threads = [threading.Thread(target=work, args=(sensor, share)) for sensor, share in zip(KNOWN, shares, strict=True)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    over.set()
    driver.join(10)
    return outcomes


def encoder_stands(box: FaultyBox) -> float | None:
    """Seconds until the drive says that the counter stands while the picture moves; None: it never does."""
    box.fail("encoder", "freeze")
    begun = time.monotonic()
    said = box.wait(lambda: any(prompt["code"] == "slip" for prompt in box.ask("/drive")["prompts"]), 15)
    box.mend("encoder")
    return time.monotonic() - begun if said else None


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.bench.sensor_faults", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--faults", type=int, default=200)
    options = parser.parse_args()
    folder = Path(tempfile.mkdtemp(prefix="borescout-faults-"))
    try:
        with faulty_box(folder) as box:
            box.listen(24 * 3600)
            outcomes = inject(box, options.faults)
            alive = box.alive
        report(outcomes, alive)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def report(outcomes: list[Outcome], alive: bool) -> None:
    """The table, one row a sensor and kind of fault."""
    rows = []
    groups = sorted({(outcome.sensor, outcome.fault) for outcome in outcomes})
    for sensor, fault in groups:
        some = [one for one in outcomes if (one.sensor, one.fault) == (sensor, fault)]
        shown = [one.shown_s for one in some if one.shown_s is not None]
        back = [one.recovered_s for one in some if one.recovered_s is not None]
        rows.append(
            (
                f"{sensor} {fault}",
                len(some),
                sum(seconds <= SHOWN_WITHIN_S for seconds in shown),
                f"{max(shown):.2f}" if shown else "-",
                len(back),
                f"{max(back):.1f}" if back else "-",
                sum(one.declared_lost for one in some),
            )
        )
    header = ("", "faults", f"shown in {SHOWN_WITHIN_S:.0f} s", "slowest, s", "recovered", "slowest, s", "declared lost")
    print_table(f"{len(outcomes)} faults", header, rows)
    late = [one for one in outcomes if one.shown_s is None or one.shown_s > SHOWN_WITHIN_S]
    gone = [one for one in outcomes if one.recovered_s is None and not one.declared_lost]
    print(f"\nnot shown within {SHOWN_WITHIN_S:.0f} s: {len(late)}; neither recovered nor declared lost: {len(gone)}")
    if late:
        print("late:", dict(Counter(f"{one.sensor} {one.fault}" for one in late)))
    print(f"the daemon {'ran through' if alive else 'did NOT run through'}")


if __name__ == "__main__":
    main()
