"""Pictures with text burned in, as the tests of the OSD draw them."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.encoder.osd.reader import OsdText
from drivers.encoder.osd.text import find_distance

WHITE = (235, 235, 235)


def wall(seed: int = 0, height: int = 288, width: int = 400) -> NDArray[np.uint8]:
    """A textured, unevenly lit background (height, width, 3) BGR."""
    rng = np.random.default_rng(seed)
    rough = cv2.GaussianBlur(rng.normal(0.0, 60.0, (height, width)), (0, 0), 3.0)
    light = 110.0 - 60.0 * np.hypot(*np.meshgrid(np.linspace(-1, 1, width), np.linspace(-1, 1, height)))
    gray = np.clip(light + 4.0 * rough, 0, 255)
    return np.stack([0.5 * gray, 0.65 * gray, gray], axis=2).astype(np.uint8)


def burn(
    image: NDArray[np.uint8], text: str, at: tuple[int, int], size: float = 0.75, boxed: bool = False
) -> NDArray[np.uint8]:
    """``image`` with a line of text whose lower left corner is ``at`` (u, v); ``boxed`` on black, else with a dark outline."""
    out = image.copy()
    (width, height), below = cv2.getTextSize(text, cv2.FONT_HERSHEY_DUPLEX, size, 1)
    if boxed:
        cv2.rectangle(out, (at[0] - 3, at[1] - height - 3), (at[0] + width + 3, at[1] + below), (0, 0, 0), -1)
    else:
        cv2.putText(out, text, at, cv2.FONT_HERSHEY_DUPLEX, size, (0, 0, 0), 4, cv2.LINE_AA)
    cv2.putText(out, text, at, cv2.FONT_HERSHEY_DUPLEX, size, WHITE, 1, cv2.LINE_AA)
    return out


def as_read(text: str) -> OsdText:
    """What a reader makes of a line that the OCR reads as ``text``."""
    found = find_distance(text)
    if found is None:
        return OsdText(None, text, 0.9, (0, 0, 100, 20))
    return OsdText(found.metres, text, 0.99, (0, 0, 100, 20), found.layout, found.digits)
