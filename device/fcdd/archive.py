"""Labelled pictures on disk: a folder with a manifest as ``borescout fcdd`` reads it, or one folder per class."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from device.errors import Invalid
from drivers import picture_folder
from drivers.base import RecordingBroken

PICTURES = {".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff", ".webp"}
NORMAL = "normal"
OBSTACLE = 1
"""What a box of a YOLO file is drawn round: 0 a joint, 1 an obstacle or deposit."""
SAME = {"joint displaced": "displaced joint", "root": "roots", "deposits": "deposit", "lateral": "connection"}


@dataclass(frozen=True)
class Still:
    """One labelled picture. ``cluster`` and ``source`` group what belongs together, for splitting; each is its own group where
    the archive does not say."""

    path: Path
    labels: frozenset[str]
    cluster: str
    source: str


def class_name(label: str) -> str:
    """A label as the classes are written here: displaced_joint and Displaced Joint are displaced joint."""
    plain = " ".join(label.replace("_", " ").replace("-", " ").lower().split())
    return SAME.get(plain, plain)


@dataclass(frozen=True)
class ClassFile:
    """What is to be told apart: ``codes`` per class, beginnings of the WRc (MSCC) codes that folders of an archive are named
    by. In ``classes.json`` beside the shipped model: CN connection, DES or DEG deposits, JDM displaced joint, FL, FC, FM
    fracture, RF, RM, RT roots."""

    codes: Mapping[str, tuple[str, ...]]

    @property
    def names(self) -> tuple[str, ...]:
        """The classes, in their order."""
        return tuple(self.codes)

    def of_folder(self, name: str) -> str | None:
        """The class of a folder of an archive: its name, or the code that it begins with. None where it is neither."""
        plain = class_name(name)
        if plain == NORMAL or plain in self.codes:
            return plain
        code = name.strip().upper()
        if len(code) <= 4 and code.isalpha():
            fitting = [
                (len(start), label) for label, starts in self.codes.items() for start in starts if code.startswith(start)
            ]
            return max(fitting)[1] if fitting else None
        return None


def read_classes(file: Path) -> ClassFile:
    """A class file: a JSON object of class names, each with a list of code beginnings, which may be empty. Raises Invalid."""
    try:
        found = json.loads(file.read_text(encoding="utf-8"))
    except OSError as error:
        raise Invalid(f"The class file {file} cannot be read: {error.strerror}.") from None
    except ValueError:
        raise Invalid(f"The class file {file} is not JSON.") from None
    if not isinstance(found, dict) or not found:
        raise Invalid(f"The class file {file} must be an object of class names, each with a list of codes.")
    codes = {}
    for name, starts in found.items():
        if not isinstance(starts, list) or not all(isinstance(start, str) and start.isalpha() for start in starts):
            raise Invalid(f"The class {name} of {file} must have a list of codes, which may be empty.")
        codes[class_name(name)] = tuple(start.upper() for start in starts)
    if len(codes) < len(found) or NORMAL in codes:
        raise Invalid(f"The class file {file} must name each class once, and not normal.")
    return ClassFile(codes)


SHIPPED_CLASSES = read_classes(Path(__file__).parents[1] / "data" / "fcdd" / "classes.json")


def read_archive(folder: Path, classes: ClassFile = SHIPPED_CLASSES) -> list[Still]:
    """The pictures of ``folder``: from its manifest.json, else from one folder per class. Raises Invalid."""
    if not folder.is_dir():
        raise Invalid(f"There is no folder {folder}.")
    manifest = folder / "manifest.json"
    stills = _from_manifest(folder, manifest) if manifest.exists() else list(_from_folders(folder, classes))
    if not stills:
        raise Invalid(f"There are no labelled pictures in {folder}.")
    return stills


def read_picture(still: Still) -> NDArray[np.uint8]:
    """(h, w, 3) BGR. Raises Invalid."""
    try:
        return np.asarray(picture_folder.read_picture(still.path), dtype=np.uint8)
    except RecordingBroken as error:
        raise Invalid(str(error)) from error


def read_boxes(folder: Path) -> list[Still]:
    """Pictures with YOLO boxes: deposit where one is drawn round an obstacle or deposit. Neighbours in number are of one
    inspection. Raises Invalid."""
    found = []
    for path in sorted(folder.glob("*.txt")) if folder.is_dir() else ():
        pictures = [path.with_suffix(kind) for kind in sorted(PICTURES) if path.with_suffix(kind).exists()]
        if not pictures:
            continue
        try:
            drawn = {int(line.split()[0]) for line in path.read_text(encoding="utf-8").splitlines() if line.strip()}
        except (OSError, ValueError):
            raise Invalid(f"The file {path} holds no boxes.") from None
        group = f"boxes {path.stem[:-2]}"
        found.append(Still(pictures[0], frozenset({"deposit"} if OBSTACLE in drawn else ()), group, group))
    if not found:
        raise Invalid(f"There are no pictures with boxes in {folder}.")
    return found


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


def _from_folders(folder: Path, classes: ClassFile) -> Iterator[Still]:
    """The same picture in two folders has two labels."""
    found: dict[str, tuple[Path, set[str]]] = {}
    for inside in sorted(one for one in folder.iterdir() if one.is_dir()):
        label = classes.of_folder(inside.name)
        if label is None:
            continue
        for path in sorted(inside.iterdir()):
            if path.suffix.lower() in PICTURES:
                found.setdefault(path.name, (path, set()))[1].add(label)
    for name, (path, labels) in found.items():
        yield Still(path, frozenset(labels), name, name)
