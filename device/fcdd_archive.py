"""Labelled pictures on disk: a folder with a manifest as ``borescout fcdd`` reads it, or one folder per class."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from device.errors import Invalid

PICTURES = {".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff", ".webp"}
NORMAL = "normal"
FOLDER_CODES = (
    ("CN", "connection"),
    ("DE", "deposit"),
    ("JD", "displaced joint"),
    ("F", "fracture"),
    ("R", "roots"),
)
"""Beginnings of WRc (MSCC) codes and the classes of the CCTV paper: CN connection, DES or DEG deposits, JDM displaced joint,
FL, FC, FM fracture, RF, RM, RT roots."""
SAME = {"joint displaced": "displaced joint", "root": "roots", "deposits": "deposit", "lateral": "connection"}


@dataclass(frozen=True)
class Still:
    """One labelled picture. ``cluster`` and ``source`` group what belongs together, for splitting; each is its own group where
    the archive does not say."""

    path: Path
    labels: frozenset[str]
    cluster: str
    source: str


def read_archive(folder: Path) -> list[Still]:
    """The pictures of ``folder``: from its manifest.json, else from one folder per class. Raises Invalid."""
    if not folder.is_dir():
        raise Invalid(f"There is no folder {folder}.")
    manifest = folder / "manifest.json"
    stills = _from_manifest(folder, manifest) if manifest.exists() else list(_from_folders(folder))
    if not stills:
        raise Invalid(f"There are no labelled pictures in {folder}.")
    return stills


def read_picture(still: Still) -> NDArray[np.uint8]:
    """(h, w, 3) BGR. Raises Invalid."""
    try:
        data = np.fromfile(still.path, np.uint8)
    except OSError:
        raise Invalid(f"The picture {still.path} cannot be read.") from None
    found = cv2.imdecode(data, cv2.IMREAD_COLOR) if len(data) else None
    if found is None:
        raise Invalid(f"The file {still.path} is no picture.")
    return np.asarray(found, dtype=np.uint8)


def class_name(label: str) -> str:
    """A label as the classes are written here: displaced_joint and Displaced Joint are displaced joint."""
    plain = " ".join(label.replace("_", " ").replace("-", " ").lower().split())
    return SAME.get(plain, plain)


def class_of_folder(name: str) -> str | None:
    """The class of a folder of an archive: its name, or the WRc code that it begins with. None where it is neither."""
    plain = class_name(name)
    if plain == NORMAL or plain in {label for _, label in FOLDER_CODES}:
        return plain
    code = name.strip().upper()
    if len(code) <= 4 and code.isalpha():
        for start, label in FOLDER_CODES:
            if code.startswith(start):
                return label
    return None


def _from_manifest(folder: Path, manifest: Path) -> list[Still]:
    try:
        rows = json.loads(manifest.read_text(encoding="utf-8"))
    except OSError as error:
        raise Invalid(f"The manifest {manifest} cannot be read: {error.strerror}.") from None
    except ValueError:
        raise Invalid(f"The manifest {manifest} is not JSON.") from None
    if isinstance(rows, dict):
        rows = rows.get("images")
    if not isinstance(rows, list):
        raise Invalid(f"The manifest {manifest} holds no list of images.")
    return [_still(folder, manifest, row) for row in rows]


def _still(folder: Path, manifest: Path, row: Any) -> Still:
    if not isinstance(row, dict) or not isinstance(row.get("image"), str) or not isinstance(row.get("labels"), list):
        raise Invalid(f"Every entry of {manifest} must have an image and a list of labels.")
    named = Path(row["image"])
    if named.is_absolute() or ".." in named.parts:
        raise Invalid(f"The manifest {manifest} names an image outside its folder: {row['image']}.")
    labels = frozenset(class_name(str(label)) for label in row["labels"])
    source = row.get("source", row.get("collection", row["image"]))
    return Still(folder / named, labels, str(row.get("cluster", row["image"])), str(source))


def _from_folders(folder: Path) -> Iterator[Still]:
    """The same picture in two folders has two labels."""
    found: dict[str, tuple[Path, set[str]]] = {}
    for inside in sorted(one for one in folder.iterdir() if one.is_dir()):
        label = class_of_folder(inside.name)
        if label is None:
            continue
        for path in sorted(inside.iterdir()):
            if path.suffix.lower() in PICTURES:
                found.setdefault(path.name, (path, set()))[1].add(label)
    for name, (path, labels) in found.items():
        yield Still(path, frozenset(labels), name, name)
