"""Estimates in processes of their own: two cores at work, and a crash in native code that costs one estimate at most.

The standard library's process pool is broken for good by one killed worker and cannot end a job that hangs; here each worker
has a thread that feeds it over a pipe, and replaces it when it dies or takes too long.
"""

from __future__ import annotations

import contextlib
import logging
import multiprocessing
import os
import queue
import signal
import threading
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from device.errors import Closed, EstimateFailed
from estimators.frame import FrameEstimate, estimate_frame
from estimators.pinhole import Intrinsics

log = logging.getLogger(__name__)

R = TypeVar("R")

_ATTEMPTS = 2
_ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}


@dataclass(frozen=True)
class _Job(Generic[R]):
    arguments: tuple[Any, ...]
    future: Future[R]


class Workers(Generic[R]):
    """Processes that run ``estimate``, with one BLAS and one OpenCV thread each: two of one are faster than one of two.

    ``estimate`` must be a function of an importable module. An estimate that takes longer than ``limit_s`` costs its worker.
    """

    def __init__(self, workers: int, estimate: Callable[..., R], limit_s: float = 20.0) -> None:
        self._estimate = estimate
        self._limit_s = limit_s
        self._jobs: queue.SimpleQueue[_Job[R] | None] = queue.SimpleQueue()
        self._closed = False
        self._lock = threading.Lock()
        self.replaced = 0
        """How many workers died or hung and were replaced."""
        self._processes: dict[int, multiprocessing.process.BaseProcess] = {}
        self._context = multiprocessing.get_context("spawn")
        os.environ.update(_ONE_THREAD)  # read by the BLAS of the children as they start; nothing in here multiplies matrices
        self._threads = [
            threading.Thread(target=self._feed, args=(number,), name=f"worker {number}", daemon=True)
            for number in range(workers)
        ]
        for thread in self._threads:
            thread.start()

    def give(self, *arguments: Any) -> Future[R]:
        """Estimate with these arguments. The future raises EstimateFailed where the workers could not, Closed on shutting
        down."""
        future: Future[R] = Future()
        with self._lock:
            if self._closed:
                raise Closed("The device is shutting down.")
            self._jobs.put(_Job(arguments, future))
        return future

    @property
    def pids(self) -> list[int]:
        """The processes at work."""
        return [process.pid for process in self._processes.values() if process.pid is not None and process.is_alive()]

    def close(self, wait_s: float = 2.0) -> None:
        """End the workers; what they had not done raises Closed. May be called twice."""
        with self._lock:
            self._closed = True
        for _ in self._threads:
            self._jobs.put(None)
        processes = list(self._processes.values())
        for process in processes:
            process.terminate()
        for process in processes:
            process.join(wait_s)
            process.kill()
        for thread in self._threads:
            thread.join(wait_s)
        with contextlib.suppress(queue.Empty):
            while True:
                job = self._jobs.get_nowait()
                if job is not None and job.future.set_running_or_notify_cancel():
                    job.future.set_exception(Closed("The device is shutting down."))

    def _feed(self, number: int) -> None:
        pipe: Connection | None = None
        try:
            pipe = self._start(number)  # now, or the first measurement would wait for its imports
        except OSError as fault:  # tried again with the first frame
            log.error("worker %d could not be started: %s", number, fault)
        while (job := self._jobs.get()) is not None:
            if not job.future.set_running_or_notify_cancel():
                continue
            for attempt in range(1, _ATTEMPTS + 1):
                if self._closed:
                    job.future.set_exception(Closed("The device is shutting down."))
                    break
                try:
                    if pipe is None:
                        pipe = self._start(number)
                    pipe.send(job.arguments)
                    if not pipe.poll(self._limit_s):
                        raise TimeoutError(f"no estimate within {self._limit_s:.0f} s")
                    estimate, error = pipe.recv()
                except (OSError, EOFError) as fault:  # TimeoutError is an OSError
                    self._discard(number, pipe, fault)
                    pipe = None
                    if attempt == _ATTEMPTS and not self._closed:
                        job.future.set_exception(EstimateFailed("The estimate did not come back from the computing process."))
                else:
                    if error is None:
                        job.future.set_result(estimate)
                    else:
                        log.error("an estimate failed: %s", error)
                        job.future.set_exception(EstimateFailed(f"The estimate failed: {error}"))
                    break
        if pipe is not None:
            pipe.close()

    def _start(self, number: int) -> Connection:
        ours, theirs = self._context.Pipe()
        process = self._context.Process(
            target=_work, args=(theirs, self._estimate), name=f"borescout worker {number}", daemon=True
        )
        process.start()
        theirs.close()
        self._processes[number] = process
        return ours

    def _discard(self, number: int, pipe: Connection | None, fault: Exception) -> None:
        if pipe is not None:
            pipe.close()
        process = self._processes.pop(number, None)
        if process is not None:
            process.kill()
            process.join(1.0)
        if not self._closed:
            self.replaced += 1
            log.warning("worker %d was lost (%s) and is replaced", number, fault or type(fault).__name__)


class WorkerPool(Workers[FrameEstimate]):
    """Workers for the frames of a depth camera."""

    def __init__(
        self, workers: int = 2, estimate: Callable[..., FrameEstimate] = estimate_frame, limit_s: float = 20.0
    ) -> None:
        super().__init__(workers, estimate, limit_s)

    def submit(
        self, depth: NDArray[np.uint16], intrinsics: Intrinsics, depth_unit_m: float, seed: int = 0, resamples: int = 0
    ) -> Future[FrameEstimate]:
        """Estimate one frame; raises as ``give`` does."""
        return self.give(depth, intrinsics, depth_unit_m, seed, resamples)


def _work(pipe: Connection, estimate: Callable[..., Any]) -> None:
    """The worker's life: estimate what comes, until the other end is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C in a terminal reaches the whole group; the parent decides
    import cv2

    cv2.setNumThreads(1)
    while True:
        try:
            arguments = pipe.recv()
        except (EOFError, OSError):
            return
        answer: tuple[Any, str | None]
        try:
            answer = (estimate(*arguments), None)
        except Exception as error:  # noqa: BLE001 - it belongs to this frame alone: told to the parent, which logs and counts it
            answer = (None, f"{type(error).__name__}: {error}")
        pipe.send(answer)
