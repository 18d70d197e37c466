"""What ``borescout map`` prints: one JSON object, or a table for people."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import click

Map = dict[str, Any]


def print_map(found: Map) -> None:
    """The map as a table on stdout."""
    rows = found["landmarks"]
    if rows:
        click.echo(f"{'class':<17} {'from':>9} {'to':>9}  {'clock':<13} {'+-':>7} {'hits':>5}  belief")
        for row in rows:
            click.echo(_line(row))
    else:
        click.echo("No landmarks.")
    rings = found["rings"]
    if rings:
        places = ", ".join(f"{ring['chainage_m']:.2f}" for ring in rings)
        click.echo(f"{len(rings)} pipe joints at {places} m")
        gaps = [later["chainage_m"] - earlier["chainage_m"] for earlier, later in pairwise(rings)]
        if gaps:
            click.echo(f"  apart: {', '.join(f'{gap:.2f}' for gap in gaps)} m")
    if found["focal_radius"]:
        click.echo(f"f * R: {found['focal_radius']['value']:.1f} +- {found['focal_radius']['sigma']:.1f} px m")
    if found.get("scale"):
        scale = found["scale"]
        click.echo(f"tether: {scale['value']:.4f} +- {scale['sigma']:.4f} metres a metre counted")
    for fault in found.get("faults", []):
        where = "" if fault.get("chainage_m") is None else f" at {fault['chainage_m']:.2f} m"
        click.echo(f"{fault['time_s']:.1f} s{where}: {fault['text']}")
    smoothed = ", smoothed" if found.get("smoothed") else ""
    click.echo(f"{found['frames']} frames in {found['seconds']:.1f} s{smoothed}")


def _line(row: Map) -> str:
    length = row["chainage_to_m"] - row["chainage_m"]
    to = f"{row['chainage_to_m']:.2f} m" if length > 0.005 else ""
    clock = "-" if row["clock"] is None else f"{row['clock']:.1f} h"
    if row["clock"] is not None and abs(row["clock_to"] - row["clock"]) > 0.05:
        clock = f"{row['clock']:.1f} to {row['clock_to']:.1f} h"
    sigmas = [row[name] for name in ("sigma_chainage_m", "sigma_chainage_to_m") if row.get(name) is not None]
    sigma = f"{max(sigmas):.2f} m" if sigmas else "-"
    belief = max(row["belief"].values(), default=0.0)
    return f"{row['class']:<17} {row['chainage_m']:>7.2f} m {to:>9}  {clock:<13} {sigma:>7} {row['hits']:>5}  {belief:.2f}"
