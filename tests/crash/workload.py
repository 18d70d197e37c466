"""The program that is watched and killed: ``python -m tests.crash.workload PART FOLDER --seed N --steps N``."""

from __future__ import annotations

import argparse
from pathlib import Path
from random import Random

from tests.crash.files_part import FilesWork
from tests.crash.recorder_part import RecorderWork
from tests.crash.store_part import StoreWork

PARTS = {"store": StoreWork, "files": FilesWork, "recorder": RecorderWork}


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("part", choices=sorted(PARTS))
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--steps", type=int, default=20)
    given = parser.parse_args()
    work = PARTS[given.part](given.folder, Random(given.seed))
    for _ in range(given.steps):
        work.step()
    work.close()


if __name__ == "__main__":
    main()
