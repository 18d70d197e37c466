"""``borescout replay``: a recorded survey computed again, all at once or step by step."""

from __future__ import annotations

from pathlib import Path

import click

from device.json_text import dumps
from device.replay.survey import Options, Outcome, replay

_SHOWN = 20


@click.command("replay")
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--step", is_flag=True, help="One frame at a time; Enter goes on.")
@click.option("--json", "as_json", is_flag=True, help="The findings and the comparison as one JSON object.")
@click.option("--model", type=click.Path(path_type=Path), help="The detector's model, where it is not a shipped one.")
@click.option("--recorded-detections", is_flag=True, help="Do not ask the detector again, take what it said then.")
@click.option("--workers", type=click.IntRange(1, 8), default=2, help="Processes for estimates (2).")
def replay_recording(file: Path, step: bool, as_json: bool, model: Path | None, recorded_detections: bool, workers: int) -> int:
    """Compute a recorded survey again and compare with what it found."""
    options = Options(model, recorded_detections, 1 if step else workers)
    outcome = replay(file, options, _pause if step else lambda line: None)
    if as_json:
        click.echo(dumps(outcome.to_json()))
    else:
        _show(outcome)
    return 0 if outcome.equal is not False else 1


def _pause(line: str) -> None:
    click.echo(line, err=True, nl=False)
    try:
        input()
    except EOFError:  # nobody is there to press Enter: go on
        click.echo("", err=True)


def _show(outcome: Outcome) -> None:
    speed = outcome.recorded_s / outcome.replay_s if outcome.replay_s > 0 else 0.0
    click.echo(f"survey {outcome.survey_id}, {outcome.kind}: {_what(outcome)}")
    click.echo(f"{outcome.frames} frames of {outcome.recorded_s:.1f} s in {outcome.replay_s:.1f} s, {speed:.1f} times as fast")
    if outcome.missing:
        click.echo(f"{outcome.missing} of the things it consumed are not in the recording: it cannot come to the same")
    for name, (then, now) in outcome.versions.items():
        click.echo(f"{name} was {then or 'not there'}, is {now or 'not there'}")
    if outcome.logged is None:
        click.echo("the recording ends before the survey's findings: there is nothing to compare with")
    elif outcome.equal:
        click.echo("equal, bit for bit")
    else:
        told = "within the tolerance" if outcome.within_tolerance else "NOT within the tolerance"
        click.echo(f"{len(outcome.differences)} values differ, {told}:")
        for found in outcome.differences[:_SHOWN]:
            click.echo(f"  {found.where}: {found.logged} then, {found.replayed} now")


def _what(outcome: Outcome) -> str:
    found = outcome.findings
    if outcome.kind == "diameter":
        conclusion = found["conclusion"]
        shown = "no diameter" if conclusion["diameter_mm"] is None else f"{conclusion['diameter_mm']} mm"
        return f"{shown}, {conclusion['verdict']}"
    if outcome.kind == "anomaly":
        result = found["result"]
        return f"{len(result['regions'])} deviations" if result["fitted"] else f"refused: {result['reasons'][0]}"
    if outcome.kind == "structure":
        return f"{len(found.get('pipes', ()))} pipes, {len(found.get('objects', ()))} objects"
    return f"{len(found['landmarks'])} landmarks, {len(found['rings'])} joints"
