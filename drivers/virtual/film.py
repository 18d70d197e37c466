"""How light becomes grey: the one curve of the virtual CCTV camera."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

FILM_STEPS, FILM_WHITE = 4096, 8.0
"""The table has so many steps up to so much light; 1 is what saturates to 63 %."""


@lru_cache(maxsize=1)
def film() -> NDArray[np.uint8]:
    """Grey level of light 0 to FILM_WHITE: linear in the dark, saturating softly."""
    light = np.arange(FILM_STEPS) * (FILM_WHITE / FILM_STEPS)
    return np.asarray(np.clip(255 * (1 - np.exp(-light)), 0, 255), np.uint8)
