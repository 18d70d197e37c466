"""A folder of recorded pictures: its manifest, and pictures that are read without trust in who wrote them."""

from __future__ import annotations

import json
import math
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any, TypeGuard

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.base import RecordingBroken

MANIFEST = "manifest.json"


def read_manifest(folder: Path) -> Any:
    """The JSON of a folder's manifest, whatever it is. Raises RecordingBroken."""
    path = folder / MANIFEST
    if not folder.is_dir():
        raise RecordingBroken(f"There is no folder {folder}.")
    if not path.is_file():
        raise RecordingBroken(f"The folder {folder} has no {MANIFEST}.")
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:  # ValueError: not JSON, or not UTF-8
        raise RecordingBroken(f"{path} cannot be read: {error}.") from error


def is_number(value: Any) -> TypeGuard[float]:
    """Whether JSON's ``value`` is a number that a float holds."""
    if isinstance(value, bool):
        return False
    if isinstance(value, int):
        return abs(value) < 1e300  # JSON writes whole numbers of any length, and a float does not hold them all
    return isinstance(value, float) and math.isfinite(value)


def stays_inside(path: str) -> bool:
    """True where a path of the manifest cannot lead out of the folder. Links in the folder are its owner's own doing."""
    if "\0" in path:
        return False
    return all(not kind(path).anchor and ".." not in kind(path).parts for kind in (PurePosixPath, PureWindowsPath))


def read_picture(path: Path, flags: int = cv2.IMREAD_COLOR) -> NDArray[Any]:
    """A picture as OpenCV decodes it with ``flags``; never a warning on stderr, unlike cv2.imread. Raises RecordingBroken."""
    try:
        data = np.frombuffer(path.read_bytes(), dtype=np.uint8)
        picture = cv2.imdecode(data, flags) if data.size else None
    except (FileNotFoundError, IsADirectoryError):
        raise RecordingBroken(f"{path} is missing.") from None
    except (OSError, cv2.error) as error:
        raise RecordingBroken(f"{path} cannot be read: {error}.") from error
    if picture is None:
        raise RecordingBroken(f"{path} is not a picture that can be read.")
    return picture
