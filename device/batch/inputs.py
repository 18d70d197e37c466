"""What of a folder can be converted: videos, folders of stills, recordings of ours, tables of detections with their rig."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from device.errors import Invalid

Kind = Literal["video", "stills", "recording", "detections"]
VIDEOS = frozenset((".mp4", ".avi", ".mkv", ".mov", ".mpg", ".mpeg", ".m4v", ".wmv", ".ts", ".webm"))
_PICTURES = frozenset((".jpg", ".jpeg", ".png"))


@dataclass(frozen=True)
class Input:
    """``name`` is its path below the folder, unique in it; ``key`` changes when the file does."""

    name: str
    path: Path
    kind: Kind
    key: str


def inputs(folder: Path) -> list[Input]:
    """Everything that can be converted, by name. Raises Invalid where the folder is none or holds nothing."""
    if not folder.is_dir():
        raise Invalid(f"There is no folder {folder}.")
    found = []
    for path in sorted(folder.rglob("*")):
        kind = _kind(path)
        if kind is not None and not any(part.startswith(".") for part in path.relative_to(folder).parts):
            found.append(Input(str(path.relative_to(folder)), path, kind, _key(path)))
    if not found:
        raise Invalid(
            f"The folder {folder} holds nothing to convert: no video, no folder of stills named by milliseconds, no .mcap,"
            " no NAME.csv of detections with its NAME.json."
        )
    return found


def _kind(path: Path) -> Kind | None:
    suffix = path.suffix.lower()
    if path.is_dir():
        return "stills" if _is_stills(path) else None
    if suffix in VIDEOS:
        return "video"
    if suffix == ".mcap":
        return "recording"
    if suffix == ".csv" and path.with_suffix(".json").is_file():
        return "detections"
    return None


def _is_stills(folder: Path) -> bool:
    """Pictures named by milliseconds, at least two."""
    named = 0
    for path in folder.iterdir():
        if path.suffix.lower() in _PICTURES and path.stem.isdigit():
            named += 1
            if named == 2:
                return True
    return False


def _key(path: Path) -> str:
    stat = path.stat()
    return f"{stat.st_size}-{stat.st_mtime_ns}"
