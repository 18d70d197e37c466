"""Eight phones at a virtual box while a survey runs: how old events are on the page, what the survey loses.

    python -m tests.bench.phones [--rounds 6] [--seconds 20] [--survey drive] [--fps 12.5]

What the CCTV sees is drawn beforehand, since a box in a sewer does not draw: so the survey is paced by its camera, as there.
Each phone has a session, a stream of events, and fetches the picture five times a second, as the page does. Rounds without and
with phones alternate, so that what else the machine does falls on both; the loss is the median over neighbouring rounds. The
phones are one process of their own, at a lower priority: their cost is not the box's.
"""

from __future__ import annotations

import argparse
import asyncio
import itertools
import multiprocessing
import os
import statistics
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np
import psutil

from tests.bench.faulty_box import FaultyBox, faulty_box
from tests.bench.real_data import fail
from tests.bench.table import print_table
from tests.browser.fake_device import FakeDevice
from tests.browser.serving import served
from tests.pairing import Pass, ask, pair
from web_ui.app import create_app

PHONES = 8
PICTURES_HZ = 5.0
WANTED_AGE_S = 0.25
WANTED_LOSS = 0.01
START_LIMIT_S = 300.0


# --- The phones ---


@dataclass
class Phone:
    """What one phone got: ages of the survey's events and times that pictures took (s), moments of everything (s)."""

    ages: list[float] = field(default_factory=list)
    moments: list[float] = field(default_factory=list)
    pictures: list[float] = field(default_factory=list)
    faults: list[str] = field(default_factory=list)


async def _listen(port: int, paired: Pass, event: str, phone: Phone, tab: str) -> None:
    reader, _ = await _asked(port, paired, f"/api/v1/events?tab={tab}")
    sent_ns = 0
    while line := await reader.readline():
        if line.startswith(b"id: "):
            sent_ns = int(line[4:])
        elif line == f"event: {event}\n".encode() and sent_ns:
            await reader.readline()  # the page has it when it has the data
            now = time.monotonic()
            phone.ages.append(now - sent_ns / 1e9)
            phone.moments.append(now)
            sent_ns = 0


async def _look(port: int, paired: Pass, path: str, phone: Phone, offset_s: float) -> None:
    await asyncio.sleep(offset_s)
    reader, writer = await asyncio.open_connection("127.0.0.1", port, limit=2**20)
    due = time.monotonic()
    while True:
        begun = time.monotonic()
        writer.write(_request(port, paired, path))
        head = await reader.readuntil(b"\r\n\r\n")
        length = next((int(line[15:]) for line in head.split(b"\r\n") if line.lower().startswith(b"content-length:")), 0)
        await reader.readexactly(length)
        if b" 200 " in head[:15]:
            phone.pictures.append(time.monotonic() - begun)
        due = max(due + 1 / PICTURES_HZ, time.monotonic())
        await asyncio.sleep(due - time.monotonic())


def _request(port: int, paired: Pass, path: str) -> bytes:
    return f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nCookie: {paired.headers['Cookie']}\r\n\r\n".encode()


async def _asked(port: int, paired: Pass, path: str) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
    reader, writer = await asyncio.open_connection("127.0.0.1", port, limit=2**20)
    writer.write(_request(port, paired, path))
    head = await reader.readuntil(b"\r\n\r\n")
    if b" 200 " not in head[:15]:
        raise OSError(f"{path} was answered with {head[:40]!r}")
    return reader, writer


async def _hold(port: int, passes: list[Pass], event: str, picture: str, until: float) -> list[Phone]:
    phones = [Phone() for _ in passes]
    tasks = []
    for k, (paired, phone) in enumerate(zip(passes, phones, strict=True)):
        tasks.append(asyncio.create_task(_listen(port, paired, event, phone, f"bench-{k}")))
        tasks.append(asyncio.create_task(_look(port, paired, picture, phone, k / PICTURES_HZ / len(passes))))
    await asyncio.sleep(until - time.monotonic())
    for k, task in enumerate(tasks):
        if task.done() and task.exception() is not None:
            phones[k // 2].faults.append(repr(task.exception()))
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)
    return phones


def _phones(told: Connection, port: int, passes: list[Pass], event: str, picture: str) -> None:
    """The process of the phones: for each number of seconds that it is told, hold them for so long."""
    os.nice(5)
    while (seconds := told.recv()) is not None:
        told.send(asyncio.run(_hold(port, passes, event, picture, time.monotonic() + seconds)))


# --- The survey ---


class _Count:
    """Frames over several surveys, each of which counts from 0."""

    def __init__(self) -> None:
        self._of: dict[int, int] = {}

    def so_far(self, survey: int | None, frames: int) -> int:
        """All frames, with what this survey has counted by now (None: none is under way)."""
        if survey is not None:
            self._of[survey] = max(self._of.get(survey, 0), frames)
        return sum(self._of.values())


