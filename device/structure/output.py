"""The semantic map as tables in the terminal."""

from __future__ import annotations

from typing import Any

import click


def print_structure(told: dict[str, Any]) -> None:
    """Pipes, objects with their pipes, and, of a virtual chamber, the scores."""
    click.echo(
        f"{len(told['pipes'])} pipes, {len(told['objects'])} objects, {len(told['edges'])} connections, {told['scans']} scans"
    )
    if not told["consistent"]:
        click.echo("Something speaks against this map: do not rely on it.")
    for warning in told["warnings"]:
        click.echo(f"  {warning}")
    for pipe in told["pipes"]:
        ends = "  to ".join(" ".join(f"{x:7.3f}" for x in pipe[end]) for end in ("from", "to"))
        click.echo(f"  pipe {pipe['number']:3d}  {ends}  {pipe['length_m']:.2f} m, seen {pipe['sightings']} times")
    for thing in told["objects"]:
        pipes = ", ".join(f"{e['pipe']}" for e in told["edges"] if e["object"] == thing["number"])
        state = {True: ", open", False: ", closed", None: ""}[thing["open"]]
        where = " ".join(f"{x:7.3f}" for x in thing["position"])
        click.echo(f"  object {thing['number']:3d}  {where}  {thing['class']} ({thing['belief']:.2f}){state}, on pipes {pipes}")
    if told["next_view"] is not None:
        click.echo(f"  {told['next_view']['prompt']}")
    if "scores" in told:
        scores = told["scores"]
        for stage, score in scores["recognition"].items():
            click.echo(f"  {stage:18s} accuracy {score['accuracy']:.2f}, mean F1 {score['mean_f1']:.2f}")
        click.echo(
            f"  edges F1 {scores['edge_f1']:.2f}, position {scores['position_rms_m']:.3f} m RMS, smoothed "
            f"{scores['smoothed_rms_m']:.3f} m, "
            f"dead reckoning {scores['dead_reckoning_rms_m']:.3f} m"
        )
    click.echo(f"  {told['seconds_per_scan']:.2f} s a scan")
