"""After (and during) a run: one least-squares problem over all its sightings, the tether and what else is known."""

from estimators.landmarks.smoothing.doubles import find_doubles, identified, merged
from estimators.landmarks.smoothing.solve import smooth
from estimators.landmarks.smoothing.survey import moved, run_of, smooth_survey
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
    "find_doubles",
    "identified",
    "merged",
    "moved",
    "run_of",
    "smooth",
    "smooth_survey",
]
