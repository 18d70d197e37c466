"""An archive is converted once, whatever breaks: bad files, a killed run, a worker that dies."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from pathlib import Path

import psutil
import pytest
from distributed import LocalCluster
from pyarrow import parquet

from device.batch.convert import Job
from device.batch.inputs import inputs
from device.batch.run import done, processes, run
from device.errors import Invalid
from tests.archive import make_archive
from tests.waiting import wait_until

COMMAND = [sys.executable, "-m", "device.cli", "batch"]


def converted(folder: Path, out: Path, *more: str) -> tuple[int, list[dict[str, object]]]:
    ended = subprocess.run([*COMMAND, str(folder), "--out", str(out), "--json", *more], capture_output=True, text=True)
    return ended.returncode, [json.loads(line) for line in ended.stdout.splitlines()]


def test_bad_files_are_named_and_stop_nothing(tmp_path: Path) -> None:
    make_archive(tmp_path / "in", good=2, bad=3)
    status, rows = converted(tmp_path / "in", tmp_path / "out")
    assert status == 1
    assert sorted(row["ok"] for row in rows) == [False] * 3 + [True] * 2
    for row in rows:
        assert list(row) == ["input", "ok", "error", "landmarks", "seconds"]
        assert (row["error"] is None) == row["ok"]
        assert (row["landmarks"] is not None) == row["ok"]
    table = parquet.read_table(tmp_path / "out" / "inputs.parquet").to_pylist()
    assert [row["input"] for row in table] == sorted(row["input"] for row in rows)
    landmarks = parquet.read_table(tmp_path / "out" / "landmarks.parquet")
    assert landmarks.num_rows == sum(row["landmarks"] or 0 for row in table)
    assert b"geo" in landmarks.schema.metadata


def test_a_killed_batch_goes_on_where_it_was(tmp_path: Path) -> None:
    names = make_archive(tmp_path / "in", good=5, bad=1)
    out = tmp_path / "out"
    process = subprocess.Popen([*COMMAND, str(tmp_path / "in"), "--out", str(out), "--json", "--workers", "1"])
    wait_until(lambda: len(list(out.glob("rows/*.json"))) >= 2, 120)
    workers = psutil.Process(process.pid).children(recursive=True)
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert psutil.wait_procs(workers, timeout=20)[1] == [], "a worker outlived its batch"
    before = {path.name: path.stat().st_mtime_ns for path in out.glob("rows/*.json")}
    assert 2 <= len(before) < len(names)
    _, rows = converted(tmp_path / "in", out)
    assert sorted(str(row["input"]) for row in rows) == sorted(names)
    assert {name: (out / "rows" / name).stat().st_mtime_ns for name in before} == before
    assert not list(out.glob("inputs/.*"))


def test_what_changed_is_converted_anew(tmp_path: Path) -> None:
    make_archive(tmp_path / "in", good=1, bad=0)
    converted(tmp_path / "in", tmp_path / "out")
    (source,) = inputs(tmp_path / "in")
    job = Job(source, (tmp_path / "out" / "inputs" / source.name).resolve(), None, None, "test")
    assert list(done(tmp_path / "out", [job])) == [source.name]
    source.path.write_text(source.path.read_text() + "\n")
    (changed,) = inputs(tmp_path / "in")
    assert not done(tmp_path / "out", [Job(changed, job.folder, None, None, "test")])


def test_a_cluster_converts_the_same(tmp_path: Path) -> None:
    names = make_archive(tmp_path / "in", good=2, bad=1)
    with LocalCluster(n_workers=1, processes=False, protocol="tcp", dashboard_address=None) as cluster:
        status, rows = converted(tmp_path / "in", tmp_path / "out", "--scheduler", cluster.scheduler_address)
    assert status == 1
    assert sorted((str(row["input"]), row["ok"]) for row in rows) == sorted((name, "run" in name) for name in names)


def test_workers_are_started_afresh_now_and_then(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    make_archive(tmp_path / "in", good=3, bad=0)
    monkeypatch.setattr("device.batch.run._AFRESH", 1)
    jobs = [Job(one, tmp_path / "out" / "inputs" / one.name, None, None, "test") for one in inputs(tmp_path / "in")]
    assert [row["ok"] for row in run(jobs, tmp_path / "out", processes, 1)] == [True] * 3


def test_a_worker_that_dies_costs_its_own_input_only(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    make_archive(tmp_path / "in", good=2, bad=0)
    monkeypatch.setattr("device.batch.run.convert", dying)
    jobs = [Job(one, tmp_path / "out" / "inputs" / one.name, None, None, "test") for one in inputs(tmp_path / "in")]
    rows = {row["input"]: row for row in run(jobs, tmp_path / "out", processes, 2)}
    assert rows["run00.csv"]["ok"]
    assert "no reader survives" in rows["run01.csv"]["error"]


def dying(job: Job) -> dict[str, object]:
    """Stands in for a file that crashes the decoder."""
    if job.source.name == "run01.csv":
        import os

        os._exit(11)
    return {"input": job.source.name, "kind": job.source.kind, "ok": True, "error": None, "landmarks": 0, "seconds": 0.0}


def test_an_empty_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(Invalid, match="holds nothing to convert"):
        inputs(tmp_path)
