"""Power cuts, kills, full disks, flipped bits: each proof short enough for the suite (``tests.bench.crash`` has them whole)."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from random import Random

import pytest

from device.recorder.reader import open_recording
from device.recorder.recovery import recover
from device.recorder.scan import Whole, scan
from tests.crash import files_part, recorder_part, shim, store_part
from tests.crash.disk import identified, states
from tests.crash.proof import Check, missed, replay
from tests.crash.shim import Operation

RAW_LOST_S = 1.0
"""And what a machine that is busy with something else takes away from the recorder as from the workload."""

if shim.missing():
    pytest.skip(shim.missing(), allow_module_level=True)


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return shim.build(tmp_path_factory.mktemp("shim"))


def watched(library: Path, folder: Path, part: str, steps: int, ignored: tuple[str, ...]) -> list[Operation]:
    """The log of a workload; nothing of it got past the shim."""
    root, log = folder / "root", folder / "log"
    root.mkdir()
    shim.run(library, root, log, ["tests.crash.workload", part, str(root / "data"), "--steps", str(steps)])
    assert missed(log, root, ignored) == []
    return list(shim.read_log(log))


def within(check: Check) -> Check:
    return lambda folder, promises: check(folder / "data", promises)


def test_the_store_after_a_cut(library: Path, tmp_path: Path) -> None:
    log = watched(library, tmp_path, "store", 8, store_part.IGNORED)
    verdict = replay(log, within(store_part.check), seed=1, samples=100, limit=220, ignored=store_part.IGNORED)
    assert verdict.wrong == []
    assert verdict.promises >= 8
    assert set(verdict.states) == {"prefix", "subset", "sample", "torn"}


def test_files_after_a_cut(library: Path, tmp_path: Path) -> None:
    log = watched(library, tmp_path, "files", 6, files_part.IGNORED)
    verdict = replay(log, within(files_part.check), seed=1, ignored=files_part.IGNORED)
    assert verdict.wrong == []
    assert verdict.promises >= 3


def test_a_recording_after_a_cut(library: Path, tmp_path: Path) -> None:
    log = watched(library, tmp_path, "recorder", 50, recorder_part.IGNORED)
    verdict = replay(log, within(recorder_part.check), seed=1, samples=20, limit=60, ignored=recorder_part.IGNORED)
    assert verdict.wrong == []
    assert verdict.raw_lost_s <= RAW_LOST_S + 2 * verdict.stood_s


@pytest.mark.parametrize("part", ["store", "recorder"])
def test_kill_9_at_random_moments(library: Path, tmp_path: Path, part: str) -> None:
    told = json.loads(shim.run(library, tmp_path, None, ["tests.crash.kills", part, str(tmp_path), "--kills", "4"]))
    assert told["wrong"] == []
    assert told["raw_lost_s"] <= RAW_LOST_S + 2 * told["stood_s"]


def test_a_disk_that_fills(library: Path, tmp_path: Path) -> None:
    told = json.loads(shim.run(library, tmp_path, None, ["tests.crash.full", str(tmp_path), "--points", "8"]))
    assert told["wrong"] == []
    assert told["refused"] >= 3
    assert told["writes"] > 50
    assert told["surveys_saved"] == told["surveys_measured"]
    assert 0 < told["recordings_kept"] < told["recordings_made"]
    assert told["newest_kept"]
    assert told["raw_at_50_mb"]  # older raw data made room for it
    assert not told["raw_at_25_mb"]  # what is left is for findings


# The proof itself: it must find what is wrong


def operations(*given: tuple[str, str, int, bytes]) -> list[Operation]:
    return [
        Operation(op, path, inode=7 if op != "sync folder" else 1, offset=offset, data=data) for op, path, offset, data in given
    ]


def test_every_state_of_a_small_log_by_hand() -> None:
    log = operations(
        ("create", "f", 0, b""),
        ("sync folder", "", 0, b""),
        ("write", "f", 0, b"ab"),
        ("write", "f", 1, b"cd"),
        ("sync", "f", 0, b""),
    )

    found = {tuple(sorted(state.tree.content().items())) for state in states(identified(log), Random(1))}
    none, empty = (), (("f", b""),)
    assert found == {none, empty, (("f", b"ab"),), (("f", b"\0cd"),), (("f", b"acd"),)}


def test_a_rename_without_a_sync_is_found(library: Path, tmp_path: Path) -> None:
    """What ``write_whole`` would be without its syncs."""
    log = [
        *operations(("create", "part", 0, b""), ("write", "part", 0, b"new"), ("sync", "part", 0, b"")),
        Operation("rename", "part", "file", inode=7),
    ]
    unsynced = [log[0], log[1], log[3]]

    def contents(given: list[Operation]) -> set[bytes | None]:

        return {state.tree.content().get("file") for state in states(identified(given), Random(1))}

    assert contents(log) == {None, b"new"}
    assert b"" in contents(unsynced)  # the name arrived, what it names did not


def test_a_store_that_does_not_wait_for_the_disk_is_found(library: Path, tmp_path: Path) -> None:
    """The same work with its syncs taken out of the log: findings must be missing in some state."""
    log = watched(library, tmp_path, "store", 6, store_part.IGNORED)
    careless = [op for op in log if op.op != "sync" or not op.path.endswith("-wal")]
    verdict = replay(careless, within(store_part.check), seed=1, samples=30, limit=60, ignored=store_part.IGNORED)
    assert verdict.lost > 0


def test_flipped_bits_cost_one_chunk(library: Path, tmp_path: Path) -> None:

    root = tmp_path / "root"
    root.mkdir()
    shim.run(library, root, None, ["tests.crash.workload", "recorder", str(root), "--steps", "55"])
    original = max((root / "recordings").glob("*.mcap"), key=lambda path: path.stat().st_size)
    before = [(entry.topic, entry.sequence) for entry in open_recording(original).entries()]
    rng, size = Random(3), original.stat().st_size

    chunks = [part for part in scan(original) if isinstance(part, Whole)]
    largest = max(len(chunk.records) for chunk in chunks)
    assert len(chunks) >= 3
    for _ in range(10):
        shutil.rmtree(tmp_path / "flipped", ignore_errors=True)
        (tmp_path / "flipped").mkdir()
        flipped = tmp_path / "flipped" / original.name
        data = bytearray(original.read_bytes())
        data[rng.randrange(size)] ^= 1 << rng.randrange(8)
        flipped.write_bytes(data)
        recover(flipped)
        after = {(entry.topic, entry.sequence) for entry in open_recording(flipped).entries()}
        assert after <= set(before)
        assert len(before) - len(after) <= largest
