"""Views of a board: pairs of pictures from a folder, or from two cameras as somebody holds the board before them."""

from __future__ import annotations

import json
import re
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import click
import cv2
import numpy as np
from numpy.typing import NDArray

from device.anomaly.result import grey
from device.errors import Invalid
from drivers.base import BadFrame, FrameTimeout, RecordingBroken, SensorLost
from drivers.picture_folder import MANIFEST, read_manifest, read_picture
from drivers.stereo.two_cameras import GrabberPair
from estimators.board.board import Board, Sighting, as_seen_by_both
from estimators.board.calibration import View
from estimators.board.coverage import TILTS
from estimators.board.gathering import Gathering

Picture = NDArray[np.uint8]

_PICTURES = {".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff"}
_SIDE = re.compile(r"(?<![a-z0-9])(left|right|l|r)(?![a-z])", re.IGNORECASE | re.ASCII)
_SHOWN_S = 1.0
_SILENCE_S = 15.0


@dataclass(frozen=True)
class Found:
    """What was seen: the ``views`` with the board in both pictures, and the ``size`` of the pictures."""

    views: list[View]
    size: tuple[int, int]


@dataclass
class Kept:
    """Pictures of the views that were used, saved so that they can be calibrated with again."""

    folder: Path
    names: list[dict[str, str]] = field(default_factory=list)

    def save(self, left: Picture, right: Picture) -> None:
        """Both pictures and the manifest with them. Raises Invalid."""
        pair = {side: f"{len(self.names) + 1:03d}_{side[0].upper()}.png" for side in ("left", "right")}
        if not self.names and (self.folder / MANIFEST).exists():
            raise Invalid(f"{self.folder} holds views already: choose another --keep.")
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            for side, picture in (("left", left), ("right", right)):
                (self.folder / pair[side]).write_bytes(cv2.imencode(".png", picture)[1].tobytes())
            self.names.append(pair)
            about = {"rectified": False, "width": left.shape[1], "height": left.shape[0], "pairs": self.names}
            (self.folder / MANIFEST).write_text(json.dumps(about, indent=2) + "\n", encoding="utf-8")
        except OSError as error:
            raise Invalid(f"The pictures cannot be kept in {self.folder}: {error.strerror or error}.") from error


def sighted(board: Board, left: Picture, right: Picture) -> tuple[Sighting | None, Sighting | None]:
    """The board in both pictures."""
    seen = board.find(grey(left)), board.find(grey(right))
    if seen[0] is not None and seen[1] is not None:
        return seen[0], as_seen_by_both(seen[0], seen[1])
    return seen


def from_folder(board: Board, folder: Path) -> Found:
    """The views of a folder of pairs. Each pair says on stderr what was seen of it. Raises Invalid."""
    views: list[View] = []
    size: tuple[int, int] | None = None
    for left, right in pairs_of(folder):
        pictures = [_read(path) for path in (left, right)]
        sizes = {(one.shape[1], one.shape[0]) for one in pictures} | ({size} if size is not None else set())
        if len(sizes) > 1:
            raise Invalid(f"{left.name} and {right.name} are not of the size of the others: {_sizes(sizes)}.")
        (size,) = sizes
        seen = sighted(board, *pictures)
        if seen[0] is None or seen[1] is None:
            missing = " and ".join(side for side, one in zip(("left", "right"), seen, strict=True) if one is None)
            _say(f"{left.name}: no board in the {missing} picture")
            continue
        blur = max(one.blur_px for one in seen if one is not None)
        _say(f"{left.name}: {len(seen[0].ids)} and {len(seen[1].ids)} corners, edges {blur:.1f} px soft")
        views.append(View(left.name, seen[0], seen[1]))
    if size is None:
        raise Invalid(f"The folder {folder} holds no pair of pictures.")
    return Found(views, size)


def pairs_of(folder: Path) -> list[tuple[Path, Path]]:
    """The pairs of a folder: those of its manifest, those of its folders left and right, or those whose names differ by left
    and right, or L and R, alone. Raises Invalid."""
    if not folder.is_dir():
        raise Invalid(f"There is no folder {folder}.")
    if (folder / MANIFEST).is_file():
        return list(_named(folder))
    sides: dict[str, dict[str, Path]] = {}
    for path in sorted(folder.rglob("*")):
        name = path.relative_to(folder).as_posix()
        marks = list(_SIDE.finditer(name))
        if path.suffix.lower() not in _PICTURES or not marks:
            continue
        mark = marks[-1]
        common = name[: mark.start()] + name[mark.end() :]
        sides.setdefault(common, {})[mark[1][0].lower()] = path
    found = [(pair["l"], pair["r"]) for pair in sides.values() if len(pair) == 2]
    if not found:
        raise Invalid(f"The folder {folder} holds no pairs: name them 01_L.png and 01_R.png, or put them into left and right.")
    return found


