"""``borescout recordings``: what raw data there is, whether it is whole, and what can be done about it."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import click

from device.config import default_data_dir
from device.errors import Invalid
from device.json_text import dumps
from device.recorder.names import SUFFIX, recordings_in
from device.recorder.policy import MB, DiskPolicy
from device.recorder.recovery import CannotRecover, Report, check, recover
from device.recorder.shelf import FOLDER, Shelf

_SOURCE = click.argument("source", metavar="[DIR]", required=False, type=click.Path(path_type=Path))
_JSON = click.option("--json", "as_json", is_flag=True, help="One JSON object a line instead of a table.")


@click.group()
def recordings() -> None:
    """Raw data of surveys. DIR is a folder of recordings, a data folder, or one file; the box's own where it is not given."""


@recordings.command("list")
@_SOURCE
@_JSON
def list_recordings(source: Path | None, as_json: bool) -> int:
    """What there is, without reading all of it."""
    for path in _files(source):
        size = path.stat().st_size
        if as_json:
            click.echo(dumps({"file": path.name, "bytes": size}))
        else:
            click.echo(f"{size / MB:9.1f} MB  {path.name}")
    return 0


@recordings.command("check")
@_SOURCE
@_JSON
def check_recordings(source: Path | None, as_json: bool) -> int:
    """Read every file and say whether it is whole; nothing is changed. Exit status 1 where one is not."""
    reports = []
    for path in _files(source):
        reports.append(_checked(path))
        _show(reports[-1], as_json)
    return 0 if all(report.ok or report.state == "writing" for report in reports) else 1


@recordings.command("recover")
@_SOURCE
@_JSON
def recover_recordings(source: Path | None, as_json: bool) -> int:
    """Make whole what was cut off or damaged. A file goes only once the one made of it has been read back."""
    failed = 0
    for path in _files(source):
        try:
            report = recover(path)
        except (CannotRecover, OSError) as error:
            failed += 1
            click.echo(f"borescout: {error}", err=True)
            report = _checked(path)
        _show(report, as_json)
    return 1 if failed else 0


@recordings.command("prune")
@_SOURCE
@click.option("--keep-free", "keep_free_mb", type=click.IntRange(0), help="MB that shall be free afterwards.")
@click.option("--most", "most_mb", type=click.IntRange(0), help="MB that all recordings may take together.")
def prune_recordings(source: Path | None, keep_free_mb: int | None, most_mb: int | None) -> int:
    """Remove the oldest recordings, never one that is being written."""
    if keep_free_mb is None and most_mb is None:
        raise Invalid("Say how much to keep: --keep-free MB or --most MB.")
    folder = _folder(source)
    before = recordings_in(folder)
    keep = (keep_free_mb or 0) * MB
    Shelf(folder, DiskPolicy(keep, 0, 0, None if most_mb is None else most_mb * MB)).make_room()
    for path in before:
        if not path.exists():
            click.echo(f"removed {path.name}")
    return 0


@recordings.command("export")
@_SOURCE
@click.option("--to", "target", type=click.Path(path_type=Path), help="A new folder; by default beside the recording.")
@click.option("--clouds", is_flag=True, help="Point clouds too, as an MCAP file for Foxglove.")
def export_recordings(source: Path | None, target: Path | None, clouds: bool) -> int:
    """Pictures as PNG and JPEG with a manifest, the counter as CSV, notes as JSON lines: one folder for each recording."""
    from device.recorder.export import export_recording  # it reads and writes pictures

    files = [path for path in _files(source) if path == source or _is_first_part(path)]
    if not files:
        raise Invalid(f"There is no recording in {source}.")
    for path in files:
        folder = path.with_suffix("") if target is None else target if len(files) == 1 else target / path.stem
        told = export_recording(path, folder, clouds)
        click.echo(f"{folder}: {', '.join(f'{count} {what}' for what, count in told.items())}")
    return 0


def _is_first_part(path: Path) -> bool:
    from device.recorder.names import name_of, parts_of

    return name_of(path) is None or parts_of(path)[0] == path


def _files(source: Path | None) -> list[Path]:
    if source is not None and source.is_file():
        return [source]
    return recordings_in(_folder(source))


def _folder(source: Path | None) -> Path:
    """The folder that holds recordings. Raises Invalid."""
    given = default_data_dir() if source is None else source
    if not given.is_dir():
        raise Invalid(f"There is no folder {given}.")
    inside = given / FOLDER
    return inside if inside.is_dir() and not any(given.glob(f"*{SUFFIX}")) else given


def _checked(path: Path) -> Report:
    try:
        room = shutil.disk_usage(path.parent).free > 2 * path.stat().st_size
        return check(path, try_recovery=room)
    except OSError as error:
        raise Invalid(f"The recording {path} cannot be read: {error.strerror}.") from None


def _show(report: Report, as_json: bool) -> None:
    if as_json:
        told: dict[str, Any] = report.to_json()
        click.echo(dumps(told))
        return
    lost = f", {report.lost_seconds:.3f} s lost" if report.lost_seconds else ""
    can = ", can be recovered" if report.recovered and not report.ok else ""
    click.echo(f"{report.state:10}  {report.messages:8} messages  {report.seconds:8.1f} s  {report.file}{lost}{can}")
