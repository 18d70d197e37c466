"""What a measurement costs: computing for 50 frames, Measure to verdict, the page's answers meanwhile, memory of the daemon.

    python -m tests.bench.cost                  all of it
    python -m tests.bench.cost --only computing
    python -m tests.bench.cost --only daemon
    python -m tests.bench.cost --replay         the daemon plays the real frames, not the virtual camera

The computing is timed in the daemon's own worker pool, beside a fixed numpy workload in the same pool and the same loop: the
ratio of the two can be compared between machines and between busy and idle ones, seconds cannot.
"""

from __future__ import annotations

import argparse
import http.client
import json
import os
import platform
import statistics
import tempfile
import threading
import time
from concurrent.futures import wait
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import psutil
from numpy.typing import NDArray

from device.workers import WorkerPool
from estimators.frame import FrameEstimate, estimate_frame
from estimators.pinhole import Intrinsics
from tests.bench.daemon import running
from tests.bench.real_data import RealFrame, data_folder, fail, real_frames
from tests.bench.table import print_table
from tests.pairing import Pass, ask, pair

FRAMES = 50
WORKERS = 2
ROUNDS = 5
START_LIMIT_S = 60.0
MEASURE_LIMIT_S = 60.0
STATUS_PAUSE_S = 0.02
PICTURE_PAUSE_S = 0.2
SIZE = (848, 480)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--only", choices=("computing", "daemon"))
    parser.add_argument("--replay", action="store_true", help="the daemon plays the real frames")
    arguments = parser.parse_args()
    print(f"{platform.machine()}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}, Python {platform.python_version()}")
    if arguments.only != "daemon":
        computing()
    if arguments.only != "computing":
        daemon(["--replay", str(data_folder())] if arguments.replay else ["--virtual"])


def computing() -> None:
    """Seconds for 50 real frames of 848 x 480 in two worker processes, best of five, beside the baseline in the same loop."""
    frames = [f for f in real_frames() if f.wall_visible and f.emitter and f.intrinsics.size == SIZE]
    if not frames:
        fail(f"There are no real frames of {SIZE[0]} x {SIZE[1]} with a visible wall.")
    frames = [frames[k % len(frames)] for k in range(FRAMES)]
    ours: list[Round] = []
    base: list[Round] = []
    estimating, counting = WorkerPool(WORKERS, estimate_frame), WorkerPool(WORKERS, baseline)
    try:
        for pool in (estimating, counting):
            _run(pool, frames[: 4 * WORKERS])  # started and warm, as in a daemon that has been showing live estimates
        for _ in range(ROUNDS):
            ours.append(_run(estimating, frames))
            base.append(_run(counting, frames))
    finally:
        estimating.close()
        counting.close()
    rows = [("estimates of 50 frames", *_figures(ours)), ("baseline: 50 sorts of 400 000 float32", *_figures(base))]
    title = f"Computing for {FRAMES} frames of {SIZE[0]} x {SIZE[1]}, {WORKERS} workers, {ROUNDS} rounds (wanted: 1.5 s)"
    print_table(title, ("", "best s", "median s", "worst s", "least CPU s of the workers"), rows)
    ratios = [one.seconds / other.seconds for one, other in zip(ours, base, strict=True)]
    print(f"  ratio to the baseline: best {min(ratios):.2f}, median {statistics.median(ratios):.2f}")
    print(f"  on {WORKERS} idle cores the CPU time alone is {min(r.cpu_s for r in ours) / WORKERS:.2f} s")


def baseline(
    depth: NDArray[np.uint16], intrinsics: Intrinsics, depth_unit_m: float, seed: int, resamples: int
) -> FrameEstimate:
    """The named baseline, given the same pictures over the same pipe: sort 400 000 random float32."""
    numbers = np.random.default_rng(seed).random(400_000, dtype=np.float32)
    numbers.sort()
    return FrameEstimate(None, None, float(numbers[0]), len(numbers), intrinsics)


@dataclass(frozen=True)
class Round:
    """One run over all frames: seconds on the clock, and of CPU in the workers, which other programs hardly change."""

    seconds: float
    cpu_s: float


def _run(pool: WorkerPool, frames: list[RealFrame]) -> Round:
    cpu_before = _cpu_s(pool)
    started = time.perf_counter()
    futures = [pool.submit(f.depth, f.intrinsics, f.depth_unit_m, seed) for seed, f in enumerate(frames)]
    wait(futures)
    seconds = time.perf_counter() - started
    for future in futures:
        future.result()  # raises what went wrong
    return Round(seconds, _cpu_s(pool) - cpu_before)


