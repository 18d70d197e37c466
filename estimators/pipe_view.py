"""Whether a CCTV picture shows a pipe, or anything at all: what the box goes by while nobody tells it.

Along a pipe the lamp's light falls off with depth: the picture has a dark place, and from there it grows brighter on every
side. In a manhole, on a street or before a wall it does not.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

Gray = NDArray[np.uint8]

WIDTH = 64
"""Pixels across of the small picture that is looked at."""
SECTORS = 12
LIT = 28.0
"""Grey level that a tenth of the picture reaches where there is light."""
RISE = 1.25
"""A sector rises where its outer part is so much brighter than the dark place, and by _STEP grey levels."""
PIPE_SHARE = 0.7
_STEP = 8.0
_INNER, _OUTER = 0.06, (0.22, 0.45)
"""Radii in widths: of the dark place, and of the ring compared with it."""
_EDGE = 0.15
"""A dark place so near the edge of the picture (share of its width) is no pipe's end."""


@dataclass(frozen=True)
class PipeView:
    """``lit``: there is light enough to see by. ``risen``: the share of directions in which the picture grows brighter from its
    dark place, 0 where it has none."""

    lit: bool
    risen: float

    @property
    def pipe(self) -> bool:
        """Whether a pipe is in view."""
        return self.lit and self.risen >= PIPE_SHARE


def pipe_view(gray: Gray) -> PipeView:
    """Of a picture (H, W)."""
    height = max(1, round(WIDTH * gray.shape[0] / gray.shape[1]))
    small = np.asarray(cv2.resize(gray, (WIDTH, height), interpolation=cv2.INTER_AREA), np.float32)
    smooth = np.asarray(cv2.GaussianBlur(small, (0, 0), 1.5), np.float32)
    lit = bool(np.quantile(smooth, 0.9) >= LIT)
    edge = round(_EDGE * WIDTH)
    if not lit or height <= 2 * edge:
        return PipeView(lit, 0.0)
    inside = smooth[edge:-edge, edge:-edge]
    value = inside <= np.quantile(inside, 0.01)
    v, u = np.nonzero(value)
    v0, u0 = float(v.mean()) + edge, float(u.mean()) + edge
    rows, columns = np.mgrid[:height, :WIDTH]
    radius = np.hypot(columns - u0, rows - v0) / WIDTH
    sector = ((np.arctan2(rows - v0, columns - u0) / (2 * np.pi) + 0.5) * SECTORS).astype(int) % SECTORS
    dark = float(np.median(smooth[radius <= _INNER]))
    ring = (radius >= _OUTER[0]) & (radius <= _OUTER[1])
    risen = 0
    for number in range(SECTORS):
        part = smooth[ring & (sector == number)]
        if len(part) < 8:
            continue  # the picture ends before the ring does: a dark edge is no end of a pipe
        bright = float(np.median(part))
        risen += bright > RISE * dark and bright > dark + _STEP
    return PipeView(lit, risen / SECTORS)
