"""``borescout anomaly``: the anomaly survey in the terminal, on recorded pairs or in the virtual sewer."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click
import cv2
import numpy as np

from device.anomaly.calibration import RigSource, load_calibration
from device.anomaly.picture import deviation_overlay, heat_map
from device.errors import Invalid
from device.json_text import dumps
from device.surveys.anomaly_result import inspect, refused
from drivers.base import DriverError
from drivers.registry import open_stereo_camera
from drivers.stereo.base import StereoFrame
from drivers.stereo.replay import pair_folder, read_pair
from estimators.anomaly.pair import PairFindings

PICTURE_WIDTH = 960


@click.command()
@click.option("--replay", type=click.Path(path_type=Path), help="A folder of recorded pairs with a manifest.")
@click.option("--virtual", is_flag=True, help="A stereo camera in the virtual sewer.")
@click.option("--seed", type=click.IntRange(0), default=1, show_default=True, help="With --virtual: which sewer.")
@click.option("--pairs", type=click.IntRange(1), default=6, show_default=True, help="With --virtual: how many pairs.")
@click.option("--calibration", type=click.Path(path_type=Path), help="A file of borescout calibrate stereo.")
@click.option("--pictures", type=click.Path(path_type=Path, file_okay=False), help="Save overlays and heat maps here (.png).")
@click.option("--json", "as_json", is_flag=True, help="One JSON object a line instead of a table.")
def anomaly(
    replay: Path | None,
    virtual: bool,
    seed: int,
    pairs: int,
    calibration: Path | None,
    pictures: Path | None,
    as_json: bool,
) -> int:
    """See where a pipe's wall deviates, from stereo."""
    if (replay is not None) + virtual != 1:
        raise Invalid("Choose one of --replay and --virtual." if virtual else "Say what to look at: --replay or --virtual.")
    cv2.setNumThreads(1)  # the box has other things to do
    source = RigSource(None if calibration is None else load_calibration(calibration))
    frames = _replayed(replay) if replay is not None else _driven(seed, pairs)
    if pictures is not None:
        _make(pictures)
    headed = as_json
    unread = total = 0
    for names, frame in frames:
        total += 1
        findings = None
        if isinstance(frame, DriverError):
            unread += 1
            _warn(str(frame))
            result, seconds = refused("unreadable", str(frame)), 0.0
        else:
            begun = time.perf_counter()
            result, findings = inspect(frame.left, frame.right, source.rig(frame))
            seconds = time.perf_counter() - begun
            if pictures is not None and findings is not None:
                _save(pictures, Path(names["left"]).stem, frame, findings)
        found = {**names, **result, "seconds": round(seconds, 3)}
        if not headed:
            click.echo(_HEADING)
            headed = True
        click.echo(dumps(found) if as_json else _line(found))
    if unread:
        _warn(f"{unread} of {total} pairs could not be read.")
    return 1 if unread else 0


Names = dict[str, str]


def _replayed(path: Path) -> Iterator[tuple[Names, StereoFrame | DriverError]]:
    """Every pair of the manifest, in its order; the error in place of one that cannot be read."""
    folder = pair_folder(path)
    for number, entry in enumerate(folder.pairs):
        names = {"left": entry.left, "right": entry.right, "pipe": entry.pipe, "end": entry.end}
        try:
            yield names, read_pair(folder, entry, number)
        except DriverError as error:
            yield names, error


def _driven(seed: int, pairs: int) -> Iterator[tuple[Names, StereoFrame | DriverError]]:
    """Pairs along the virtual sewer."""
    camera = open_stereo_camera("virtual", seed=seed)
    camera.open()
    try:
        for _ in range(pairs):
            frame = camera.read()
            yield {"left": f"virtual {frame.number}"}, frame
    finally:
        camera.close()


def _make(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise Invalid(f"The folder {folder} cannot be made: {error.strerror or error}.") from error


def _save(folder: Path, name: str, frame: StereoFrame, findings: PairFindings) -> None:
    """The reference picture with the deviation on it, and the unrolled wall."""
    step = max(frame.left.shape[1] / PICTURE_WIDTH, 1.0)
    size = round(frame.left.shape[1] / step), round(frame.left.shape[0] / step)
    small = cv2.resize(frame.left, size, interpolation=cv2.INTER_AREA)
    colour = cv2.cvtColor(small, cv2.COLOR_GRAY2BGR) if small.ndim == 2 else small
    drawn = {
        f"{name}_overlay.png": deviation_overlay(np.asarray(colour, np.uint8), step, findings),
        f"{name}_wall.png": heat_map(findings.map),
    }
    for file, picture in drawn.items():
        encoded = cv2.imencode(".png", picture)[1]
        try:
            (folder / file).write_bytes(encoded.tobytes())
        except OSError as error:
            raise Invalid(f"The picture {folder / file} cannot be written: {error.strerror or error}.") from error


_HEADING = f"{'inward':>8} {'outward':>8} {'width':>9} {'95 % interval':>17} {'height':>8} {'seen':>6} {'regions':>8}  pair"


def _line(found: dict[str, Any]) -> str:
    if not found["fitted"]:
        return f"{'-':>8} {'-':>8} {'-':>9} {'-':>17} {'-':>8} {'-':>6} {'-':>8}  {found['left']}: {found['message']}"
    interval = found["width_interval_mm"]
    between = "-" if interval is None else f"{interval[0]:.0f} to {interval[1]:.0f} mm"
    unexpected = sum(not region["expected"] for region in found["regions"])
    return (
        f"{_mm(found['score_mm'], 2):>8} {_mm(found['outward_mm'], 2):>8} {_mm(found['width_mm'], 0):>9} {between:>17} "
        f"{_mm(found['height_mm'], 0):>8} {100 * found['coverage']:>4.0f} % {unexpected:>8}  {found['left']}"
    )


def _mm(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f} mm"


def _warn(sentence: str) -> None:
    click.echo(f"borescout: {sentence}", err=True)