def _cpu_s(pool: WorkerPool) -> float:
    times = [psutil.Process(pid).cpu_times() for pid in pool.pids]
    return float(sum(t.user + t.system for t in times))


def _figures(rounds: list[Round]) -> tuple[str, str, str, str]:
    seconds = [r.seconds for r in rounds]
    cpu_s = min(r.cpu_s for r in rounds)
    return f"{min(seconds):.2f}", f"{statistics.median(seconds):.2f}", f"{max(seconds):.2f}", f"{cpu_s:.2f}"


@dataclass(frozen=True)
class Memory:
    """Memory of one process in bytes; in ``pss`` a page shared by n processes counts 1/n in each."""

    process: str
    rss: int
    pss: int


@dataclass
class Observations:
    """What was seen of the running daemon: latencies of the status in s, and its memory with that of its children."""

    idle_s: list[float] = field(default_factory=list)
    measuring_s: list[float] = field(default_factory=list)
    memory: list[list[Memory]] = field(default_factory=list)
    faults: list[str] = field(default_factory=list)


def daemon(source: list[str]) -> None:
    """Measure to verdict through the HTTP interface of ``borescout serve``, with one page open as a phone would have it."""
    with tempfile.TemporaryDirectory(prefix="borescout-cost-") as folder, running(Path(folder), source) as (process, port):
        seen = Observations()
        stop, measuring = threading.Event(), threading.Event()
        watchers = [
            threading.Thread(target=_watch_status, args=(port, seen, stop, measuring)),
            threading.Thread(target=_watch_pictures, args=(port, seen, stop)),
            threading.Thread(target=_watch_memory, args=(process.pid, seen, stop)),
        ]
        events = _Events(port)
        events.wait_for("live", lambda live: bool(live and live.get("diameter_mm")), START_LIMIT_S)
        for watcher in watchers:
            watcher.start()
        try:
            time.sleep(3.0)
            rows = [_measure(port, events, measuring) for _ in range(ROUNDS)]
        finally:
            stop.set()
            for watcher in watchers:
                watcher.join()
            events.close()
    _report_daemon(rows, seen)


def _measure(port: int, events: _Events, measuring: threading.Event) -> tuple[float, float, dict[str, Any]]:
    """One measurement: seconds from the request to the last frame, to the saved verdict, and the stored survey."""
    measuring.set()
    events.forget()
    started = time.perf_counter()
    number = _request(port, "POST", "/api/v1/measure", {"frames": FRAMES})["survey_id"]
    last_frame = 0.0

    def finished(event: dict[str, Any]) -> bool:
        nonlocal last_frame
        if event["survey_id"] != number:
            return False
        if event["state"] in ("failed", "cancelled"):
            fail(f"The measurement ended as {event['state']}: {event.get('message')}")
        if event["state"] == "measuring":
            last_frame = time.perf_counter() - started
        return bool(event["state"] == "saved")

    events.wait_for("measurement", finished, MEASURE_LIMIT_S)
    whole = time.perf_counter() - started
    measuring.clear()
    survey = _request(port, "GET", f"/api/v1/surveys/{number}")
    time.sleep(0.5)
    return last_frame, whole, survey["result"]


def _report_daemon(rows: list[tuple[float, float, dict[str, Any]]], seen: Observations) -> None:
    wholes = [whole for _, whole, _ in rows]
    table = [
        (k + 1, f"{frames_s:.2f}", f"{whole:.2f}", result["verdict"], result["diameter_mm"], result["frames_used"])
        for k, (frames_s, whole, result) in enumerate(rows)
    ]
    title = f"Measure to verdict through HTTP, {FRAMES} frames, one page open (wanted: 3 s)"
    print_table(title, ("round", "last frame s", "verdict s", "verdict", "diameter mm", "frames"), table)
    print(
        f"  Measure to verdict: best {min(wholes):.2f} s, median {statistics.median(wholes):.2f} s, worst {max(wholes):.2f} s"
    )
    latencies = [("while aiming", seen.idle_s), ("while measuring", seen.measuring_s)]
    print_table(
        "Latency of /api/v1/status (wanted while measuring: 99th percentile under 100 ms)",
        ("", "requests", "median ms", "99th percentile ms", "largest ms"),
        [
            (name, len(values), *(f"{1000 * v:.1f}" for v in (*np.percentile(values, [50, 99]), max(values))))
            for name, values in latencies
            if values
        ],
    )
    largest = max(seen.memory, key=lambda processes: sum(m.pss for m in processes))
    rows_mb = [(m.process, f"{m.rss / 1e6:.0f}", f"{m.pss / 1e6:.0f}") for m in largest]
    rows_mb.append(("all", f"{sum(m.rss for m in largest) / 1e6:.0f}", f"{sum(m.pss for m in largest) / 1e6:.0f}"))
    title = "Memory of the daemon with its children at its largest (wanted: under 400 MB; PSS counts a shared page once)"
    print_table(title, ("process", "resident MB", "PSS MB"), rows_mb)
    for fault in seen.faults[:5]:
        print(f"  fault: {fault}")


