"""After (and during) a run: one least-squares problem over all its sightings, the tether and what else is known."""

from estimators.landmarks.smoothing.solve import smooth
from estimators.landmarks.smoothing.types import (
    NO_RINGS,
    Constraints,
    Frames,
    Known,
    Lateral,
    Noise,
    RingSightings,
    Run,
    Sightings,
    Slip,
    Smoothed,
    SmoothedJoint,
    SmoothedLandmark,
)

__all__ = [
    "NO_RINGS",
    "Constraints",
    "Frames",
    "Known",
    "Lateral",
    "Noise",
    "RingSightings",
    "Run",
    "Sightings",
    "Slip",
    "Smoothed",
    "SmoothedJoint",
    "SmoothedLandmark",
    "smooth",
]
