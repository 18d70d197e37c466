"""How well the distance burned into real pictures is read, and what that costs: ``python -m tests.bench.osd``.

``$BORESCOUT_DATA/cctv_run`` against a truth read by eye in every picture of it: as read from the picture, as the filter decides
it live, and as it decides it over the whole run; for the part that is used (from the last reset on, 7.0 to 53) and for all.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable, Iterable
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.encoder.osd import OsdFilter, OsdReader
from tests.bench.real_data import fail
from tests.bench.table import percent, print_table

TRUTH = """
60 13.8 13.8 13.8 13.8 0.0 0.0 0.0 13.9 14.0 14.0 14.0 14.0 14.0 14.0 14.0 14.0
76 14.0 14.0 14.0 14.0 14.0 14.0 14.0 14.0 14.0 14.0 14.0 14.0 14.0 0.0 0.0 1.2
92 1.2 1.2 0.0 0.0 0.0 0.0 0.1 0.2 0.3 0.3 0.3 0.6 0.7 0.7 0.7 0.5
108 0.0 -0.2 -0.5 -0.7 -0.7/-0.8 -0.9 -1.2 -1.2 -1.2 -1.3 -1.6 -1.5 -1.5 -1.4 -1.4 -1.4
124 -1.4 -1.3 -1.2 -1.2 -1.2 7.0 7.0 7.0 7.2 7.7/7.8 8.4 9.0/9.1 9.4 9.6 10.2 10.7
140 11.2 11.7/11.8 12.4 13.0 13.5 13.9 14.3 14.8/14.9 15.5 15.9 16.5/16.6 17.3 17.8 18.3 18.6 19.1
156 19.6 20.1 20.6 21.3 22.0 22.5 23.0 23.5 24.2 24.7 25.5 26.3 26.8 27.4 27.8 28.4
172 29.0 29.9 30.5 31.1 31.6 32.2 32.8 33.5/33.6 34.2/34.3 34.7 35.1 35.3 35.3 35.3 35.4 35.4
188 35.4 35.4 35.4 35.3 35.3 35.3 35.4 35.4 35.4 35.6 35.8 36.2 36.8 37.3 38.0 38.6
204 39.2 39.5 40.0/40.1 40.5/40.6 41.1 41.9 42.4 43.1 43.6 43.9 43.9 43.9 43.9 43.9 43.9 43.9
220 43.9 43.9 43.9 44.9 45.4 45.9 46.5 47.1 47.6/47.7 48.0 48.5 48.9 49.4 49.5 49.5 49.5
236 49.5 49.5 49.5 49.5 49.5 49.5 49.5 50.4 50.9/51.0 51.6 52.1 52.4 52.4 52.4 52.5 52.5
252 52.5 52.5 52.6 52.6 52.8 52.9 52.9 53.0 53.0 53.0 53.0 53.0 53.0 53.0 53.0 53.0
268 53.0 53.1 53.1 53.1 53.1 53.1 53.1 53.1 53.1 53.1
"""
"""Second of the first picture of a line, then what one reads in it and the following ones. Two values where the counter turned
between the two fields of an interlaced picture: each field shows one of them."""
USED_FROM_S = 129
LAID_OVER = (64, 65, 66)
"""Seconds in which a text "WATER LEVEL 0000.0" stands in the counter's place: read, and not to be believed."""


def truth() -> dict[int, tuple[float, ...]]:
    """Second -> what the picture shows, metres as far as the counter's unit is the metre."""
    values: dict[int, tuple[float, ...]] = {}
    for line in TRUTH.strip().splitlines():
        start, *texts = line.split()
        for offset, text in enumerate(texts):
            values[int(start) + offset] = tuple(float(value) for value in text.split("/"))
    return values


