"""``borescout structure``: the map of a pipe structure in a chamber, from a virtual one or from recorded scans and
navigation."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import click
import numpy as np

from device.errors import Invalid
from device.json_text import dumps
from device.landmarks.command import progress
from estimators.structure.types import PIPE_RADIUS

PAPER = "paper"


@click.command("structure")
@click.option(
    "--virtual",
    is_flag=False,
    flag_value=PAPER,
    help="A virtual chamber: a structure file, or the paper's structure if none is named.",
)
@click.option("--seed", type=click.IntRange(0), default=1, show_default=True, help="With --virtual: noise and sway of the run.")
@click.option("--scans", type=click.Path(path_type=Path), help="A folder of PLY or PCD files named by their time (s).")
@click.option("--navigation", type=click.Path(path_type=Path), help="With --scans: the log of DVL, pressure and AHRS (CSV).")
@click.option("--first", type=click.IntRange(1), help="Only the first so many scans.")
@click.option("--pipe-radius", type=float, help="Outer radius of the pipes (m): a virtual structure's own, or 0.0315.")
@click.option("--upright", is_flag=True, help="Pipes are horizontal or vertical: what is neither is left out.")
@click.option("--export", "exported", type=click.Path(path_type=Path), multiple=True, help="Save the map (.json, .ply, .glb).")
@click.option("--json", "as_json", is_flag=True, help="One JSON object instead of tables.")
def structure(
    virtual: str | None,
    seed: int,
    scans: Path | None,
    navigation: Path | None,
    first: int | None,
    pipe_radius: float | None,
    upright: bool,
    exported: tuple[Path, ...],
    as_json: bool,
) -> int:
    """Map a pipe structure: pipes, valves and fittings, and how they are connected."""
    if (virtual is None) == (scans is None):
        raise Invalid("Say what to map: --virtual [FILE], or --scans DIR with --navigation LOG.")
    if scans is not None and navigation is None:
        raise Invalid("The option --scans needs --navigation: the log of DVL, pressure and AHRS.")
    if pipe_radius is not None and not 0.01 <= pipe_radius <= 0.064:
        raise Invalid(f"The option --pipe-radius takes 0.01 to 0.064 m, not {pipe_radius:g}.")
    if navigation is not None and scans is None:
        raise Invalid("The option --navigation goes with --scans.")
    from device.structure.export import check_export, export_map  # what --help does without

    for path in exported:
        check_export(path)
    begun = time.monotonic()
    if virtual is not None:
        told = _virtual(None if virtual == PAPER else Path(virtual), seed, first, upright, pipe_radius)
    else:
        assert scans is not None
        assert navigation is not None
        told = _recorded(scans, navigation, first, upright, pipe_radius)
    told["seconds"] = round(time.monotonic() - begun, 3)
    for path in exported:
        export_map(told, path)
    if as_json:
        click.echo(dumps(told))
    else:
        from device.structure.output import print_structure

        print_structure(told)
    return 0


def _virtual(file: Path | None, seed: int, first: int | None, upright: bool, radius: float | None) -> dict[str, Any]:
    from device.structure.as_json import truth_json
    from device.structure.database import shipped_knowledge
    from device.structure.run import VirtualChamber, run_events
    from device.structure.scores import scores
    from drivers.virtual.chamber.structure import load_structure

    chamber = VirtualChamber(load_structure(file), seed)
    # what the paper knows beforehand as well: how thick the pipes are
    radii = {pipe.radius for pipe in chamber.structure.runs}
    if radius is None and len(radii) > 1:
        raise Invalid("The pipes of the structure file have several radii: say with --pipe-radius which of them to map.")
    known = radius or radii.pop()
    mapper = chamber.mapper(shipped_knowledge(), _settings(upright, known))
    total = len(chamber.scanner.times()[:first])
    with progress("Mapping", total) as bar:
        run = run_events(mapper, chamber.events(first), lambda _: bar.update(1))
    if not run.results:
        raise Invalid("The path of the structure file is too short for a single scan.")
    states = mapper.smooth()
    found = mapper.result()
    return {
        **_of_run(run, found, states),
        "truth": truth_json(chamber.structure),
        "scores": scores(run, found, chamber, states),
    }


def _recorded(folder: Path, log: Path, first: int | None, upright: bool, radius: float | None) -> dict[str, Any]:
    from device.structure.database import shipped_knowledge
    from device.structure.run import recorded_mapper, run_events
    from drivers.navigation.recorded import merged_events, read_log, scan_files

    header, readings = read_log(log)
    files = scan_files(folder)[:first]
    mapper = recorded_mapper(header, readings, shipped_knowledge(), _settings(upright, radius or PIPE_RADIUS))
    with progress("Mapping", len(files)) as bar:
        run = run_events(mapper, merged_events(readings, files), lambda _: bar.update(1))
    if not run.results:
        raise Invalid(f"No scan in {folder} lies within the time of {log}.")
    states = mapper.smooth()
    return _of_run(run, mapper.result(), states)


def _settings(upright: bool, radius: float) -> Any:
    from estimators.structure.apart import for_radius
    from estimators.structure.mapper import MapperSettings
    from estimators.structure.slam import SlamSettings

    return MapperSettings(apart=for_radius(radius), slam=SlamSettings(upright=upright))


def _of_run(run: Any, found: Any, states: Any) -> dict[str, Any]:
    from device.structure.told import told

    return {
        **told(run.mapper, found, run.track.times, states),
        "seconds_per_scan": round(float(np.mean(run.seconds)), 4),
    }
