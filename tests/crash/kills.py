"""``kill -9`` at random moments: ``python -m tests.crash.kills PART FOLDER --kills N``, started with the shim for its marks.

The workload is forked from this process, so that most of its life is work and not imports. It is killed, what it left is opened
and checked, and the next one goes on with the same folder.
"""

from __future__ import annotations

import argparse
import json
import logging
import os
import shutil
import signal
import time
import traceback
from pathlib import Path
from random import Random

from tests.crash import files_part, recorder_part, store_part
from tests.crash.marks import Promises
from tests.crash.shim import loaded, read_log
from tests.crash.workload import PARTS

CHECKS = {"store": store_part.check, "files": files_part.check, "recorder": recorder_part.check}
SAME_FOLDER = 10
"""So many kills in a row, then a new folder: a store that is opened for the first time is killed too."""
LONGEST_S = 0.8


def _work(part: str, folder: Path, log: Path, seed: int) -> None:
    loaded().crash_watch(b"/nowhere", str(log).encode())
    work = PARTS[part](folder, Random(seed))
    while True:
        work.step()


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("part", choices=sorted(PARTS))
    parser.add_argument("folder", type=Path)
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    logging.disable(logging.CRITICAL)
    rng = Random(given.seed)
    data, log = given.folder / "data", given.folder / "log"
    wrong: list[str] = []
    promises, promised, worst, stood = Promises(), 0, 0.0, 0.0
    for number in range(given.kills):
        if number % SAME_FOLDER == 0:
            shutil.rmtree(data, ignore_errors=True)
            promised += len(promises.shown)
            promises = Promises()
        log.unlink(missing_ok=True)
        child = os.fork()
        if child == 0:
            try:
                _work(given.part, data, log, given.seed * 10_000 + number)
            except BaseException:  # noqa: BLE001 - the parent is told by the exit status
                traceback.print_exc()
            os._exit(1)
        time.sleep(rng.uniform(0.0, LONGEST_S))
        os.kill(child, signal.SIGKILL)
        promises.now_ns = time.monotonic_ns()
        _, status = os.waitpid(child, 0)
        if os.WIFEXITED(status):
            wrong.append("the workload ended by itself")
        if log.exists():
            promises.take(read_log(log))
        wrong += [f"kill {number}: {sentence}" for sentence in CHECKS[given.part](data, promises)]
        worst, stood = max(worst, promises.raw_lost_s), max(stood, promises.stood_s)
        promises.settle()
    promised += len(promises.shown)
    told = {"kills": given.kills, "promises": promised, "wrong": wrong}
    print(json.dumps({**told, "raw_lost_s": round(worst, 3), "stood_s": round(stood, 3)}))


if __name__ == "__main__":
    main()
