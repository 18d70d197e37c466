"""Many inputs on many workers. What is done is on the disk at once, so that a batch goes on where it was killed."""

from __future__ import annotations

import json
import os
import shutil
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import get_context, parent_process
from pathlib import Path
from typing import Any

from device.batch.convert import Job, Row, convert
from device.durable import write_whole
from device.errors import Invalid
from device.json_text import dumps

ROWS = "rows"
_ATTEMPTS = 2
"""A worker that dies takes its neighbours' work with it; whose fault it was shows when each is tried alone."""
_AFRESH = 50
"""Workers are started afresh after so many inputs each, on the average: decoders leak. (`max_tasks_per_child` would do it one
by one, but a pool of Python 3.11 may wait for ever for a worker that it did not start.)"""


def done(out: Path, jobs: list[Job]) -> dict[str, Row]:
    """The rows that an earlier run left for these very inputs, by name."""
    found = {}
    for job in jobs:
        try:
            row = json.loads(_row_file(out, job).read_text(encoding="utf-8"))
        except (OSError, ValueError):  # none yet, or not whole: convert it
            continue
        if row.get("key") == job.source.key and (not row["ok"] or job.folder.is_dir()):
            found[job.source.name] = row
    return found


def run(jobs: list[Job], out: Path, open_executor: Callable[[int], Any], workers: int) -> Iterator[Row]:
    """Convert ``jobs``, each row once it is on the disk, in the order in which they end.

    ``open_executor(workers)`` gives a context with an ``Executor``: processes of this machine, or a cluster.
    """
    (out / ROWS).mkdir(parents=True, exist_ok=True)
    for part in out.glob("*/.*.part"):
        shutil.rmtree(part, ignore_errors=True)
    waiting = list(jobs)
    for attempt in range(1, _ATTEMPTS + 1):
        broken: list[Job] = []
        for job, row in _once(waiting, open_executor, workers, alone=attempt > 1):
            if row is None:
                broken.append(job)
            else:
                yield _kept(out, job, row)
        waiting = broken
        if not waiting:
            return
    for job in waiting:
        yield _kept(out, job, _lost(job))


def _once(jobs: list[Job], open_executor: Callable[[int], Any], workers: int, alone: bool) -> Iterator[tuple[Job, Row | None]]:
    """Each job with its row, None where its worker died. ``alone``: each has a worker that no other job had."""
    remaining, size = list(jobs), 1 if alone else _AFRESH * workers
    while remaining:
        now, remaining = remaining[:size], remaining[size:]
        with open_executor(1 if alone else workers) as executor:
            futures: dict[Future[Row], Job] = {executor.submit(convert, job): job for job in now}
            for future in as_completed(futures):
                try:
                    yield futures[future], future.result()
                except BrokenProcessPool:
                    yield futures[future], None


@contextmanager
def processes(workers: int) -> Iterator[Executor]:
    """Workers on this machine. They are spawned: a forked one would share what OpenCV and ONNX began."""
    executor = ProcessPoolExecutor(workers, get_context("spawn"), initializer=_end_with_parent)
    try:
        yield executor
    finally:
        executor.shutdown(cancel_futures=True)


def _end_with_parent() -> None:
    """A worker whose batch was killed would wait for its next job for ever."""
    parent = parent_process()
    assert parent is not None

    def watch() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=watch, name="parent", daemon=True).start()


def cluster(address: str) -> Callable[[int], Any]:
    """Workers of the Dask scheduler at ``address``; inputs and output must lie where all of them see them. Raises Invalid."""

    @contextmanager
    def opened(workers: int) -> Iterator[Any]:
        try:
            from distributed import Client
        except ImportError:
            raise Invalid("The option --scheduler needs Dask: pip install 'borescout[batch]'.") from None
        try:
            client = Client(address, timeout="10s")
        except (OSError, ValueError) as error:
            raise Invalid(f"There is no Dask scheduler at {address}: {error}.") from None
        try:
            yield client.get_executor(pure=False)
        finally:
            client.close()

    return opened


def _kept(out: Path, job: Job, row: Row) -> Row:
    row = {**row, "key": job.source.key}
    write_whole(_row_file(out, job), dumps(row).encode())
    return row


def _lost(job: Job) -> Row:
    error = "Its conversion ended the program that did it, twice: the file is broken in a way that no reader survives."
    return {
        "input": job.source.name,
        "kind": job.source.kind,
        "ok": False,
        "error": error,
        "landmarks": None,
        "seconds": 0.0,
    }


def _row_file(out: Path, job: Job) -> Path:
    return out / ROWS / f"{job.folder.name}.json"