@cache
def _pass(port: int) -> Pass:
    return pair(port)


def _request(port: int, method: str, path: str, body: dict[str, Any] | None = None) -> Any:
    status, answer = ask(port, _pass(port), method, path, body)
    if status >= 400:
        fail(f"{method} {path} answered {status}: {str(answer)[:200]}")
    return answer


class _Events:
    """The page's event stream, read in a thread; ``wait_for`` sees every event since the last ``forget``."""

    def __init__(self, port: int) -> None:
        self._connection = http.client.HTTPConnection("127.0.0.1", port, timeout=30)
        self._connection.request("GET", "/api/v1/events", headers=_pass(port).headers)
        self._answer = self._connection.getresponse()
        if self._answer.status != 200:
            fail(f"The event stream answered {self._answer.status}.")
        self._new = threading.Condition()
        self._seen: list[tuple[str, Any]] = []
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def forget(self) -> None:
        with self._new:
            self._seen.clear()

    def wait_for(self, name: str, wanted: Any, limit_s: float) -> None:
        """Until ``wanted(data)`` is true of an event; ends the program where none comes in time."""
        deadline = time.monotonic() + limit_s
        done = 0
        with self._new:
            while True:
                for event, data in self._seen[done:]:
                    if event == name and wanted(data):
                        return
                done = len(self._seen)
                if not self._new.wait(deadline - time.monotonic()) and time.monotonic() >= deadline:
                    fail(f"No fitting '{name}' event within {limit_s:.0f} s.")

    def close(self) -> None:
        self._connection.close()

    def _read(self) -> None:
        name = ""
        try:
            while line := self._answer.readline():
                text = line.decode().rstrip("\n")
                if text.startswith("event: "):
                    name = text[7:]
                elif text.startswith("data: "):
                    data = json.loads(text[6:])
                    with self._new:
                        self._seen.append((name, data))
                        self._new.notify_all()
        except (OSError, ValueError, AttributeError):
            return  # closed from our side, or the daemon ended: whoever waits runs into the limit


def _watch_status(port: int, seen: Observations, stop: threading.Event, measuring: threading.Event) -> None:
    while not stop.is_set():
        target = seen.measuring_s if measuring.is_set() else seen.idle_s
        started = time.perf_counter()
        try:
            _request(port, "GET", "/api/v1/status")
            target.append(time.perf_counter() - started)
        except (OSError, http.client.HTTPException) as error:
            seen.faults.append(f"status: {error!r}")
        stop.wait(STATUS_PAUSE_S)


def _watch_pictures(port: int, seen: Observations, stop: threading.Event) -> None:
    """The page polls its pictures; so does this."""
    while not stop.is_set():
        connection = http.client.HTTPConnection("127.0.0.1", port, timeout=30)
        try:
            connection.request("GET", "/api/v1/picture/depth.jpg", headers=_pass(port).headers)
            connection.getresponse().read()
        except (OSError, http.client.HTTPException) as error:
            seen.faults.append(f"picture: {error!r}")
        finally:
            connection.close()
        stop.wait(PICTURE_PAUSE_S)


def _watch_memory(pid: int, seen: Observations, stop: threading.Event) -> None:
    parent = psutil.Process(pid)
    while not stop.is_set():
        try:
            family = [parent, *parent.children(recursive=True)]
            seen.memory.append([_memory(process, process.pid == pid) for process in family])
        except psutil.NoSuchProcess:
            continue  # a child ended in between
        stop.wait(0.25)


def _memory(process: psutil.Process, is_daemon: bool) -> Memory:
    info = process.memory_full_info()
    command = " ".join(process.cmdline())
    kind = "daemon" if is_daemon else "resource tracker" if "resource_tracker" in command else "child"
    return Memory(f"{kind}, {process.num_threads()} threads", info.rss, getattr(info, "pss", info.rss))


if __name__ == "__main__":
    main()