def pictures(folder: Path) -> dict[int, NDArray[np.uint8]]:
    """Second -> picture (H, W, 3) BGR."""
    paths = sorted(folder.glob("*.jpg"), key=lambda path: int(path.stem))
    if not paths:
        fail(f"There are no pictures in {folder}: set BORESCOUT_DATA to the folder of the shared recordings.")
    return {int(path.stem) // 1000: np.asarray(cv2.imread(str(path)), dtype=np.uint8) for path in paths}


def counted(distances: dict[int, float | None], known: dict[int, tuple[float, ...]], seconds: Iterable[int]) -> list[object]:
    """Right, wrong and absent ones of these seconds, and the share that is right."""
    chosen = list(seconds)
    absent = sum(distances[second] is None for second in chosen)
    right = sum(any(abs((distances[second] or 0.0) - value) < 1e-6 for value in known[second]) for second in chosen
                if distances[second] is not None)  # fmt: skip
    return [len(chosen), right, len(chosen) - right - absent, absent, percent(right, len(chosen))]


def timed(work: Callable[[], object]) -> tuple[float, float]:
    """Milliseconds of this thread's computing, and on the clock."""
    computing, clock = time.thread_time(), time.perf_counter()
    work()
    return (time.thread_time() - computing) * 1e3, (time.perf_counter() - clock) * 1e3


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.bench.osd", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--searches", type=int, default=8, help="pictures for the cost of a whole search")
    searches = parser.parse_args().searches
    cv2.setNumThreads(1)
    run, known = pictures(Path(os.environ.get("BORESCOUT_DATA", "")) / "cctv_run"), truth()
    if set(run) != set(known):
        fail("The pictures of cctv_run are not those that the truth was read from.")

    reader, sieve = OsdReader(), OsdFilter()
    raw: dict[int, float | None] = {}
    live: dict[int, float | None] = {}
    cost: dict[int, tuple[float, float, bool]] = {}
    for second, image in run.items():
        before, began, clock = reader.searches, time.thread_time(), time.perf_counter()
        text = reader.read(image)
        cost[second] = (time.thread_time() - began) * 1e3, (time.perf_counter() - clock) * 1e3, reader.searches > before
        raw[second], live[second] = text.distance, sieve.add(float(second), text).distance
    whole = {round(one.time_s): one.distance for one in sieve.smoothed()}

    # what is laid over the counter is read right and rightly not believed: it counts in the first line only
    used, shown = [second for second in run if second >= USED_FROM_S], [second for second in run if second not in LAID_OVER]
    rows = [
        ["7.0 to 53.1, read", *counted(raw, known, used)],
        ["7.0 to 53.1, live", *counted(live, known, used)],
        ["7.0 to 53.1, whole run", *counted(whole, known, used)],
        ["all pictures, read", *counted(raw, known, run)],
        ["but for laid-over text, live", *counted(live, known, shown)],
        ["but for laid-over text, whole run", *counted(whole, known, shown)],
    ]
    print_table("Distances of cctv_run", ["pictures", "n", "right", "wrong", "none", "share"], rows)
    print(f"  laid-over text believed: {sum(whole[second] is not None for second in LAID_OVER)} of {len(LAID_OVER)} pictures")
    print(f"  resets: {', '.join(f'{one.before:.1f} to {one.after:.1f} at {one.time_s:.0f} s' for one in sieve.resets())}")
    print(f"  step of the counter: {sieve.quantum}")

    searcher = OsdReader(look_again=0)
    searched = [
        timed(lambda image=image: searcher.read(image)) for image in list(run.values())[:: max(1, len(run) // searches)]
    ]
    fast = [(computing, clock) for computing, clock, search in cost.values() if not search]
    rows = [
        [
            name,
            len(times),
            *(f"{np.percentile([one[column] for one in times], share):.0f}" for column in (0, 1) for share in (50, 95)),
        ]
        for name, times in (("only the strip", fast), ("search of the picture", searched))
    ]
    header = ["ms a picture, one thread", "n", "computing, median", "95 %", "on the clock, median", "95 %"]
    print_table(f"Cost; {sum(search for *_, search in cost.values())} of {len(cost)} pictures were searched", header, rows)


if __name__ == "__main__":
    main()