class DriveSurvey:
    """A drive through the virtual sewer, begun anew when it ends."""

    event, picture = "drive", "/api/v1/drive/picture.jpg"

    def __init__(self, port: int, paired: Pass) -> None:
        self._port, self._paired = port, paired
        self._count = _Count()

    def run(self, stop: threading.Event) -> None:
        """Keep a drive going; at its end the crawler stands, and the pictures go on."""
        while not stop.is_set():
            if ask(self._port, self._paired, "GET", "/api/v1/drive")[1]["state"] == "idle":
                ask(self._port, self._paired, "POST", "/api/v1/drive", {})
            stop.wait(0.5)

    def frames(self) -> int:
        """Pictures that went through the survey so far."""
        drive = ask(self._port, self._paired, "GET", "/api/v1/drive")[1]
        return self._count.so_far(drive["survey_id"], drive["frames"])


class DiameterSurvey:
    """Recordings of 100 frames, one after the other."""

    event, picture = "live", "/api/v1/picture/depth.jpg"

    def __init__(self, port: int, paired: Pass) -> None:
        self._port, self._paired = port, paired
        self._count = _Count()

    def run(self, stop: threading.Event) -> None:
        """Keep a measurement going."""
        while not stop.is_set():
            if ask(self._port, self._paired, "GET", "/api/v1/status")[1]["survey"]["state"] == "idle":
                ask(self._port, self._paired, "POST", "/api/v1/measure", {"frames": 100})
            stop.wait(0.05)

    def frames(self) -> int:
        """Frames measured so far."""
        survey = ask(self._port, self._paired, "GET", "/api/v1/status")[1]["survey"]
        return self._count.so_far(survey["survey_id"], survey["frames_done"])


SURVEYS: dict[str, Any] = {"drive": DriveSurvey, "diameter": DiameterSurvey}


# --- What serving costs ---


def _fake_box(told: Connection) -> None:
    """A process that serves the pages of a fake device, whose pictures and events cost nothing: what is left is serving."""
    device = FakeDevice()
    with served(create_app(device)) as port:  # type: ignore[arg-type]  # a fake with the facade's methods
        told.send(port)
        told.recv()
        device.close()


def serving(seconds: float) -> tuple[float, float, list[Phone]]:
    """Processor time a second of a server without and with phones, measured where nothing else runs in its process."""
    spawn = multiprocessing.get_context("spawn")
    ours, theirs = spawn.Pipe()
    box = spawn.Process(target=_fake_box, args=(theirs,), daemon=True)
    box.start()
    port = ours.recv()
    passes = [pair(port, name=f"Phone {k}") for k in range(PHONES)]
    to_phones, from_us = spawn.Pipe()
    phones = spawn.Process(target=_phones, args=(from_us, port, passes, "live", "/api/v1/picture/depth.jpg"), daemon=True)
    phones.start()
    process = psutil.Process(box.pid)
    costs = []
    for with_phones in (False, True):
        if with_phones:
            to_phones.send(seconds + 2)
            time.sleep(1.0)
        begun, cpu = time.monotonic(), _cpu_s(process)
        time.sleep(seconds)
        costs.append((_cpu_s(process) - cpu) / (time.monotonic() - begun))
    got = to_phones.recv()
    to_phones.send(None)
    ours.send(None)
    phones.join(10)
    box.join(10)
    return costs[0], costs[1], got


# --- Rounds ---


@dataclass
class Round:
    """Of one round: frames a second of the survey, processor time a second of the box, and what the phones got."""

    rate_hz: float
    cpu: float
    phones: list[Phone]


def _round(survey: Any, process: psutil.Process, seconds: float, told: Connection | None) -> Round:
    if told is not None:
        told.send(seconds + 2.0)
        time.sleep(1.0)  # they connect
    begun, frames, cpu = time.monotonic(), survey.frames(), _cpu_s(process)
    time.sleep(seconds)
    took = time.monotonic() - begun
    rate, cpu_share = (survey.frames() - frames) / took, (_cpu_s(process) - cpu) / took
    return Round(rate, cpu_share, told.recv() if told is not None else [])


def _cpu_s(process: psutil.Process) -> float:
    return sum(sum(one.cpu_times()[:2]) for one in (process, *process.children(recursive=True)))


