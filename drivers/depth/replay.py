"""Recordings in place of a camera: a folder with a manifest and 16-bit pictures, or a .db3 or .bag file of librealsense.

The manifest is a JSON list with one object for each depth picture. Four fields are read and no other: ``depth`` (path of a
16-bit grey PNG under the folder), ``recording`` (its name), ``depth_unit_m`` (metres a unit) and ``intrinsics`` (width, height,
fx, fy, ppx, ppy in pixels, model, coeffs). A colour picture lies beside its depth picture under the same name with ``color``
for ``depth``.
"""

from __future__ import annotations

import logging
import math
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.base import EndOfRecording, FrameTimeout, RecordingBroken, SensorLost
from drivers.depth.base import DepthCamera, DepthFrame, DepthSettings
from drivers.depth.librealsense import LibrealsenseCamera
from drivers.library import library
from drivers.picture_folder import MANIFEST, is_number, read_manifest, read_picture, stays_inside
from estimators.pinhole import Intrinsics

log = logging.getLogger(__name__)

PLAYBACK_SUFFIXES = (".db3", ".bag")


@dataclass(frozen=True)
class ManifestEntry:
    """One depth picture of a recording folder. ``depth`` is its path under the folder, as the manifest writes it."""

    depth: str
    recording: str
    depth_unit_m: float
    intrinsics: Intrinsics


def manifest_entries(folder: Path) -> list[ManifestEntry]:
    """Every depth picture of the manifest, in its order. Raises RecordingBroken; the pictures themselves are not opened yet."""
    path, found = folder / MANIFEST, read_manifest(folder)
    if not isinstance(found, list):
        raise RecordingBroken(f"{path} is not a list of depth pictures.")
    if not found:
        raise RecordingBroken(f"{path} names no depth picture.")
    return [_entry(item, f"{path}, entry {index}") for index, item in enumerate(found)]


def manifest_recordings(folder: Path) -> dict[str, list[ManifestEntry]]:
    """The manifest's depth pictures by recording, both in the manifest's order. Raises RecordingBroken."""
    recordings: dict[str, list[ManifestEntry]] = {}
    for entry in manifest_entries(folder):
        recordings.setdefault(entry.recording, []).append(entry)
    return recordings


def read_entry(folder: Path, entry: ManifestEntry, number: int = 0) -> DepthFrame:
    """The depth picture of one entry, with its colour picture where there is one. Raises RecordingBroken."""
    path = folder / entry.depth
    picture = read_picture(path, cv2.IMREAD_UNCHANGED)
    if picture.dtype != np.uint16 or picture.ndim != 2:
        channels = 1 if picture.ndim == 2 else picture.shape[2]
        raise RecordingBroken(
            f"{path} is no depth picture: {picture.dtype.itemsize * 8} bits in {channels} channel(s), expected 16 bits in one."
        )
    height, width = picture.shape
    if (width, height) != entry.intrinsics.size:
        raise RecordingBroken(
            f"{path} is {width} x {height}, its intrinsics are for {entry.intrinsics.width} x {entry.intrinsics.height}."
        )
    return DepthFrame(
        depth=picture,
        intrinsics=entry.intrinsics,
        depth_unit_m=entry.depth_unit_m,
        monotonic_ns=time.monotonic_ns(),
        number=number,
        color=_color_beside(path),
        source=entry.depth,
    )


