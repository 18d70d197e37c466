"""How far a landmark reaches along and around the pipe."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from estimators.landmarks.projection import PipeCamera, View, back_project
from estimators.landmarks.tracks import Tracks

Array = NDArray[np.float64]
Index = NDArray[np.intp]

GAIN = 0.3
"""Share of the way by which one exact sighting beyond the end moves the end."""
EXACT = 0.15
"""A sighting whose chainage is known to this (m) counts as exact for the ends of an extent."""


def depth_std(camera: PipeCamera, view: View, pixels: Array, pixel_std: float) -> Array:
    """Standard deviation (m) of the chainage of back-projected pixels (n, 2): Z^2 sigma / (f R) for a centred camera."""
    depth = back_project(camera, view, pixels)[:, 0] - view.position
    return np.asarray(depth**2 * pixel_std / (np.sqrt(camera.fx * camera.fy) * camera.radius), dtype=np.float64)


def grow(camera: PipeCamera, view: View, tracks: Tracks, rows: Index, pixels: Array, pixel_std: float) -> None:
    """Stretch the extents of ``rows`` towards sightings (n, 2) beyond their ends, slowly: one stray sighting moves little, and
    one from afar, whose chainage is a guess, nothing to speak of."""
    if len(rows) == 0:
        return
    chainage = back_project(camera, view, pixels)[:, 0]
    spread = depth_std(camera, view, pixels, pixel_std)
    gain = GAIN / (1.0 + (spread / EXACT) ** 2)
    beyond = np.nan_to_num(chainage - tracks.state[rows, 0])
    tracks.above[rows] += gain * np.maximum(beyond - tracks.above[rows], 0.0)
    tracks.below[rows] += gain * np.minimum(beyond - tracks.below[rows], 0.0)
