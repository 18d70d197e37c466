"""The worker processes, and what happens when one is lost."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator

import numpy as np
import pytest

from device.errors import Closed, EstimateFailed
from device.workers import WorkerPool
from tests.unit.device.device_doubles import INTRINSICS, dies_on_400, eventually, thread_counts

DEPTH = np.full((48, 64), 400, np.uint16)
PATIENCE_S = 60.0


@pytest.fixture
def pool() -> Iterator[WorkerPool]:
    pool = WorkerPool(2, dies_on_400, limit_s=3.0)
    yield pool
    pool.close()


def test_estimates_come_back_each_to_its_own_frame(pool: WorkerPool) -> None:
    futures = [pool.submit(DEPTH, INTRINSICS, 0.001, seed) for seed in range(40)]
    assert [future.result(PATIENCE_S).points for future in futures] == list(range(40))
    assert len(pool.pids) == 2


def test_a_killed_worker_is_replaced_and_its_frame_estimated_again(pool: WorkerPool) -> None:
    assert pool.submit(DEPTH, INTRINSICS, 0.001, 1).result(PATIENCE_S).points == 1
    for pid in pool.pids:
        os.kill(pid, signal.SIGKILL)
    futures = [pool.submit(DEPTH, INTRINSICS, 0.001, seed) for seed in range(10)]
    assert [future.result(PATIENCE_S).points for future in futures] == list(range(10))
    assert pool.replaced >= 1


def test_a_frame_that_kills_its_worker_fails_alone(pool: WorkerPool) -> None:
    seeds = [0, 1, 400, 2, 3]
    futures = [pool.submit(DEPTH, INTRINSICS, 0.001, seed) for seed in seeds]
    for seed, future in zip(seeds, futures, strict=True):
        if seed == 400:
            with pytest.raises(EstimateFailed, match="did not come back"):
                future.result(PATIENCE_S)
        else:
            assert future.result(PATIENCE_S).points == seed


def test_a_worker_that_hangs_is_replaced(pool: WorkerPool) -> None:
    hanging = pool.submit(DEPTH, INTRINSICS, 0.001, 401)
    with pytest.raises(EstimateFailed):
        hanging.result(PATIENCE_S)
    assert pool.replaced == 2  # tried twice
    assert pool.submit(DEPTH, INTRINSICS, 0.001, 5).result(PATIENCE_S).points == 5


def test_an_estimator_that_raises_costs_neither_worker_nor_pool(pool: WorkerPool) -> None:
    with pytest.raises(EstimateFailed, match="cannot fit this"):
        pool.submit(DEPTH, INTRINSICS, 0.001, 402).result(PATIENCE_S)
    assert pool.submit(DEPTH, INTRINSICS, 0.001, 7).result(PATIENCE_S).points == 7
    assert pool.replaced == 0


def test_workers_compute_in_one_thread_each() -> None:
    pool = WorkerPool(1, thread_counts)
    try:
        assert pool.submit(DEPTH, INTRINSICS, 0.001).result(PATIENCE_S).points == 1
    finally:
        pool.close()


def test_a_cancelled_frame_is_not_estimated(pool: WorkerPool) -> None:
    futures = [pool.submit(DEPTH, INTRINSICS, 0.001, seed) for seed in range(200)]
    assert futures[-1].cancel()
    assert futures[0].result(PATIENCE_S).points == 0


def test_closing_ends_the_processes_and_whoever_waits() -> None:
    pool = WorkerPool(1, dies_on_400, limit_s=60.0)
    pool.submit(DEPTH, INTRINSICS, 0.001, 1).result(PATIENCE_S)
    pids = pool.pids
    hanging, waiting = pool.submit(DEPTH, INTRINSICS, 0.001, 401), pool.submit(DEPTH, INTRINSICS, 0.001, 2)
    pool.close()
    pool.close()
    for future in (hanging, waiting):
        with pytest.raises(Closed):
            future.result(PATIENCE_S)
    assert eventually(lambda: not any(_alive(pid) for pid in pids))
    with pytest.raises(Closed):
        pool.submit(DEPTH, INTRINSICS, 0.001, 3)


def _alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True