class ReplayCamera(DepthCamera):
    """A recording that answers like a camera.

    ``rate_hz`` frames a second, or as fast as they are read where it is None; ``loop`` starts again at the end, where otherwise
    EndOfRecording is raised. Frame numbers count from 1 and go on growing through the loops. ``recording`` picks one of a
    folder.
    """

    def __init__(self, source: Path, rate_hz: float | None = None, loop: bool = False, *, recording: str | None = None) -> None:
        if rate_hz is not None and not (math.isfinite(rate_hz) and rate_hz > 0):
            raise ValueError(f"the rate must be a positive number of frames a second, got {rate_hz}")
        self._source = Path(source)
        self._recording = recording
        self._period_s = None if rate_hz is None else 1.0 / rate_hz
        self._loop = loop
        self._entries: list[ManifestEntry] = []
        self._player: LibrealsenseCamera | None = None
        self._closed = threading.Event()
        self._closed.set()
        self._next = 0
        self._number = 0
        self._due_s = 0.0
        self.name = f"recording {self._source.name}"

    def _open(self) -> None:
        self.close()
        if self._source.suffix.lower() in PLAYBACK_SUFFIXES and not self._source.is_dir():
            if not self._source.is_file():
                raise RecordingBroken(f"There is no recording {self._source}.")
            self._player = LibrealsenseCamera(library("pyrealsense2"), DepthSettings(), recording=self._source, loop=self._loop)
            self._player.open()
        else:
            self._entries = self._chosen()
        self._next = 0
        self._due_s = time.monotonic()
        self._closed.clear()

    def _chosen(self) -> list[ManifestEntry]:
        if self._recording is None:
            return manifest_entries(self._source)
        recordings = manifest_recordings(self._source)
        if self._recording not in recordings:
            raise RecordingBroken(f"The folder {self._source} has no recording {self._recording}.")
        return recordings[self._recording]

    def _read(self, timeout_s: float) -> DepthFrame:
        if self._closed.is_set():
            raise SensorLost(f"The {self.name} is not open.")
        deadline = time.monotonic() + timeout_s
        self._wait_until_due(deadline, timeout_s)
        frame = self._next_of_folder() if self._player is None else self._player.read(max(0.0, deadline - time.monotonic()))
        if self._period_s is not None:
            # a reader that came late does not get the frames it missed in a burst
            self._due_s = max(self._due_s + self._period_s, time.monotonic())
        self._number += 1
        return replace(frame, number=self._number, monotonic_ns=time.monotonic_ns())

    def _wait_until_due(self, deadline: float, timeout_s: float) -> None:
        wait_s = self._due_s - time.monotonic()
        if self._period_s is None or wait_s <= 0:
            return
        if self._closed.wait(min(wait_s, max(0.0, deadline - time.monotonic()))):
            raise SensorLost(f"The {self.name} has been closed.")
        if time.monotonic() < self._due_s:
            raise FrameTimeout(f"The {self.name} sent no picture for {timeout_s:.3g} s.")

    def _next_of_folder(self) -> DepthFrame:
        if self._next >= len(self._entries):
            if not self._loop:
                raise EndOfRecording(f"The {self.name} has been played to its end.")
            self._next = 0
        entry = self._entries[self._next]
        self._next += 1  # before it is read: a broken picture is reported once and then left behind
        return read_entry(self._source, entry)

    def close(self) -> None:
        """Stop. Never raises, may be called twice."""
        self._closed.set()
        player, self._player = self._player, None
        if player is not None:
            player.close()


def _entry(item: Any, where: str) -> ManifestEntry:
    if not isinstance(item, Mapping):
        raise RecordingBroken(f"{where} is not an object.")
    depth = item.get("depth")
    if not isinstance(depth, str) or not depth:
        raise RecordingBroken(f"{where} names no depth picture.")
    if not stays_inside(depth):
        raise RecordingBroken(f"{where} names a depth picture outside its folder: {depth}.")
    recording = item.get("recording", str(PurePosixPath(depth).parent))
    if not isinstance(recording, str):
        raise RecordingBroken(f"{where} has a recording whose name is not text.")
    unit = item.get("depth_unit_m")
    if not is_number(unit) or not 0 < unit < 1:
        raise RecordingBroken(f"{where} has no sound depth unit (metres a unit): {unit}.")
    return ManifestEntry(depth, recording, float(unit), _intrinsics(item.get("intrinsics"), where))


def _intrinsics(found: Any, where: str) -> Intrinsics:
    if not isinstance(found, Mapping):
        raise RecordingBroken(f"{where} has no intrinsics.")
    for field in ("width", "height"):
        if not isinstance(found.get(field), int) or isinstance(found.get(field), bool):
            raise RecordingBroken(f"{where} has intrinsics without a whole {field}.")
    for field in ("fx", "fy", "ppx", "ppy"):
        if not is_number(found.get(field)):
            raise RecordingBroken(f"{where} has intrinsics without a number for {field}.")
    coeffs, model = found.get("coeffs", []), found.get("model", "none")
    if not isinstance(coeffs, list) or len(coeffs) > 5 or not all(is_number(value) for value in coeffs):
        raise RecordingBroken(f"{where} has distortion coefficients that are not up to five numbers.")
    if not isinstance(model, str):
        raise RecordingBroken(f"{where} has a distortion model whose name is not text.")
    padded = tuple(float(value) for value in [*coeffs, 0, 0, 0, 0, 0][:5])
    focal = {field: float(found[field]) for field in ("fx", "fy", "ppx", "ppy")}
    try:
        return Intrinsics(width=found["width"], height=found["height"], model=model, coeffs=padded, **focal)
    except ValueError as error:
        raise RecordingBroken(f"{where} has impossible intrinsics: {error}.") from error


def _color_beside(depth: Path) -> NDArray[np.uint8] | None:
    """The colour picture (h, w, 3) BGR of a depth picture, or None. A broken one is no reason to lose the depth."""
    if not depth.name.startswith("depth"):
        return None
    path = depth.with_name("color" + depth.name.removeprefix("depth"))
    if not path.is_file():
        return None
    try:
        return np.asarray(read_picture(path), dtype=np.uint8)
    except RecordingBroken as error:
        log.warning("a colour picture is left out: %s", error)
        return None
