"""What goes into the landmark mapper and what comes out of it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from estimators.detections import Detection
from estimators.landmarks.projection import View

Array = NDArray[np.float64]
Status = Literal["candidate", "confirmed", "passed"]


@dataclass(frozen=True)
class Observation:
    """One frame as the mapper sees it.

    ``view`` says where the camera was, ``position_std`` (m) and ``centre_std`` (px) how well that is known. ``detections`` is
    None where the detector did not look at this frame: then nothing is held against a track that was not seen.
    """

    frame: int
    time_s: float
    view: View
    detections: tuple[Detection, ...] | None
    position_std: float = 0.01
    centre_std: float = 4.0


@dataclass(frozen=True)
class Sighting:
    """One detection that counted for a landmark; ``landmark`` is its id, ``on_wall`` (px) the point of the wall in its middle
    where its outline tells it: the centroid ``u``, ``v`` of what is bent round the pipe lies inside."""

    landmark: int
    frame: int
    time_s: float
    view: View
    u: float
    v: float
    label: str
    score: float
    on_wall: tuple[float, float] | None = None


@dataclass(frozen=True)
class Evidence:
    """The sighting that shows a landmark best: the picture to cut the thumbnail from. ``size`` (px) is about its width."""

    frame: int
    u: float
    v: float
    size: float


@dataclass(frozen=True)
class Landmark:
    """One landmark of the map.

    ``chainage`` (m) and ``angle`` (image angle, rad) of its centroid with ``covariance`` (2, 2); ``chainage_to`` and
    ``angle_to`` end its extent, equal to ``chainage_from`` and ``angle_from`` for a point. ``angle_to`` lies clockwise of
    ``angle_from`` (as seen along the inspection direction) and may be beyond pi. ``belief`` is a probability per class, and
    per "false" for none; ``label`` its likeliest class. ``ends`` (2, 2) is the covariance of ``chainage_from`` and
    ``chainage_to`` where they have one of their own; those of a point are as sure as its chainage.
    """

    id: int
    label: str
    status: Status
    chainage: float
    angle: float
    covariance: Array
    chainage_from: float
    chainage_to: float
    angle_from: float
    angle_to: float
    belief: dict[str, float]
    hits: int
    misses: int
    first_frame: int
    last_frame: int
    evidence: Evidence
    sightings: tuple[Sighting, ...] = field(default=(), repr=False)
    ends: Array | None = None

    @property
    def ends_std(self) -> tuple[float, float]:
        """Standard deviations (m) of ``chainage_from`` and ``chainage_to``."""
        along = self.covariance[0, 0]
        low, high = (along, along) if self.ends is None else np.diag(self.ends)
        return float(np.sqrt(max(low, 0.0))), float(np.sqrt(max(high, 0.0)))

    def less_sure(self, variance: float) -> Landmark:
        """The same with an error of ``variance`` (m^2) that all of it has in common along the pipe."""
        covariance = self.covariance + np.diag([variance, 0.0])
        return replace(self, covariance=covariance, ends=None if self.ends is None else self.ends + variance)