def _named(folder: Path) -> Iterator[tuple[Path, Path]]:
    try:
        for pair in read_manifest(folder)["pairs"]:
            yield folder / str(pair["left"]), folder / str(pair["right"])
    except RecordingBroken as error:
        raise Invalid(str(error)) from error
    except (KeyError, TypeError) as error:
        raise Invalid(f"{folder / MANIFEST} names no pairs that can be read: {error}.") from error


@dataclass(frozen=True)
class Look:
    """What both cameras saw at one moment, (H, W, 3) each, the board in either of them, and why it was not kept; empty where it
    was. ``gathering`` is what was kept until then."""

    pictures: tuple[Picture, Picture]
    seen: tuple[Sighting | None, Sighting | None]
    why: str
    gathering: Gathering

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) of the pictures."""
        return self.pictures[0].shape[1], self.pictures[0].shape[0]


def looks(board: Board, cameras: GrabberPair, go_on: Callable[[], bool] = lambda: True) -> Iterator[Look]:
    """Every look at the board until there is enough, or not ``go_on``; the cameras are closed at the end. Raises Invalid where
    nothing comes or nothing can be done with it, SensorMissing, SensorLost."""
    cameras.open()
    gathering: Gathering | None = None
    heard = time.monotonic()
    try:
        while (gathering is None or not gathering.enough) and go_on():
            try:
                left, right = (frame.image for frame in cameras.read(1.0))
            except FrameTimeout as error:
                if time.monotonic() - heard > _SILENCE_S:
                    raise Invalid(str(error)) from None
                continue
            except BadFrame:
                continue  # the next one is whole
            heard = time.monotonic()
            if left.shape != right.shape:
                sizes = _sizes({(one.shape[1], one.shape[0]) for one in (left, right)})
                raise Invalid(f"The two cameras send pictures of different size: {sizes}.")
            if gathering is None:
                gathering = Gathering(board, (left.shape[1], left.shape[0]))
            seen = sighted(board, left, right)
            why = gathering.take(f"view {len(gathering.views) + 1}", *seen)
            yield Look((left, right), seen, why, gathering)
    finally:
        cameras.close()


def from_cameras(board: Board, cameras: GrabberPair, keep: Kept | None) -> Found:
    """Views as somebody shows the board to both cameras, until there is enough or Ctrl-C. Raises Invalid, SensorMissing,
    SensorLost."""
    last: Look | None = None
    shown = 0.0
    _say("Hold the board still before both cameras, then elsewhere; Ctrl-C ends it.")
    try:
        for look in looks(board, cameras):
            last = look
            if not look.why:
                if keep is not None:
                    keep.save(*look.pictures)
                _say(_progress(look.gathering))
            elif sys.stderr.isatty() and time.monotonic() - shown > _SHOWN_S:
                shown = time.monotonic()
                click.echo(f"\r{look.why}; {look.gathering.wanted() or 'enough'}".ljust(78), err=True, nl=False)
    except KeyboardInterrupt:
        _say("Ended; what was shown is calibrated with.")
    except SensorLost as error:
        if last is None:
            raise
        _say(f"{error} What was shown until now is calibrated with.")
    return Found([], (0, 0)) if last is None else Found(last.gathering.views, last.size)


def _progress(gathering: Gathering) -> str:
    """How far it has come, and what to show next."""
    covered = gathering.covered()
    left, right = (f"{100 * share:.0f} %" for share in covered.shares)
    tilts = ", ".join(f"{name} {count}" for name, count in zip(TILTS, covered.tilts, strict=True))
    wanted = gathering.wanted() or "that is enough"
    return (
        f"{len(gathering.views)} views; covered {left} of the left and {right} of the right picture; tilted {tilts}; {wanted}"
    )


def _read(path: Path) -> Picture:
    try:
        return np.asarray(read_picture(path, cv2.IMREAD_GRAYSCALE), dtype=np.uint8)
    except RecordingBroken as error:
        raise Invalid(str(error)) from error


def _sizes(sizes: set[tuple[int, int]]) -> str:
    return " and ".join(f"{width} x {height}" for width, height in sorted(sizes))


def _say(sentence: str) -> None:
    click.echo(f"borescout: {sentence}", err=True)
