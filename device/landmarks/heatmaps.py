"""What the network sees, painted over a picture: why the box says that there is a fracture, and where it looked."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

from device.errors import Invalid
from device.fcdd.model import load_model
from device.pictures import encode_jpeg
from estimators.detections import CLASSES

if TYPE_CHECKING:
    from estimators.fcdd import Fcdd

Image = NDArray[np.uint8]

MOST_SOLID = 0.7
"""The hottest place still lets the picture through."""
FULL = 2.0
"""Heat is full at so many times the threshold from which on a place is detected; half of it is the threshold itself."""


class Heatmaps:
    """The shipped network for whoever wants to see; loaded when first asked for, one picture at a time."""

    def __init__(self) -> None:
        self._network: Fcdd | None = None
        self._lock = threading.Lock()

    def over(self, picture: Image, label: str) -> Image:
        """A copy of ``picture`` (h, w, 3) with the anomaly map of class ``label`` (eq. 8) over it. Raises Invalid."""
        check_class(label)
        with self._lock:
            if self._network is None:
                self._network = load_model()
            seen = self._network.see(picture)
            threshold = self._network.card.map_thresholds[label]
        return painted(picture, np.clip(seen.heatmap(label) / (FULL * threshold), 0, 1))

    def over_jpeg(self, data: bytes, label: str) -> bytes:
        """The same of a JPEG, as a JPEG. Raises Invalid."""
        image = np.asarray(cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR), dtype=np.uint8)
        return encode_jpeg(self.over(image, label))


def check_class(label: str) -> None:
    """Raises Invalid where the network knows no such class."""
    if label not in CLASSES:
        raise Invalid(f"There is no heatmap of {label}: the network knows {', '.join(CLASSES)}.")


def painted(picture: Image, heat: NDArray[np.float32]) -> Image:
    """``heat`` (rows, columns) in 0..1 over ``picture`` (h, w, 3): where there is none the picture stays as it is."""
    height, width = picture.shape[:2]
    fine = np.clip(cv2.resize(heat, (width, height), interpolation=cv2.INTER_LINEAR), 0, 1)
    colors = cv2.applyColorMap((255 * fine).astype(np.uint8), cv2.COLORMAP_INFERNO)
    solid = (MOST_SOLID * np.sqrt(fine))[..., None]
    return np.asarray(picture * (1 - solid) + colors * solid + 0.5, dtype=np.uint8)
