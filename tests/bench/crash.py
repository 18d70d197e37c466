"""Power cuts, ``kill -9``, full disks and flipped bits: how many of each, and what was lost.

A shim below Python records every write, sync and rename of the store, the recorder and the files of the configuration; every
state that a cut may leave on the disk is laid out, opened by the real code and compared with what had been shown as saved.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from random import Random
from typing import Any

from device.recorder.reader import open_recording
from device.recorder.recovery import recover
from device.recorder.scan import Whole, scan
from tests.bench.table import print_table
from tests.crash import files_part, recorder_part, shim, store_part
from tests.crash.proof import Verdict, memory, missed, replay

PARTS = {"store": (store_part, 24), "files": (files_part, 40), "recorder": (recorder_part, 130)}
"""Module and steps of one workload."""


def cuts(library: Path, scratch: Path, rounds: int, samples: int) -> None:
    """Every state after a cut."""
    rows = []
    for part, (module, steps) in PARTS.items():
        total = Verdict()
        for seed in range(rounds):
            root, log = scratch / f"{part}-{seed}", scratch / f"{part}-{seed}.log"
            root.mkdir()
            arguments = ["tests.crash.workload", part, str(root / "data"), "--steps", str(steps), "--seed", str(seed)]
            shim.run(library, root, log, arguments)
            if past := missed(log, root, module.IGNORED):
                raise SystemExit(f"got past the shim: {past}")

            def check(folder: Path, promises: Any, look: Any = module.check) -> list[str]:
                return list(look(folder / "data", promises))

            total += replay(list(shim.read_log(log)), check, seed, samples, ignored=module.IGNORED)
            shutil.rmtree(root)
        raw = f"{total.raw_lost_s:.2f} ({total.stood_s:.2f})" if part == "recorder" else "-"
        kinds = [total.states[kind] for kind in ("prefix", "subset", "torn", "sample")]
        rows.append((part, total.operations, total.promises, sum(kinds), *kinds, total.lost, total.unreadable, raw))
        for sentence in total.wrong[:5]:
            print(f"  {part}: {sentence}", file=sys.stderr)
    head = (
        "",
        "operations",
        "shown saved",
        "states",
        "prefixes",
        "subsets",
        "torn",
        "samples",
        "lost",
        "unreadable",
        "raw lost s (machine stood)",
    )
    print_table("Power cuts: states reopened", head, rows)


def kills(library: Path, scratch: Path, count: int) -> None:
    """``kill -9`` of the workloads."""
    rows = []
    for part, share in (("store", 0.5), ("recorder", 0.4), ("files", 0.1)):
        folder = scratch / f"kill-{part}"
        folder.mkdir()
        number = round(share * count)
        arguments = ["tests.crash.kills", part, str(folder), "--kills", str(number)]
        told = json.loads(shim.run(library, folder, None, arguments))
        rows.append(
            (part, told["kills"], told["promises"], len(told["wrong"]), f"{told['raw_lost_s']:.2f} ({told['stood_s']:.2f})")
        )
        for sentence in told["wrong"][:5]:
            print(f"  {part}: {sentence}", file=sys.stderr)
    print_table(
        "kill -9 at random moments",
        ("workload", "kills", "shown saved", "lost or unreadable", "raw lost s (machine stood)"),
        rows,
    )


def daemon_kills(scratch: Path, count: int) -> None:
    """``kill -9`` of ``borescout serve --virtual`` that logs by itself. What another reader of its database saw before the kill
    must be there after the next start."""
    data, config = scratch / "daemon", scratch / "box.toml"
    config.write_text("[autonomy]\nenabled = true\n")
    if not count:
        return
    command = [sys.executable, "-m", "device.cli", "serve", "--virtual", "--data-dir", str(data), "--config", str(config)]
    command += ["--port", "0", "--pin", "123456"]
    rng, lost, ended = Random(4), 0, 0
    ever, last = set[str](), set[str]()
    for _ in range(count):
        with (scratch / "daemon.log").open("a") as log:
            process = subprocess.Popen(
                command, cwd=shim.ROOT, stdout=log, stderr=log, env={**os.environ, "OMP_NUM_THREADS": "1"}
            )
        begun = time.monotonic()
        deadline, stop_at = begun + 300, None
        now = last
        while time.monotonic() < (deadline if stop_at is None else stop_at):
            time.sleep(0.05)
            if process.poll() is not None:
                ended += 1
                break
            now = _rows(data)
            if stop_at is None and len(now - last) >= 3:  # it is up, has looked after what was cut off, and goes on
                lost += len(last - now)
                stop_at = time.monotonic() + rng.uniform(0.0, 6.0)
        process.send_signal(signal.SIGKILL)
        process.wait()
        last = now
        ever |= now
    lost += len(last - _rows(data))
    print_table(
        "kill -9 of borescout serve --virtual, logging by itself, one data folder",
        ("kills", "rows seen as saved", "lost", "ended by itself"),
        [(count, len(ever), lost, ended)],
    )


def _rows(data: Path) -> set[str]:
    """Landmarks, log chunks and journal entries as another reader finds them."""
    tables = {"landmarks": "survey_id, number", "drive_log": "id, length(chunk)", "journal": "id, what"}
    try:
        with closing(sqlite3.connect(f"file:{data}/borescout.db?mode=ro", uri=True, timeout=5.0)) as onlooker:
            return {
                f"{table} {row}"
                for table, columns in tables.items()
                for row in onlooker.execute(f"SELECT {columns} FROM {table}")
            }
    except sqlite3.OperationalError:
        return set()  # not there yet


def full(library: Path, scratch: Path, points: int) -> None:
    """A disk that fills."""
    folder = scratch / "full"
    folder.mkdir()
    told = json.loads(shim.run(library, folder, None, ["tests.crash.full", str(folder), "--points", str(points)]))
    print_table(
        "A disk that fills at the n-th write, for a while",
        ("points", "of writes", "steps refused", "shown saved", "lost or unreadable"),
        [(told["points"], told["writes"], told["refused"], told["promises"], len(told["wrong"]))],
    )
    print_table(
        "A small disk: raw data prunes itself, findings go on",
        ("recordings made", "kept", "the newest", "MB free then", "raw at 50 MB", "raw at 25 MB", "surveys saved", "measured"),
        [
            (
                told["recordings_made"],
                told["recordings_kept"],
                "yes" if told["newest_kept"] else "no",
                told["free_after_raw_mb"],
                "yes" if told["raw_at_50_mb"] else "no",
                "yes" if told["raw_at_25_mb"] else "no",
                told["surveys_saved"],
                told["surveys_measured"],
            )
        ],
    )


def flips(library: Path, scratch: Path, count: int) -> None:
    """Single bits flipped anywhere in a recording, and what its recovery brings back."""
    root = scratch / "flips"
    root.mkdir()
    shim.run(library, root, None, ["tests.crash.workload", "recorder", str(root), "--steps", "110"])
    original = max((root / "recordings").glob("*.mcap"), key=lambda path: path.stat().st_size)
    before = {(entry.topic, entry.sequence) for entry in open_recording(original).entries()}
    chunks = [len(part.records) for part in scan(original) if isinstance(part, Whole)]
    rng, worst, unreadable, more = Random(2), 0, 0, 0
    flipped = root / "flipped" / original.name
    flipped.parent.mkdir()
    for _ in range(count):
        data = bytearray(original.read_bytes())
        data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
        flipped.write_bytes(data)
        try:
            recover(flipped)
            after = {(entry.topic, entry.sequence) for entry in open_recording(flipped).entries()}
        except Exception as error:  # noqa: BLE001 - counted, whatever it is
            print(f"  {error}", file=sys.stderr)
            unreadable += 1
            continue
        worst = max(worst, len(before - after))
        more += len(before - after) > max(chunks)
    print_table(
        "One bit flipped in a recording",
        ("flips", "samples", "chunks", "most in a chunk", "most lost", "more than a chunk", "unreadable"),
        [(count, len(before), len(chunks), max(chunks), worst, more, unreadable)],
    )


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.bench.crash", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--rounds", type=int, default=3, help="workloads of each kind whose cuts are replayed")
    parser.add_argument("--samples", type=int, default=1000, help="states drawn by lot where there are too many")
    parser.add_argument("--kills", type=int, default=500)
    parser.add_argument("--daemon-kills", type=int, default=10)
    parser.add_argument("--points", type=int, default=100, help="writes that find the disk full")
    parser.add_argument("--flips", type=int, default=200)
    parser.add_argument("--only", action="append", choices=("kills", "full", "flips", "cuts", "daemon"), help="not all of it")
    given = parser.parse_args()
    if why := shim.missing():
        raise SystemExit(f"no figures: {why}")
    with tempfile.TemporaryDirectory(prefix="crash-bench-", dir=memory()) as scratch:
        folder = Path(scratch)
        library = shim.build(folder)
        proofs: dict[str, Callable[[], None]] = {
            "kills": lambda: kills(library, folder, given.kills),
            "full": lambda: full(library, folder, given.points),
            "flips": lambda: flips(library, folder, given.flips),
            "cuts": lambda: cuts(library, folder, given.rounds, given.samples),
            "daemon": lambda: daemon_kills(folder, given.daemon_kills),
        }
        for name, proof in proofs.items():
            if name in (given.only or proofs):
                proof()
                sys.stdout.flush()


if __name__ == "__main__":
    main()
