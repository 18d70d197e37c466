"""``borescout export`` and ``borescout demo-inspection``: what the utility takes home, from the command line."""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import click

from device.clock import Clock
from device.config import load_settings
from device.durable import write_whole
from device.errors import Invalid
from device.export.archive import MANIFEST
from device.export.formats import NAMES
from device.export.wording import LANGUAGES
from device.inspections.demo import demo_inspection
from device.inspections.desk import Desk
from device.store import Store

_config = click.option("--config", type=click.Path(path_type=Path), help="Settings file (TOML).")
_data_dir = click.option("--data-dir", type=click.Path(path_type=Path, file_okay=False), help="Where findings are kept.")


@click.command("export")
@click.option("--format", "name", type=click.Choice(NAMES), required=True, help="What to write.")
@click.option("--inspection", "number", type=int, required=True, help="Number of the inspection.")
@click.option("--out", type=click.Path(path_type=Path, dir_okay=False), required=True, help="File to write.")
@click.option("--language", type=click.Choice(LANGUAGES), default="en", show_default=True, help="Of report and texts.")
@click.option("--imperial", is_flag=True, help="Feet and inches.")
@_config
@_data_dir
def export_inspection(
    name: str, number: int, out: Path, language: str, imperial: bool, config: Path | None, data_dir: Path | None
) -> None:
    """Write an inspection as ISYBAU, EN 13508-2, PACP, GeoJSON, CSV, JSON, PLY, glTF, PDF, or all of them in one ZIP."""
    with _store(config, data_dir) as (store, clock):
        desk = Desk(store, clock)
        data, _, _ = desk.export(number, name, language, imperial)
        found = desk.get(number)["faults"]
    if name == "zip":
        with zipfile.ZipFile(io.BytesIO(data)) as packed:
            left_out = json.loads(packed.read(MANIFEST))["left_out"]
        found = [*found, *(f"{part} was left out: {reason}" for part, reason in left_out.items())]
    for fault in found:
        click.echo(f"borescout: note: {fault}", err=True)
    try:
        write_whole(out, data)
    except OSError as error:
        raise Invalid(f"The file {out} cannot be written: {error.strerror}.") from None


@click.command("demo-inspection")
@click.option("--seed", type=click.IntRange(min=0), required=True, help="Which virtual pipe.")
@_config
@_data_dir
def demo(seed: int, config: Path | None, data_dir: Path | None) -> None:
    """Put one complete inspection of a virtual pipe into the store and print its number."""
    with _store(config, data_dir) as (store, _):
        click.echo(demo_inspection(store, seed))


@contextmanager
def _store(config: Path | None, data_dir: Path | None) -> Iterator[tuple[Store, Clock]]:
    settings = load_settings(config, data_dir=data_dir)
    clock = Clock()
    store = Store(settings.data_dir, clock)
    try:
        yield store, clock
    finally:
        store.close()
