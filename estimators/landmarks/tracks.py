"""The tracks of the mapper as arrays, one row a track: what the inner loop touches is never a Python object per track."""

from __future__ import annotations

from dataclasses import dataclass, field, fields

import numpy as np
from numpy.typing import NDArray

from estimators.landmarks.belief import Bursts
from estimators.landmarks.projection import View

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Seen:
    """One sighting as a track keeps it; the track is known by where it lies."""

    frame: int
    time_s: float
    view: View
    u: float
    v: float
    label: str
    score: float
    area: float


@dataclass
class Tracks:
    """All tracks. Arrays of length n, grown by ``append`` and cut by ``keep``.

    ``state`` (n, 2) and ``covariance`` (n, 2, 2) of the filter; ``below`` <= 0 and ``above`` >= 0 reach of the extent from its
    chainage (m), ``before`` <= 0 and ``after`` >= 0 around the pipe (rad); ``score`` the log likelihood ratio of its
    existence; ``belief`` (n, classes); ``run`` misses in a row; ``burst_*`` see belief.Bursts; ``counted_at`` the camera's
    position when it last counted as evidence (m), ``hit_at`` when it was last seen; ``farthest`` depth at which it was ever
    seen (m); ``evidence`` (n, 4) frame, u, v, size of the best sighting.
    """

    ids: Ints = field(default_factory=lambda: np.zeros(0, np.int64))
    state: Array = field(default_factory=lambda: np.zeros((0, 2)))
    covariance: Array = field(default_factory=lambda: np.zeros((0, 2, 2)))
    below: Array = field(default_factory=lambda: np.zeros(0))
    above: Array = field(default_factory=lambda: np.zeros(0))
    before: Array = field(default_factory=lambda: np.zeros(0))
    after: Array = field(default_factory=lambda: np.zeros(0))
    score: Array = field(default_factory=lambda: np.zeros(0))
    belief: Array = field(default_factory=lambda: np.zeros((0, 0)))
    confirmed: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, bool))
    hits: Ints = field(default_factory=lambda: np.zeros(0, np.int64))
    misses: Ints = field(default_factory=lambda: np.zeros(0, np.int64))
    run: Ints = field(default_factory=lambda: np.zeros(0, np.int64))
    burst_mean: Array = field(default_factory=lambda: np.zeros((0, 2)))
    burst_count: Array = field(default_factory=lambda: np.zeros(0))
    burst_label: Ints = field(default_factory=lambda: np.zeros(0, np.int64))
    burst_first: Ints = field(default_factory=lambda: np.zeros(0, np.int64))
    burst_last: Ints = field(default_factory=lambda: np.zeros(0, np.int64))
    counted_at: Array = field(default_factory=lambda: np.zeros(0))
    hit_at: Array = field(default_factory=lambda: np.zeros(0))
    farthest: Array = field(default_factory=lambda: np.zeros(0))
    first_frame: Ints = field(default_factory=lambda: np.zeros(0, np.int64))
    last_frame: Ints = field(default_factory=lambda: np.zeros(0, np.int64))
    evidence: Array = field(default_factory=lambda: np.zeros((0, 4)))
    sightings: list[list[Seen]] = field(default_factory=list)

    def __len__(self) -> int:
        return len(self.ids)

    def append(self, new: Tracks) -> None:
        """Add the rows of ``new``."""
        for name in _ARRAYS:
            setattr(self, name, np.concatenate([getattr(self, name), getattr(new, name)]))
        self.sightings += new.sightings

    def keep(self, chosen: NDArray[np.bool_]) -> None:
        """Leave only the rows where ``chosen`` (n,) is true."""
        for name in _ARRAYS:
            setattr(self, name, getattr(self, name)[chosen])
        self.sightings = [notes for notes, stays in zip(self.sightings, chosen, strict=True) if stays]

    def widen(self, classes: int) -> None:
        """Make room for more classes: a class not heard of before starts with the share of an even belief."""
        have = self.belief.shape[1]
        if classes > have:
            fresh = np.full((len(self), classes - have), 1.0 / classes)
            self.belief = np.concatenate([self.belief * (have / classes), fresh], axis=1)

    def bursts(self, rows: NDArray[np.intp]) -> Bursts:
        """The bursts of the given rows."""
        return Bursts(
            self.burst_mean[rows], self.burst_count[rows], self.burst_label[rows], self.burst_first[rows], self.burst_last[rows]
        )

    def set_bursts(self, rows: NDArray[np.intp], bursts: Bursts) -> None:
        """Put back the bursts of the given rows."""
        self.burst_mean[rows], self.burst_count[rows] = bursts.mean, bursts.count
        self.burst_label[rows] = bursts.label
        self.burst_first[rows], self.burst_last[rows] = bursts.first, bursts.last


_ARRAYS = tuple(entry.name for entry in fields(Tracks) if entry.name != "sightings")
