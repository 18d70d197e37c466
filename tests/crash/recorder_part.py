"""The recorder under a power cut: pictures, readings and notes as they come, and what can be read again after recovery."""

from __future__ import annotations

import time
from pathlib import Path
from random import Random

import numpy as np

from device.recorder import Shelf
from device.recorder.policy import DiskPolicy
from device.recorder.reader import open_recording
from device.recorder.samples import Picture
from drivers.depth.base import DepthFrame
from drivers.encoder.base import Reading
from estimators.pinhole import Intrinsics
from tests.crash.marks import Promises
from tests.crash.shim import mark

IGNORED = (".recovering",)
ANY_DISK = DiskPolicy(0, 0, 0)
STEP_S = 0.02
EACH_SURVEY = 60
PART_BYTES = 600_000
"""Parts are short here, so that a workload has some."""
_CAMERA = Intrinsics(64, 48, 40.0, 40.0, 31.5, 23.5, "none", (0.0, 0.0, 0.0, 0.0, 0.0))


class RecorderWork:
    """One survey after the other; each step is what a camera, a grabber, an encoder and a survey send in a moment."""

    def __init__(self, folder: Path, rng: Random) -> None:
        self._shelf = Shelf(folder / "recordings", ANY_DISK, part_bytes=PART_BYTES)
        self._shelf.recover_all()
        self._rng = rng
        self._number = EACH_SURVEY * rng.randrange(10**6)
        self._begin()

    def _begin(self) -> None:
        self._survey = self._shelf.begin(1 + self._number // EACH_SURVEY, {"kind": "test"})
        for file in self._survey.status().files:
            mark("shown", f"recording {file}", True)

    def step(self) -> None:
        self._number += 1
        number, rng = self._number, self._rng
        if number % EACH_SURVEY == 0:
            self._survey.close()
            self._begin()
        now = time.monotonic_ns()
        depth = np.frombuffer(rng.randbytes(2 * 64 * 48), np.uint16).reshape(48, 64)
        for topic, sample in (
            ("/camera", DepthFrame(depth, _CAMERA, 0.001, now, number)),
            ("/cctv", Picture(rng.randbytes(rng.randrange(1000, 9000)), now, number)),
            ("/tether", Reading(float(number), now)),
            ("/notes", {"number": number}),
        ):
            mark("offered", f"{topic} {number}")
            if not self._survey.write(topic, sample):
                raise RuntimeError(f"{topic} {number} was dropped: {self._survey.status()}")
        time.sleep(STEP_S)

    def close(self) -> None:
        self._shelf.close()


def check(folder: Path, promises: Promises) -> list[str]:
    """What is wrong with the recordings in ``folder`` once the box has recovered them."""
    shelf = Shelf(folder / "recordings", ANY_DISK)
    if not shelf.folder.exists():
        promises.raw(set())
        return []
    shelf.recover_all()
    found, wrong = set[str](), []
    for path in sorted(shelf.folder.glob("*.mcap")):
        try:
            for entry in open_recording(path).entries():
                if key := _key(entry.topic, entry.sample):
                    found.add(key)
        except Exception as error:  # noqa: BLE001 - whatever it is, this recording cannot be read
            if f"recording {path.name}" in promises.shown:  # else nothing of it had been synced yet
                wrong.append(f"unreadable: {path.name} ({path.stat().st_size} bytes), {error}")
    promises.raw(found)
    return [*wrong, *(f"{key} was never recorded" for key in sorted(found - promises.offered.keys())[:3])]


def _key(topic: str, sample: object) -> str:
    if isinstance(sample, DepthFrame | Picture):
        return f"{topic} {sample.number}"
    if isinstance(sample, Reading):
        return f"{topic} {sample.value:.0f}"
    if isinstance(sample, dict) and topic == "/notes":
        return f"{topic} {sample['number']}"
    return ""
