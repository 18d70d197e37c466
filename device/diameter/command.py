"""``borescout measure``: the diameter survey in the terminal, on recordings or on a camera."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click

from device.cli import camera_options, chosen_cameras
from device.config import load_settings
from device.daemon import Device
from device.diameter.judging import no_picture
from device.diameter.result import (
    SINGLE_FRAME_RESAMPLES,
    PipeContext,
    Result,
    diameter_result,
    frame_result,
)
from device.errors import Invalid
from device.json_text import dumps
from drivers.base import DriverError, EndOfRecording
from drivers.depth.base import DepthFrame
from drivers.depth.replay import PLAYBACK_SUFFIXES, ManifestEntry, ReplayCamera, manifest_entries, read_entry
from estimators.frame import FrameEstimate, estimate_frame
from estimators.picture import picture_quality
from estimators.recording import MIN_FRAMES_FOR_SPREAD

_PER_FRAME_FIELDS = ("verdict", "reasons", "diameter_mm", "interval_mm", "radius_std_mm")
FIRST_FRAME_S = 30.0


@click.command()
@camera_options
@click.option("--per-frame", is_flag=True, help="With --replay: every depth picture is a result of its own.")
@click.option("--json", "as_json", is_flag=True, help="One JSON object a line instead of a table.")
@click.option("--frames", type=click.IntRange(1, 500), help="Frames of one recording (50).")
def measure(
    virtual: bool,
    tof: bool,
    description: Path | None,
    replay: Path | None,
    cameras: tuple[str, ...],
    data_dir: Path | None,
    config: Path | None,
    per_frame: bool,
    as_json: bool,
    frames: int | None,
) -> int:
    """Measure the diameter of a pipe."""
    chosen = chosen_cameras(virtual, tof, description, replay, cameras)
    if not chosen:
        raise Invalid("Say what to measure with: --virtual, --replay or --camera.")
    if replay is not None:
        table = _Table(as_json)
        return _frames(replay, table) if per_frame else _recordings(replay, frames, table)
    if per_frame:
        raise Invalid("The option --per-frame goes with --replay.")
    settings = load_settings(config, data_dir=data_dir, frames=frames, **chosen)
    device = Device(settings)
    try:
        return measure_live(device.start(), as_json)
    finally:
        device.close()


class _Table:
    """Results on stdout: one JSON object a line, or a small table whose progress goes to stderr."""

    def __init__(self, as_json: bool) -> None:
        self._as_json = as_json
        self._headed = False

    def add(self, name: str, result: dict[str, Any]) -> None:
        """One result, shown at once."""
        if self._as_json:
            click.echo(dumps(result))
            return
        if not self._headed:
            click.echo(f"{'diameter':>9}  {'95 % interval':>17}  {'DN':<8}{'verdict':<8} reasons")
            self._headed = True
        diameter, interval, dn = result["diameter_mm"], result["interval_mm"], result.get("dn")
        shown = "-" if diameter is None else f"{diameter:.1f} mm"
        between = "-" if interval is None or None in interval else f"{interval[0]:.0f} to {interval[1]:.0f} mm"
        why = " ".join(result["reasons"]) or "-"
        click.echo(f"{shown:>9}  {between:>17}  {(dn and dn['name']) or '-':<8}{result['verdict']:<8} {why}  {name}")

    def progress(self, done: int, wanted: int) -> None:
        """A line on stderr that is written over, where somebody is looking."""
        if not self._as_json and sys.stderr.isatty():
            click.echo(f"\r{done} of {wanted} ", err=True, nl=done >= wanted)


def _frames(folder: Path, table: _Table) -> int:
    """Every depth picture of the manifest, in its order. A picture that cannot be read has its line too."""
    if not folder.is_dir():
        raise Invalid(f"There is no folder {folder}; --per-frame needs one with a manifest.")
    entries = manifest_entries(folder)
    unread = 0
    for index, entry in enumerate(entries):
        try:
            frame = read_entry(folder, entry)
        except DriverError as error:
            unread += 1
            _warn(str(error))
            result, seconds = no_picture("camera_lost", None, ""), 0.0
        else:
            begun = time.perf_counter()
            result = frame_result(frame.depth, frame.intrinsics, frame.depth_unit_m)
            seconds = time.perf_counter() - begun
        fields = {field: result[field] for field in _PER_FRAME_FIELDS}
        table.add(entry.depth, {"depth": entry.depth, **fields, "seconds": round(seconds, 4)})
        table.progress(index + 1, len(entries))
    return _count_unread(unread, len(entries))


def _recordings(source: Path, most_frames: int | None, table: _Table) -> int:
    """Every recording of a folder, or the one in a .db3 or .bag file, as one result each."""
    unread = total = 0
    recordings = _by_recording(source)
    for count, (folder, name, entries) in enumerate(recordings):
        estimates: list[FrameEstimate] = []
        quality = None
        resamples = SINGLE_FRAME_RESAMPLES if entries is not None and len(entries) < MIN_FRAMES_FOR_SPREAD else 0
        for frame in _readable(source, entries, most_frames):
            total += 1
            if frame is None:
                unread += 1
                continue
            estimates.append(
                estimate_frame(frame.depth, frame.intrinsics, frame.depth_unit_m, seed=len(estimates), resamples=resamples)
            )
            if quality is None and frame.color is not None:
                quality = picture_quality(frame.color)
        result = diameter_result(estimates, PipeContext(), quality) if estimates else no_picture("camera_lost", None, "replay")
        label = folder if folder.endswith(name) else f"{folder} {name}".strip()
        table.add(label, {"recording": name, "folder": folder, **result, "camera": "replay"})
        table.progress(count + 1, len(recordings))
    return _count_unread(unread, total)


def _by_recording(source: Path) -> list[tuple[str, str, list[ManifestEntry] | None]]:
    """(folder, name, entries) of every recording; entries None for a file. A name in two folders stands for two recordings."""
    if source.suffix.lower() in PLAYBACK_SUFFIXES and source.is_file():
        return [("", source.name, None)]
    found: dict[tuple[str, str], list[ManifestEntry]] = {}
    for entry in manifest_entries(source):
        found.setdefault((entry.depth.rpartition("/")[0], entry.recording), []).append(entry)
    return [(folder, recording, entries) for (folder, recording), entries in found.items()]


def _readable(source: Path, entries: list[ManifestEntry] | None, most_frames: int | None) -> Iterator[DepthFrame | None]:
    """The frames of one recording; None for one that cannot be read, after a sentence on stderr."""
    if entries is None:
        camera = ReplayCamera(source)
        camera.open()
        try:
            for _ in range(most_frames or 50):
                yield camera.read(timeout_s=5.0)
        except EndOfRecording:
            return
        finally:
            camera.close()
        return
    for entry in entries[:most_frames]:
        try:
            yield read_entry(source, entry)
        except DriverError as error:
            _warn(str(error))
            yield None


def measure_live(device: Device, as_json: bool) -> int:
    """Measure with the cameras; where a second position is needed and somebody is there to move the box, ask for it."""
    table = _Table(as_json)
    _wait_for_a_camera(device)
    survey_id: int | None = None
    while True:
        survey_id, state, message = _measure_once(device, table, survey_id)
        survey = device.survey(survey_id)
        result: Result = survey["result"]
        if state != "saved":
            _warn(message)
        second = "second_position" in result["reasons"] and sys.stdin.isatty() and not as_json
        if not second:
            break
        _show(table, survey_id, result)
        if not click.confirm("Move the box to the middle of the pipe. Measure again?", default=True, err=True):
            return 0
    _show(table, survey_id, result)
    return 0 if state == "saved" else 1


def _show(table: _Table, survey_id: int, result: Result) -> None:
    table.add(f"survey {survey_id}", {"survey": survey_id, **result})
    for prompt in result["prompts"]:
        _warn(f"{prompt['reason']} {prompt['remedy']}")


def _wait_for_a_camera(device: Device) -> None:
    deadline = time.monotonic() + FIRST_FRAME_S
    while time.monotonic() < deadline:
        cameras = device.status()["cameras"]
        if all(camera["state"] in ("up", "lost") for camera in cameras):
            break
        time.sleep(0.05)
    if not any(camera["state"] == "up" for camera in device.status()["cameras"]):
        raise Invalid(" ".join(camera["message"] for camera in device.status()["cameras"]))


def _measure_once(device: Device, table: _Table, survey_id: int | None) -> tuple[int, str, str]:
    """(survey, state, message) of one measurement. Ctrl-C cancels it."""
    subscription = device.subscribe()
    number: int = device.measure(survey_id=survey_id)["survey_id"]
    try:
        while True:
            event = subscription.get(1.0)
            if event is None or event.name != "measurement":
                continue
            table.progress(event.data["frames_done"], event.data["frames_wanted"])
            if event.data["state"] in ("saved", "failed"):
                return number, event.data["state"], event.data["message"]
            if event.data["state"] == "cancelled":
                raise click.Abort
    except KeyboardInterrupt:
        device.cancel()
        raise click.Abort from None
    finally:
        subscription.close()


def _count_unread(unread: int, total: int) -> int:
    if unread:
        _warn(f"{unread} of {total} pictures could not be read.")
    return 1 if unread else 0


def _warn(sentence: str) -> None:
    click.echo(f"borescout: {sentence}", err=True)
