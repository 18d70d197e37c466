"""The colour of a region against the wall about it, where the picture has colour.

Brightness tells nothing: whatever stands off the wall meets the lamp at another angle. The tint does, since one lamp lights
both: it is compared as the logarithms of blue and red against green, in which light and shade cancel. A wall has tints of its
own (rust, the flood line), so a difference is plain only where it is far beyond those of the pieces of wall about the region.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from estimators.anomaly.deviation import DeviationMap
from estimators.anomaly.regions import Region
from estimators.pinhole import Intrinsics

Floats = NDArray[np.float64]

ATTACHED = "attached"
"""What comes inwards off the invert and is plainly of another colour than the wall: it is not the wall itself."""
_APART, _AROUND = 3, 14
"""Cells of the map that are left out about a region, since windows smear it, and from which the wall about it is taken."""
_DARK, _BRIGHT = 24, 250
_LEAST_CELLS = 30
_PIECES, _LEAST_PIECES = 12, 6
_TIMES, _LEAST_TINT = 4.0, 0.12
"""How many spreads of the pieces about it, and how much, make a tint plain: 0.12 is red a tenth stronger against green."""


@dataclass(frozen=True)
class RegionColour:
    """``region`` and ``wall`` (3,) are mean colours, red, green, blue, 0 to 255; ``tint`` how far their tints are apart
    (natural logarithm), ``spread`` that of the pieces of wall about it; ``plain`` whether the difference is."""

    region: tuple[int, int, int]
    wall: tuple[int, int, int]
    tint: float
    spread: float
    plain: bool


def region_colours(
    picture: NDArray[np.uint8], found: DeviationMap, camera: Intrinsics, regions: list[Region]
) -> list[RegionColour | None]:
    """One for each of ``regions``; None where the ``picture`` (H, W[, 3]) BGR has no colour, or too little was seen. ``camera``
    is the left one, without distortion."""
    if picture.ndim != 3 or _colourless(picture):
        return [None] * len(regions)
    colours = _on_map(picture, found, camera)
    taken = np.zeros(found.deviation.shape, dtype=np.uint8)
    for region in regions:
        taken.ravel()[region.cells] = 1
    return [_compared(colours, found, region, taken) for region in regions]


def named_by_colour(regions: list[Region], colours: list[RegionColour | None]) -> list[Region]:
    """The regions, their kind by colour too where that is plain."""
    return [
        replace(region, kind=ATTACHED) if colour is not None and colour.plain and region.kind == "intrusion" else region
        for region, colour in zip(regions, colours, strict=True)
    ]


def _colourless(picture: NDArray[np.uint8]) -> bool:
    """A grey picture that was only written as a coloured one."""
    thin = picture[::8, ::8].astype(np.int16)
    return bool(np.mean(np.abs(thin[..., 0] - thin[..., 1]) + np.abs(thin[..., 2] - thin[..., 1])) < 1.0)


def _on_map(picture: NDArray[np.uint8], found: DeviationMap, camera: Intrinsics) -> Floats:
    """(Z, A, 3) BGR of each measured cell, where it was measured; nan where nothing was, too dark or too bright."""
    points = found.points
    with np.errstate(divide="ignore", invalid="ignore"):
        u = (camera.fx * points[..., 0] / points[..., 2] + camera.ppx).astype(np.float32)
        v = (camera.fy * points[..., 1] / points[..., 2] + camera.ppy).astype(np.float32)
    soft = cv2.blur(picture, (5, 5))
    colours = cv2.remap(soft, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT).astype(np.float64)
    sound = found.measured & (colours.max(axis=2) < _BRIGHT) & (colours.min(axis=2) > _DARK)
    return np.where(sound[..., None], colours, np.nan)


def _compared(colours: Floats, found: DeviationMap, region: Region, taken: NDArray[np.uint8]) -> RegionColour | None:
    own = np.zeros(found.deviation.shape, dtype=np.uint8)
    own.ravel()[region.cells] = 1
    about = (_grown(own, _AROUND) > 0) & (_grown(taken, _APART) == 0)
    inside, outside = (colours[mask] for mask in (own > 0, about))
    inside, outside = (values[np.isfinite(values[:, 0])] for values in (inside, outside))
    if min(len(inside), len(outside)) < _LEAST_CELLS:
        return None
    pieces = _pieces(colours, about, region, found)
    if len(pieces) < _LEAST_PIECES:
        return None
    tint = float(np.linalg.norm(_tint(inside).mean(axis=0) - _tint(outside).mean(axis=0)))
    spread = float(np.sqrt(np.sum(np.var(pieces, axis=0))))
    plain = tint > max(_TIMES * spread, _LEAST_TINT)
    means = [tuple(round(value) for value in values.mean(axis=0)[::-1]) for values in (inside, outside)]
    return RegionColour((means[0][0], means[0][1], means[0][2]), (means[1][0], means[1][1], means[1][2]), tint, spread, plain)


def _pieces(colours: Floats, about: NDArray[np.bool_], region: Region, found: DeviationMap) -> Floats:
    """(N, 2): mean tints of the pieces into which the wall about a region is cut, by direction from its middle."""
    rows, columns = np.nonzero(about & np.isfinite(colours[..., 0]))
    along = (found.depth[rows] - region.depth) / max(region.depths[1] - region.depths[0], 1e-6)
    aside = np.angle(np.exp(1j * (found.theta[columns] - region.theta))) / max(region.width, 1e-6)
    piece = ((np.arctan2(along, aside) + np.pi) * (_PIECES / (2 * np.pi))).astype(int) % _PIECES
    tints = _tint(colours[rows, columns])
    return np.array([tints[piece == one].mean(axis=0) for one in range(_PIECES) if (piece == one).sum() >= 10]).reshape(-1, 2)


def _tint(bgr: Floats) -> Floats:
    """(N, 2): logarithms of blue and of red against green."""
    log = np.log(bgr)
    return np.stack([log[:, 0] - log[:, 1], log[:, 2] - log[:, 1]], axis=1)


def _grown(mask: NDArray[np.uint8], cells: int) -> NDArray[np.uint8]:
    """Grown by so many cells, around the pipe without a seam."""
    kernel = np.ones((2 * cells + 1, 2 * cells + 1), np.uint8)
    padded = np.concatenate([mask[:, -cells:], mask, mask[:, :cells]], axis=1)
    return np.asarray(cv2.dilate(padded, kernel)[:, cells:-cells], dtype=np.uint8)
