"""Recorded pairs in place of a stereo camera: a folder with a manifest and pictures.

The manifest is a JSON object: ``width``, ``height`` (px), ``focal_px``, ``baseline_mm`` and ``pairs``, a list of
``{"left", "right"}`` with paths under the folder. ``principal_px`` [x, y] where it is not the middle, ``disparity_offset_px``
where it is known (with ``disparity_offset_std_px`` and ``scale_std``, how well), and of a pair ``pipe``, ``end`` and
``chainage_m`` (where the camera stood, which looks to where chainages grow) are read where they are there. With
``"rectified": false`` the pictures are as two lenses threw them: focal length and baseline are not asked for, and a calibration
of those lenses must be given. Nothing else is read.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from drivers.base import EndOfRecording, FrameTimeout, RecordingBroken, SensorLost
from drivers.picture_folder import MANIFEST, is_number, read_manifest, read_picture, stays_inside
from drivers.stereo.base import StereoCamera, StereoFrame
from drivers.stereo.rectifier import Calibrated, Rectifier
from estimators.pinhole import Intrinsics


@dataclass(frozen=True)
class PairEntry:
    """One pair of the manifest: the paths as it writes them, and which pipe they show, from which end and where in it, where it
    says so."""

    left: str
    right: str
    pipe: str
    end: str
    chainage_m: float | None


@dataclass(frozen=True)
class PairFolder:
    """A folder of pairs, all of one rig. ``rectifier`` where the pictures in it are not rectified yet."""

    folder: Path
    intrinsics: Intrinsics
    baseline_m: float
    offset_px: float | None
    pairs: tuple[PairEntry, ...]
    rectifier: Rectifier | None = None
    offset_std_px: float = 0.0
    scale_std: float = 0.0


def pair_folder(folder: Path, calibrated: Calibrated | None = None) -> PairFolder:
    """Read the manifest; ``calibrated`` are the lenses of pictures that are not rectified. Raises RecordingBroken; the pictures
    themselves are not opened yet."""
    path, found = folder / MANIFEST, read_manifest(folder)
    if not isinstance(found, Mapping) or not isinstance(found.get("pairs"), list):
        raise RecordingBroken(f"{path} has no list of pairs.")
    if not found["pairs"]:
        raise RecordingBroken(f"{path} names no pair.")
    width, height = (_whole(found, field, path) for field in ("width", "height"))
    entries = tuple(_entry(item, f"{path}, pair {index}") for index, item in enumerate(found["pairs"]))
    if found.get("rectified", True) is False:
        return _as_thrown(folder, (width, height), entries, calibrated)
    if calibrated is not None:
        raise RecordingBroken(f"The pairs of {folder} are rectified already: the calibration of two lenses is not for them.")
    focal = _number(found, "focal_px", path)
    baseline = _number(found, "baseline_mm", path) / 1000.0
    centre = found.get("principal_px", [(width - 1) / 2, (height - 1) / 2])
    if not (isinstance(centre, list) and len(centre) == 2 and all(is_number(value) for value in centre)):
        raise RecordingBroken(f"{path} has a principal_px that is not two numbers.")
    offset = found.get("disparity_offset_px")
    if offset is not None and not is_number(offset):
        raise RecordingBroken(f"{path} has a disparity_offset_px that is not a number.")
    intrinsics = Intrinsics(width, height, focal, focal, float(centre[0]), float(centre[1]))
    offset_std, scale_std = (_std(found, field, path) for field in ("disparity_offset_std_px", "scale_std"))
    known = None if offset is None else float(offset)
    return PairFolder(folder, intrinsics, baseline, known, entries, None, offset_std, scale_std)


def read_pair(folder: PairFolder, entry: PairEntry, number: int = 0) -> StereoFrame:
    """The pictures of one pair, as the camera took them. Raises RecordingBroken."""
    left, right = (read_picture(folder.folder / path) for path in (entry.left, entry.right))
    size = folder.intrinsics.height, folder.intrinsics.width
    for path, picture in ((entry.left, left), (entry.right, right)):
        if picture.shape[:2] != size:
            raise RecordingBroken(
                f"{folder.folder / path} is {picture.shape[1]} x {picture.shape[0]}, its manifest says {size[1]} x {size[0]}."
            )
    if folder.rectifier is not None:
        return folder.rectifier.frame(left, right, time.monotonic_ns(), number, entry.left)
    return StereoFrame(
        left,
        right,
        folder.intrinsics,
        folder.baseline_m,
        folder.offset_px,
        time.monotonic_ns(),
        number,
        source=entry.left,
        offset_std_px=folder.offset_std_px,
        scale_std=folder.scale_std,
    )


class PairReplay(StereoCamera):
    """The pairs of a folder in the manifest's order, each ``dwell`` times, ``rate_hz`` a second, or as fast as they are asked
    for.

    A pair that cannot be read is RecordingBroken, and the next read goes on behind it.
    """

    def __init__(
        self,
        folder: Path | str,
        rate_hz: float | None = None,
        loop: bool = False,
        dwell: int = 1,
        calibrated: Calibrated | None = None,
    ) -> None:
        self._path = Path(folder)
        self._calibrated = calibrated
        self._period_s = 0.0 if rate_hz is None else 1.0 / rate_hz
        self._loop = loop
        self._dwell = dwell
        self._lock = threading.Lock()
        self._folder: PairFolder | None = None
        self._next = 0
        self._due = 0.0
        self.name = f"recording {self._path.name}"

    def _open(self) -> None:
        folder = pair_folder(self._path, self._calibrated)
        with self._lock:
            self._folder, self._next, self._due = folder, 0, time.monotonic()

    def _read(self, timeout_s: float) -> StereoFrame:
        with self._lock:
            folder = self._folder
            if folder is None:
                raise SensorLost(f"The {self.name} is not open.")
            if self._next // self._dwell >= len(folder.pairs) and not self._loop:
                raise EndOfRecording(f"The {self.name} has been played to its end.")
            wait = self._due - time.monotonic()
            if wait > timeout_s:
                time.sleep(timeout_s)
                raise FrameTimeout(f"The {self.name} has no pair yet.")
            time.sleep(max(wait, 0.0))
            self._due = max(self._due, time.monotonic() - self._period_s) + self._period_s
            number = self._next
            self._next += 1  # before it is read: a broken picture is reported once and then left behind
        return read_pair(folder, folder.pairs[number // self._dwell % len(folder.pairs)], number + 1)

    def close(self) -> None:
        """Stop. Never raises, may be called twice."""
        with self._lock:
            self._folder = None


def _as_thrown(
    folder: Path, size: tuple[int, int], entries: tuple[PairEntry, ...], calibrated: Calibrated | None
) -> PairFolder:
    """A folder of pictures that are not rectified."""
    if calibrated is None:
        raise RecordingBroken(
            f"The pairs of {folder} are not rectified: they need a calibration of their two lenses, by a board."
        )
    rectifier = Rectifier(calibrated)
    if rectifier.size != size:
        raise RecordingBroken(f"The calibration is for pictures of {' x '.join(map(str, rectifier.size))}, not for {folder}.")
    return PairFolder(folder, rectifier.intrinsics, rectifier.baseline_m, 0.0, entries, rectifier)


def _entry(item: Any, where: str) -> PairEntry:
    if not isinstance(item, Mapping):
        raise RecordingBroken(f"{where} is not an object.")
    for side in ("left", "right"):
        path = item.get(side)
        if not isinstance(path, str) or not path:
            raise RecordingBroken(f"{where} names no {side} picture.")
        if not stays_inside(path):
            raise RecordingBroken(f"{where} names a picture outside its folder: {path}.")
    chainage = item.get("chainage_m")
    if chainage is not None and not is_number(chainage):
        raise RecordingBroken(f"{where} has a chainage_m that is not a number.")
    return PairEntry(item["left"], item["right"], str(item.get("pipe", "")), str(item.get("end", "")), chainage)


def _number(found: Mapping[str, Any], field: str, path: Path) -> float:
    value = found.get(field)
    if not is_number(value) or not 0 < float(value) < 1e6:
        raise RecordingBroken(f"{path} has no sound {field}: {value}.")
    return float(value)


def _std(found: Mapping[str, Any], field: str, path: Path) -> float:
    value = found.get(field, 0.0)
    if not is_number(value) or float(value) < 0:
        raise RecordingBroken(f"{path} has no sound {field}: {value}.")
    return float(value)


def _whole(found: Mapping[str, Any], field: str, path: Path) -> int:
    value = found.get(field)
    if not isinstance(value, int) or isinstance(value, bool) or not 16 <= value <= 20000:
        raise RecordingBroken(f"{path} has no sound {field}: {value}.")
    return value
