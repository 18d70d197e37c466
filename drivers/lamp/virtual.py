"""The twin of the lamp: what it lights is the picture of the virtual CCTV."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.lamp.base import Lamp

NOMINAL = 0.5
"""The level at which pictures are as the virtual sewer draws them."""
_GAMMA = 2.2
_AMBIENT = 0.002
"""What light is left in a pipe, as a share of the nominal."""


class VirtualLamp(Lamp):
    """Any thread may ask it how brightly it shines."""

    name = "virtual lamp"

    def __init__(self) -> None:
        self.level = 0.0

    def open(self) -> None:
        """See ``Lamp``."""

    def _set(self, level: float) -> None:
        self.level = level

    def close(self) -> None:
        """See ``Lamp``."""
        self.level = 0.0

    def light(self, picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """The picture (H, W, 3), drawn for the nominal level, in this light. Grey values go with the 1/2.2th power of light."""
        if self.level == NOMINAL:
            return picture
        gain = max(self.level / NOMINAL, _AMBIENT) ** (1 / _GAMMA)
        return np.asarray(cv2.convertScaleAbs(picture, alpha=gain), dtype=np.uint8)