def rounds(box: FaultyBox, name: str, count: int, seconds: float) -> tuple[list[Round], list[Round]]:
    """Rounds without and with phones, in turns, each pair in another order than the one before."""
    port = box.port
    passes = [pair(port, name=f"Phone {k}") for k in range(PHONES)]
    survey = SURVEYS[name](port, box.paired)
    ours, theirs = multiprocessing.get_context("spawn").Pipe()
    phones = multiprocessing.get_context("spawn").Process(
        target=_phones, args=(theirs, port, passes, survey.event, survey.picture), daemon=True
    )
    phones.start()
    stop = threading.Event()
    keeper = threading.Thread(target=survey.run, args=(stop,), daemon=True)
    keeper.start()
    _until(lambda: bool(survey.frames() > 20))
    process = box.process
    alone, together = [], []
    try:
        for k in range(count):
            for with_phones in (False, True) if k % 2 == 0 else (True, False):
                done = _round(survey, process, seconds, ours if with_phones else None)
                (together if with_phones else alone).append(done)
                print(f"  {'with' if with_phones else 'without'} phones: {done.rate_hz:.2f} frames/s", flush=True)
    finally:
        stop.set()
        keeper.join()
        ours.send(None)
        phones.join(10)
    return alone, together


def _until(check: Callable[[], bool]) -> None:
    deadline = time.monotonic() + START_LIMIT_S
    while not check():
        if time.monotonic() > deadline:
            fail(f"The survey did not begin within {START_LIMIT_S:.0f} s.")
        time.sleep(0.5)


def _report(alone: list[Round], together: list[Round], seconds: float) -> None:
    rows = [
        (
            k + 1,
            f"{a.rate_hz:.2f}",
            f"{b.rate_hz:.2f}",
            f"{100 * (1 - b.rate_hz / a.rate_hz):+.1f}",
            f"{a.cpu:.2f}",
            f"{b.cpu:.2f}",
        )
        for k, (a, b) in enumerate(zip(alone, together, strict=True))
    ]
    header = ("round", "alone, frames/s", f"{PHONES} phones", "loss %", "alone, cores", f"{PHONES} phones")
    print_table(f"Rate of the survey in rounds of {seconds:.0f} s, and processor time of the box", header, rows)
    losses = [1 - b.rate_hz / a.rate_hz for a, b in zip(alone, together, strict=True)]
    spread = statistics.stdev(losses) / len(losses) ** 0.5 if len(losses) > 1 else float("nan")
    print(
        f"  Survey loses {100 * statistics.median(losses):+.1f} % (median; mean {100 * statistics.mean(losses):+.1f} ±"
        f" {100 * spread:.1f} %; wanted: under {100 * WANTED_LOSS:.0f} %)"
    )
    noise = [abs(1 - b.rate_hz / a.rate_hz) for a, b in itertools.pairwise(alone)]
    if noise:
        print(f"  For comparison: neighbouring rounds without phones differ by {100 * statistics.median(noise):.1f} % (median)")
    phones = [phone for done in together for phone in done.phones]
    ages = np.array([age for phone in phones for age in phone.ages])
    pictures = np.array([took for phone in phones for took in phone.pictures])
    gaps = [max(np.diff(phone.moments), default=float("inf")) for phone in phones if phone.moments]
    of_each = [len(phone.ages) / (seconds + 2) for phone in phones]
    rates = [len(phone.pictures) / (seconds + 2) for phone in phones]
    print_table(
        f"What {PHONES} phones got",
        ("", "count", "median ms", "95th percentile ms", "largest ms"),
        [
            (name, len(values), *(f"{1000 * v:.0f}" for v in (*np.percentile(values, [50, 95]), values.max())))
            for name, values in (("event's age when the page has it", ages), ("picture, asked to had", pictures))
            if len(values)
        ],
    )
    print(f"  Events a second of each phone: {min(of_each):.2f} to {max(of_each):.2f}; longest wait for one {max(gaps):.2f} s")
    print(f"  Pictures a second of each phone: {min(rates):.2f} to {max(rates):.2f} (asked for: {PICTURES_HZ:.0f})")
    faults = [fault for phone in phones for fault in phone.faults]
    print(f"  Streams and pictures that broke off: {len(faults)} {faults[:2] or ''}")
    print(
        f"  Wanted: events at most {1000 * WANTED_AGE_S:.0f} ms old (95th percentile). Load of the machine: {os.getloadavg()}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--rounds", type=int, default=6)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--survey", choices=SURVEYS, default="drive")
    parser.add_argument("--fps", type=float, default=12.5, help="CCTV pictures a second")
    chosen = parser.parse_args()
    film_s = 2 * chosen.rounds * (chosen.seconds + 4.0) + 30.0 if chosen.survey == "drive" else 0.0
    with (
        tempfile.TemporaryDirectory(prefix="borescout-phones-") as folder,
        faulty_box(Path(folder), fps=chosen.fps, film_s=film_s) as box,
    ):
        alone, together = rounds(box, chosen.survey, chosen.rounds, chosen.seconds)
    _report(alone, together, chosen.seconds)
    before, after, got = serving(chosen.seconds)
    pictures = sum(len(phone.pictures) for phone in got)
    print(
        f"  Serving alone (no survey, no camera in that process): {after - before:.3f} cores for {PHONES} phones, which got"
        f" {pictures / (chosen.seconds + 2):.0f} pictures a second"
    )
    sys.exit(0)


if __name__ == "__main__":
    main()
