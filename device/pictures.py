"""Pictures for the page: depth in colours and the camera's own colour, as JPEG, each frame encoded once however many look."""

from __future__ import annotations

import threading
from collections.abc import Callable, Hashable
from dataclasses import dataclass, field
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.depth.base import DepthFrame

PICTURE_KINDS = ("depth", "color")

_WIDTH = 640
_FRESH_NS = 100_000_000
_QUALITY = 80
_NEAR_M, _FAR_M = 0.12, 2.5


class PictureCache:
    """The last JPEG of every view (a camera's depth, the CCTV picture with its grid, ...), made once however many look."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._views: dict[Hashable, _View] = {}

    def shared(self, view: Hashable, moment: int, make: Callable[[], bytes | None]) -> bytes | None:
        """The JPEG of ``view`` at ``moment`` (the frame's time, ns), by ``make()`` where it is the first to ask.

        One that is hardly older serves as well: phones that ask at different times do not make the box encode every frame.
        """
        with self._lock:
            kept = self._views.setdefault(view, _View())
        with kept.lock:  # held while encoding: the second viewer of a frame waits for the first one's picture
            if kept.moment is None or not 0 <= moment - kept.moment < _FRESH_NS:
                kept.data = make()
                kept.moment = moment
            return kept.data

    def jpeg(self, camera: str, kind: str, frame: DepthFrame) -> bytes | None:
        """The picture of ``frame``, at most 640 pixels wide; None where the camera has no colour."""
        return self.shared((camera, kind), frame.monotonic_ns, lambda: frame_jpeg(kind, frame))


@dataclass
class _View:
    lock: threading.Lock = field(default_factory=threading.Lock)
    moment: int | None = None
    data: bytes | None = None


def frame_jpeg(kind: str, frame: DepthFrame) -> bytes | None:
    """The "depth" or "color" picture of ``frame``, at most 640 pixels wide; None where the camera has no colour."""
    picture = depth_in_colors(frame) if kind == "depth" else frame.color
    return None if picture is None else encode_jpeg(picture)


def depth_in_colors(frame: DepthFrame) -> NDArray[np.uint8]:
    """(h, w, 3) BGR: near is red, far is blue, nothing measured is black. The steps grow with z, as the camera's errors do."""
    shrink = max(1, round(frame.intrinsics.width / _WIDTH))
    depth = frame.depth[::shrink, ::shrink]  # never blended: a mean over an edge would be a wall that is not there
    return _palette(frame.depth_unit_m)[depth]


@lru_cache(maxsize=4)
def _palette(depth_unit_m: float) -> NDArray[np.uint8]:
    """The colour (65536, 3) of every depth value."""
    z = np.maximum(np.arange(65536) * depth_unit_m, _NEAR_M)
    closeness = np.clip((1 / z - 1 / _FAR_M) / (1 / _NEAR_M - 1 / _FAR_M), 0, 1) ** 0.6
    grey = np.round(20 + 235 * closeness).astype(np.uint8)
    colors = np.asarray(cv2.applyColorMap(grey[:, None], cv2.COLORMAP_TURBO)[:, 0], dtype=np.uint8)
    colors[0] = 0
    return colors


def in_colour(picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """A picture (h, w), grey, or (h, w, 3) as BGR (h, w, 3)."""
    return np.asarray(cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR), dtype=np.uint8) if picture.ndim == 2 else picture


def encode_jpeg(picture: NDArray[np.uint8]) -> bytes:
    """JPEG of ``picture`` (h, w, 3), at most 640 pixels wide."""
    height, width = picture.shape[:2]
    if width > _WIDTH:
        picture = np.asarray(
            cv2.resize(picture, (_WIDTH, round(height * _WIDTH / width)), interpolation=cv2.INTER_AREA), dtype=np.uint8
        )
    _, data = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
    return data.tobytes()
