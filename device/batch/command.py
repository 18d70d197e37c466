"""``borescout batch``: a folder of inspection videos and recordings to maps, exchange files and one summary."""

from __future__ import annotations

import sys
from importlib.metadata import version
from pathlib import Path

import click

from device.batch.convert import Job, Row
from device.batch.inputs import Input, inputs
from device.batch.run import cluster, done, processes, run
from device.batch.summary import write_summary
from device.durable import make_folder
from device.errors import Invalid
from device.inspections.model import PipeRecord
from device.inspections.pipe_list import read_pipe_list
from device.json_text import dumps

_ROW = ("input", "ok", "error", "landmarks", "seconds")


@click.command("batch")
@click.argument("folder", type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path, file_okay=False), required=True, help="Where the results go.")
@click.option("--workers", type=click.IntRange(1, 256), default=2, show_default=True, help="Processes of this machine.")
@click.option("--scheduler", help="Address of a Dask scheduler, instead of processes.")
@click.option("--pipes", type=click.Path(path_type=Path), help="Pipe list (CSV, GeoJSON); an input's name names its pipe.")
@click.option("--crs", type=int, help="EPSG number of the list's coordinates (4326 for GeoJSON).")
@click.option("--again", is_flag=True, help="Convert what failed before once more.")
@click.option("--json", "as_json", is_flag=True, help="One JSON object a line for each input.")
def batch(
    folder: Path,
    out: Path,
    workers: int,
    scheduler: str | None,
    pipes: Path | None,
    crs: int | None,
    again: bool,
    as_json: bool,
) -> int:
    """Convert a folder of inspections. What an earlier run has done is not done again."""
    listed = _listed(pipes)
    if crs is None and pipes is not None and pipes.suffix.lower() in (".geojson", ".json"):
        crs = 4326
    try:
        make_folder(out)
    except OSError as error:
        raise Invalid(f"The folder {out} cannot be made: {error.strerror}.") from None
    jobs = _jobs(inputs(folder), out, listed, crs)
    rows = {name: row for name, row in done(out, jobs).items() if row["ok"] or not again}
    for name in sorted(rows):
        _say(rows[name], as_json)
    missing = [job for job in jobs if job.source.name not in rows]
    opened = processes if scheduler is None else cluster(scheduler)
    with click.progressbar(length=len(missing), label="Converting", file=sys.stderr, hidden=not sys.stderr.isatty()) as bar:
        for row in run(missing, out, opened, workers):
            rows[row["input"]] = row
            bar.update(1)
            _say(row, as_json)
    write_summary(out, jobs, list(rows.values()))
    failed = [row for row in rows.values() if not row["ok"]]
    if not as_json:
        click.echo(f"{len(rows) - len(failed)} converted, {len(failed)} failed; summary in {out}")
        for row in failed:
            click.echo(f"  {row['input']}: {row['error']}")
    return 1 if failed else 0


def _jobs(found: list[Input], out: Path, listed: dict[str, PipeRecord], crs: int | None) -> list[Job]:
    program = f"borescout {version('borescout')}"
    resolved = out.resolve()
    return [
        Job(one, resolved / "inputs" / _folder_name(one.name), listed.get(Path(one.name).stem), crs, program)
        for one in found
        if resolved not in one.path.resolve().parents
    ]


def _folder_name(name: str) -> str:
    """One folder below the output for each input: its path with the separators spelt out, so that no two meet."""
    return name.replace("%", "%25").replace("/", "%2F").replace("\\", "%5C")


def _listed(file: Path | None) -> dict[str, PipeRecord]:
    if file is None:
        return {}
    try:
        return {pipe.name: pipe for pipe in read_pipe_list(file.read_bytes(), file.name)}
    except OSError as error:
        raise Invalid(f"The pipe list {file} cannot be read: {error.strerror}.") from None


def _say(row: Row, as_json: bool) -> None:
    if as_json:
        click.echo(dumps({name: row.get(name) for name in _ROW}))
