"""What the parts of the structure estimator hand to each other. Metres and radians; "paper" is Vallicrosa et al. 2021."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

CLASSES = ("ball valve", "elbow", "tee", "socket", "butterfly valve", "3-way valve")
"""The paper's Table 1, in its order."""
PIPE_RADIUS = 0.0315
"""Outer radius of the pipes of Table 1's fittings: 63 mm pressure pipe."""


@dataclass(frozen=True)
class Segment:
    """A pipe as one scan shows it: axis from ``start`` to ``end`` (3,) in the sensor's frame.

    ``covariance`` (4, 4) of the axis at its middle: offsets along ``across`` (2, 3), then turns towards them (rad).
    ``bins``: places along the axis (m from ``start``) where its surface was seen.
    """

    start: Array
    end: Array
    across: Array
    covariance: Array
    bins: Array

    @property
    def middle(self) -> Array:
        """Middle of the axis, (3,)."""
        return (self.start + self.end) / 2

    @property
    def length(self) -> float:
        """From end to end."""
        return float(np.linalg.norm(self.end - self.start))

    @property
    def direction(self) -> Array:
        """Unit vector (3,) from start to end."""
        along: Array = (self.end - self.start) / np.linalg.norm(self.end - self.start)
        return along


@dataclass(frozen=True)
class Sighting:
    """An object as one scan shows it: ``position`` (3,) in the sensor's frame with ``covariance`` (3, 3).

    ``pipes``: unit vectors (n, 3) along which pipes leave it; ``cloud`` (N, 3) its own points. ``kind``: how it was found, at a
    "junction" of axes, "inline" on a pipe or at an "end" of one.
    """

    position: Array
    covariance: Array
    pipes: Array
    cloud: Array
    kind: str


@dataclass(frozen=True)
class Parts:
    """A scan taken apart: pipes and objects."""

    segments: tuple[Segment, ...]
    sightings: tuple[Sighting, ...]
