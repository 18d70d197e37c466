"""Where the run gets its unknowns: knots of the tether's slack, closer where something is seen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimators.landmarks.smoothing.types import Array, Indices, Run

STEP, STEP_BLIND = 0.15, 0.5
"""Way between two knots (m), where something is in view and where nothing is."""
SECONDS, SECONDS_BLIND = 1.5, 10.0
"""The same in time: a crawler may move while its tether does not."""


@dataclass(frozen=True)
class Knots:
    """``frame`` (K,) the frames that are knots. Each frame lies ``share`` (n,) of the way from knot ``left`` (n,) to the next
    (``right`` (n,), itself at the end). ``way`` (n,) is the metres counted forth and back; ``encoder`` (n,) the count without
    gaps, ``gap`` (K - 1,) where an interval had some."""

    frame: Indices
    left: Indices
    right: Indices
    share: Array
    encoder: Array
    way: Array
    gap: NDArray[np.bool_]


def knots_of(run: Run) -> Knots:
    """Knots for a run of at least one frame."""
    time, count = run.frames.time_s, len(run.frames.time_s)
    known = np.isfinite(run.frames.encoder)
    index = np.arange(count)
    encoder = np.interp(index, index[known], run.frames.encoder[known]) if known.any() else np.zeros(count)
    moved, passed = np.abs(np.diff(encoder, prepend=encoder[:1])), np.maximum(np.diff(time, prepend=time[:1]), 0.0)
    seen = _near_a_sighting(run)
    progress = np.cumsum(np.maximum(moved / np.where(seen, STEP, STEP_BLIND), passed / np.where(seen, SECONDS, SECONDS_BLIND)))
    whole = np.floor(progress + 1e-9)
    frame = np.flatnonzero(np.diff(whole, prepend=-1.0) > 0)
    if frame[-1] != count - 1:
        frame = np.append(frame, count - 1)
    left = np.searchsorted(frame, index, side="right") - 1
    right = np.minimum(left + 1, len(frame) - 1)
    span = progress[frame[right]] - progress[frame[left]]
    share = np.where(span > 0, (progress - progress[frame[left]]) / np.where(span > 0, span, 1.0), 0.0)
    missing = np.concatenate([[0], np.cumsum(~known)])
    gap = missing[frame[1:] + 1] > missing[frame[:-1]]
    return Knots(frame, left, right, share, encoder, np.cumsum(moved), gap)


def nodes_along(way: Array, spacing: float) -> tuple[Indices, Array]:
    """Cells of ``spacing`` along a way (n,): the cell of each frame, and the way to the middle of each cell."""
    cell = np.floor((way - way[0]) / spacing).astype(np.int64)
    used, index = np.unique(cell, return_inverse=True)
    return index.astype(np.int64), (used + 0.5) * spacing


def _near_a_sighting(run: Run) -> NDArray[np.bool_]:
    time = run.frames.time_s
    at = np.unique(np.concatenate([run.sightings.frame, run.rings.frame]))
    if len(at) == 0:
        return np.zeros(len(time), np.bool_)
    after = np.clip(np.searchsorted(time[at], time), 0, len(at) - 1)
    before = np.maximum(after - 1, 0)
    near: NDArray[np.bool_] = np.minimum(np.abs(time[at][after] - time), np.abs(time[at][before] - time)) <= SECONDS
    return near
