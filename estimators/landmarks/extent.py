"""How far a landmark reaches along and around the pipe."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimators.landmarks.ekf import wrap
from estimators.landmarks.projection import PipeCamera, View, back_project
from estimators.landmarks.tracks import Tracks

Array = NDArray[np.float64]
Index = NDArray[np.intp]

GAIN = 0.3
"""Share of the way by which one exact sighting beyond the end moves the end."""
EXACT = 0.15
"""A sighting whose chainage is known to this (m) counts as exact for the ends of an extent."""

DEEPEST = 20.0
"""In radii: farther ahead than this a point of an outline has no depth to speak of."""
TURN_GAIN = 0.15
"""Share of the way by which one outline moves the extent around the pipe."""


def depth_std(camera: PipeCamera, depth: Array, pixel_std: float) -> Array:
    """Standard deviation (m) of back-projected depths (n,): Z^2 sigma / (f R), for a camera on the axis."""
    return np.asarray(depth**2 * pixel_std / (np.sqrt(camera.fx * camera.fy) * camera.radius), dtype=np.float64)


@dataclass(frozen=True)
class Patches:
    """What outlines cover on the wall: ``low`` (n,) to ``high`` chainage (m), and how far they reach anticlockwise (``before``
    <= 0) and clockwise (``after`` >= 0) of the angle of their centroid (rad). nan for an outline that is nowhere."""

    low: Array
    high: Array
    before: Array
    after: Array


def wall_patches(
    camera: PipeCamera, view: View, outlines: Sequence[Sequence[tuple[float, float]]], centroids: Array
) -> Patches:
    """The patches of wall inside n outlines of points (u, v), each of at least one, round ``centroids`` (n, 2).

    Points about the focus of expansion, deeper than DEEPEST radii, lie nowhere in particular and are left out.
    """
    count = np.array([len(outline) for outline in outlines])
    start = np.cumsum(count) - count
    wall = back_project(camera, view, np.array([point for outline in outlines for point in outline], dtype=np.float64))
    about = np.repeat(back_project(camera, view, centroids)[:, 1], count)
    nowhere = ~(wall[:, 0] - view.position < DEEPEST * camera.radius)
    chainage = np.where(nowhere, np.nan, wall[:, 0])
    turn = np.where(nowhere, np.nan, wrap(wall[:, 1] - about))
    return Patches(
        np.fmin.reduceat(chainage, start),
        np.fmax.reduceat(chainage, start),
        np.minimum(np.fmin.reduceat(turn, start), 0.0),
        np.maximum(np.fmax.reduceat(turn, start), 0.0),
    )


def turn_towards(tracks: Tracks, rows: Index, patches: Patches) -> None:
    """Move the extents round the pipe of ``rows`` (n,) some way towards those of their outlines: all the way for the first."""
    for have, seen in ((tracks.before, patches.before), (tracks.after, patches.after)):
        known = np.isfinite(seen)
        at = rows[known]
        have[at] += np.where(have[at] == 0.0, 1.0, TURN_GAIN) * (seen[known] - have[at])


def grow(
    camera: PipeCamera, view: View, tracks: Tracks, rows: Index, chainage: Array, pixel_std: float, gain: float = GAIN
) -> None:
    """Stretch the extents of ``rows`` towards sightings at ``chainage`` (n,) (m) beyond their ends, slowly: one stray sighting
    moves little, and one from afar, whose chainage is a guess, nothing to speak of. nan moves nothing."""
    spread = depth_std(camera, chainage - view.position, pixel_std)
    share = gain / (1.0 + (spread / EXACT) ** 2)
    beyond = chainage - tracks.state[rows, 0]
    known = np.isfinite(beyond)
    rows, beyond, share = rows[known], beyond[known], share[known]
    tracks.above[rows] += share * np.maximum(beyond - tracks.above[rows], 0.0)
    tracks.below[rows] += share * np.minimum(beyond - tracks.below[rows], 0.0)
