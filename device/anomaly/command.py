"""``borescout anomaly``: the anomaly survey in the terminal, on recorded pairs, in the virtual sewer or on a camera."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click
import cv2

from device.anomaly.along import PlacedScan, joined, placed_scan
from device.anomaly.calibration import RigSource, load_calibration
from device.anomaly.looking import Names, Pair, looking
from device.anomaly.picture import deviation_overlay, heat_map, reference_picture
from device.anomaly.result import inspect, refused
from device.anomaly.rig import StereoEye, make_stereo
from device.config import LIVE_STEREO, StereoSettings
from device.errors import Invalid
from device.json_text import dumps
from drivers.base import DriverError
from drivers.registry import open_stereo_camera
from drivers.stereo.base import StereoFrame
from drivers.stereo.replay import pair_folder, read_pair
from estimators.anomaly.pair import PairFindings


@click.command()
@click.option("--replay", type=click.Path(path_type=Path), help="A folder of recorded pairs with a manifest.")
@click.option("--virtual", is_flag=True, help="A stereo camera in the virtual sewer.")
@click.option("--camera", type=click.Choice(LIVE_STEREO), help="A stereo camera; pair: two plain ones, by --left and --right.")
@click.option("--serial", help="With --camera: which one of several.")
@click.option("--left", help="With --camera pair: the V4L2 device of the left camera, such as /dev/video0.")
@click.option("--right", help="With --camera pair: the right one's.")
@click.option("--fps", type=click.IntRange(1, 90), help="With --camera: pairs a second to ask for.")
@click.option("--codec", help="With --camera pair: four letters such as MJPG, where both cameras share a slow bus.")
@click.option("--seed", type=click.IntRange(0), default=1, show_default=True, help="With --virtual: which sewer.")
@click.option("--pairs", type=click.IntRange(1), help="How many pairs: 6 with --virtual, until Ctrl-C with --camera.")
@click.option("--calibration", type=click.Path(path_type=Path), help="A file of borescout calibrate stereo.")
@click.option("--pictures", type=click.Path(path_type=Path, file_okay=False), help="Save overlays and heat maps here (.png).")
@click.option(
    "--along", type=click.Path(path_type=Path, dir_okay=False), help="With --replay: join the pairs along their pipes, .json."
)
@click.option("--json", "as_json", is_flag=True, help="One JSON object a line instead of a table.")
def anomaly(
    replay: Path | None,
    virtual: bool,
    camera: str | None,
    serial: str | None,
    left: str | None,
    right: str | None,
    fps: int | None,
    codec: str | None,
    seed: int,
    pairs: int | None,
    calibration: Path | None,
    pictures: Path | None,
    along: Path | None,
    as_json: bool,
) -> int:
    """See where a pipe's wall deviates, from stereo."""
    asked = (replay is not None) + virtual + (camera is not None)
    if asked != 1:
        raise Invalid(("Choose one of" if asked else "Say what to look at:") + " --replay, --virtual or --camera.")
    asked_of_camera = {"serial": serial, "fps": fps, "codec": codec}
    options = {name: value for name, value in asked_of_camera.items() if value is not None}
    if camera is None and (options or left or right):
        raise Invalid("The options --serial, --left, --right, --fps and --codec go with --camera.")
    if along is not None and replay is None:
        raise Invalid("Pairs are joined along their pipes with --replay: their manifest says where they were taken.")
    cv2.setNumThreads(1)  # the box has other things to do
    eye: StereoEye | None = None
    if camera is not None:
        eye = _eye(camera, left, right, calibration, options)
        source = eye.source
        frames = looking(eye.feed, pairs)
    else:
        source = RigSource(None if calibration is None else load_calibration(calibration))
        if virtual and source.lenses is not None:
            raise Invalid(f"The calibration {calibration} is of two plain cameras: virtual pairs are rectified already.")
        frames = _replayed(replay, source) if replay is not None else _driven(seed, 6 if pairs is None else pairs)
    if pictures is not None:
        _make(pictures)
    told = _Told(as_json)
    try:
        for names, frame in frames:
            told.pair(names, frame, source, pictures)
    except KeyboardInterrupt:
        if eye is None:
            raise
        _warn(f"Ended after {told.total} pairs.")
    finally:
        if eye is not None:
            eye.feed.close()
    if along is not None:
        told.write_along(along)
    if told.unread:
        _warn(f"{told.unread} of {told.total} pairs could not be read.")
    return 1 if told.unread else 0


class _Told:
    """The results as they come, counted."""

    def __init__(self, as_json: bool) -> None:
        self._as_json = as_json
        self._placed: dict[str, list[PlacedScan]] = {}
        self.total = self.unread = 0

    def pair(self, names: Names, frame: StereoFrame | DriverError, source: RigSource, pictures: Path | None) -> None:
        """Read one pair, save its pictures, print its line."""
        self.total += 1
        findings = None
        if isinstance(frame, DriverError):
            self.unread += 1
            _warn(str(frame))
            result, seconds = refused("unreadable", str(frame)), 0.0
        else:
            begun = time.perf_counter()
            result, findings = inspect(frame.left, frame.right, source.rig(frame))
            seconds = time.perf_counter() - begun
            if pictures is not None and findings is not None:
                _save(pictures, Path(names["left"]).stem, frame, findings)
        found = {**names, **result, "seconds": round(seconds, 3)}
        if findings is not None and names.get("chainage_m") is not None:
            self._placed.setdefault(names["pipe"], []).append(placed_scan(self.total, result, names["chainage_m"]))
        if self.total == 1 and not self._as_json:
            click.echo(_HEADING)
        click.echo(dumps(found) if self._as_json else _line(found))

    def write_along(self, path: Path) -> None:
        """What the pairs of each pipe tell together, as ``device.anomaly.along.joined``; pairs are told by their numbers."""
        if not self._placed:
            raise Invalid("There is nothing to join: no pair that was fitted has a chainage_m in the manifest.")
        pipes = [{"pipe": pipe, **joined(placed)} for pipe, placed in self._placed.items()]
        try:
            path.write_text(dumps(pipes) + "\n", encoding="utf-8")
        except OSError as error:
            raise Invalid(f"{path} cannot be written: {error.strerror or error}.") from error


def _eye(camera: str, left: str | None, right: str | None, calibration: Path | None, options: dict[str, Any]) -> StereoEye:
    given = {
        "driver": camera,
        "left": left or "",
        "right": right or "",
        "calibration": calibration,
        "options": options,
    }
    eye = make_stereo(StereoSettings.model_validate(given), 0, lambda: None)
    assert eye is not None  # a driver was named
    if camera == "pair" and eye.source.lenses is None:
        raise Invalid("Two plain cameras need a calibration by a board: see borescout calibrate stereo --board.")
    return eye


def _replayed(path: Path, source: RigSource) -> Iterator[Pair]:
    """Every pair of the manifest, in its order; the error in place of one that cannot be read."""
    folder = pair_folder(path, source.lenses)
    for number, entry in enumerate(folder.pairs):
        names: Names = {"left": entry.left, "right": entry.right, "pipe": entry.pipe, "end": entry.end}
        if entry.chainage_m is not None:
            names["chainage_m"] = entry.chainage_m
        try:
            yield names, read_pair(folder, entry, number)
        except DriverError as error:
            yield names, error


def _driven(seed: int, pairs: int) -> Iterator[Pair]:
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
    reference, step = reference_picture(frame.left)
    drawn = {
        f"{name}_overlay.png": deviation_overlay(reference, step, findings),
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
