"""A disk that fills: ``python -m tests.crash.full FOLDER --points N``, started with the shim, which plays the disk.

First every n-th write of the store's work finds no room, for a while; then a disk of a few megabytes fills with raw data while
findings go on being saved.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import logging
import shutil
from pathlib import Path
from random import Random
from typing import Any

from device.errors import DeviceError
from device.recorder import Shelf
from device.recorder.policy import MB, DiskPolicy
from device.recorder.reader import open_recording
from device.recorder.samples import Picture
from tests.crash import store_part
from tests.crash.marks import Promises
from tests.crash.shim import loaded, read_log
from tests.crash.store_part import StoreWork

STEPS = 14
GONE_FOR = 6
"""Writes that find no room, one after the other: somebody deletes something then."""


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--points", type=int, default=20)
    given = parser.parse_args()
    logging.disable(logging.CRITICAL)
    print(json.dumps({**every_nth_write(given.folder, given.points), **small_disk(given.folder)}))


def every_nth_write(folder: Path, points: int) -> dict[str, Any]:
    """The n-th write finds the disk full, for ``points`` values of n over a day of the store's work."""
    log = folder / "log"
    _, whole = _day(folder / "whole", log, 0)
    wrong, refused, promised = list[str](), 0, 0
    for point in range(points):
        data = folder / f"full-{point}"
        number = 1 + point * whole // points
        refused += _day(data, log, number, half=bool(point % 2))[0]
        promises = Promises()
        promises.take(read_log(log))
        promised += len(promises.shown)
        wrong += [f"write {number}: {sentence}" for sentence in store_part.check(data, promises)]
        shutil.rmtree(data)
    return {"points": points, "writes": whole, "refused": refused, "promises": promised, "wrong": wrong}


def _day(data: Path, log: Path, full_at: int, half: bool = False) -> tuple[int, int]:
    """A day of the store's work; how many of its steps were refused for want of room, and how often it wrote."""
    shim = loaded()
    log.unlink(missing_ok=True)
    data.mkdir(parents=True)
    shim.crash_watch(str(data).encode(), str(log).encode())
    shim.crash_fail(full_at or -1, GONE_FOR, half)
    refused = 0
    work: StoreWork | None = None
    for _ in range(STEPS):
        try:
            work = work or StoreWork(data, Random(5))
            work.step()
        except DeviceError:
            refused += 1
    with contextlib.suppress(DeviceError):
        if work is not None:
            work.close()
    writes = int(shim.crash_writes())
    shim.crash_fail(-1, 0, 0)
    shim.crash_watch(b"/nowhere", b"/dev/null")
    return refused, writes


def small_disk(folder: Path) -> dict[str, Any]:
    """A disk with 90 MB left and a policy to match: raw data prunes itself, oldest first, then ends; findings go on until
    there is nothing left at all."""
    shim, data, log = loaded(), folder / "small", folder / "log"
    log.unlink(missing_ok=True)
    data.mkdir()
    shim.crash_watch(str(data).encode(), b"/dev/null")
    shim.crash_room(90 * MB)
    policy = DiskPolicy(keep_free=70 * MB, stop_free=60 * MB, findings_free=20 * MB)
    shelf = Shelf(data / "recordings", policy, part_bytes=2 * MB)
    work = StoreWork(data, Random(5))
    rng = Random(6)
    ever: list[str] = []
    refused_raw = 0
    for survey in range(1, 9):
        recorder = shelf.begin(survey, {})
        for number in range(60):
            if not recorder.write("/cctv", Picture(rng.randbytes(100_000), number, number)):
                refused_raw += 1
        recorder.close()
        ever += [name for name in recorder.status().files if name not in ever]
        work.measure()
    kept = sorted(path.name for path in shelf.folder.glob("*.mcap"))
    for name in kept:
        list(open_recording(shelf.folder / name).entries())  # raises where what was kept cannot be read
    free_after_raw = int(shim.crash_room_left())
    recording = {}
    for left_mb in (50, 25):  # somebody else fills the disk
        shim.crash_room(left_mb * MB)
        recorder = shelf.begin(100 + left_mb, {})
        recording[left_mb] = recorder.recording
        work.measure()
        recorder.close()
    saved = len(work.store.surveys.summaries(None, 100, None))
    work.close()
    shim.crash_room(-1)
    shim.crash_watch(b"/nowhere", b"/dev/null")
    return {
        "recordings_made": len(ever),
        "recordings_kept": len(kept),
        "newest_kept": kept == sorted(ever)[-len(kept) :],
        "free_after_raw_mb": round(free_after_raw / MB, 1),
        "raw_at_50_mb": recording[50],
        "raw_at_25_mb": recording[25],
        "surveys_saved": saved,
        "surveys_measured": 10,
    }


if __name__ == "__main__":
    main()
