"""Accept or retry: the proxies of a recording against fitted thresholds, each with its reason.

The thresholds are data (data/diameter_thresholds.json, which names the command that fitted them): one wrong number accepted
costs as much as a thousand right ones refused.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, fields
from functools import cache
from importlib.resources import files

from drivers.depth.base import STEREO_SCALE_STD
from estimators.recording import MIN_FRAMES_FOR_SPREAD, ErrorModel, RecordingEstimate

TOLERANCE_MM = 20.0
"""The paper's tolerance on the diameter: half a step of the DN series, less a margin (section 4.4)."""
SECOND_POSITION_FROM_MM = 250.0
"""Pipes wider than this are measured from a second position (section 4.2, step 3d)."""
_BLIND_SHARE = 0.03
"""Below this share of pixels with any depth it is the camera that sees nothing, not the pipe that is missing."""


@dataclass(frozen=True)
class Thresholds:
    """What a recording must reach, in the units that the names say; ``area`` in squares of the radius."""

    min_area: float
    min_inliers: float
    min_inlier_share: float
    min_coverage_deg: float
    min_orientation: float
    max_sway_mm: float
    max_radius_std_frames_mm: float
    max_radius_std_resampled_mm: float
    max_half_interval_mm: float
    max_inside: float
    max_taper: float
    max_out_of_round: float


@cache
def shipped() -> tuple[Thresholds, ErrorModel]:
    """The thresholds and the error model that come with the package."""
    data = json.loads((files("device") / "data" / "diameter_thresholds.json").read_text(encoding="utf-8"))
    thresholds = Thresholds(**{field.name: float(data[field.name]) for field in fields(Thresholds)})
    return thresholds, ErrorModel(STEREO_SCALE_STD, data["fit_factor"], data["shape_factor"])


def reasons_to_refuse(recording: RecordingEstimate, thresholds: Thresholds) -> tuple[str, ...]:
    """Reason codes, the weightiest first; none means accept. Codes: no_pipe few_points unstable
    water aim shape motion wide_interval."""
    t = thresholds
    blind = "few_points" if recording.valid_share < _BLIND_SHARE else "no_pipe"
    if recording.fitted == 0:
        return (blind,)
    share = recording.proxies["inlier_share"][0]
    if (
        recording.fitted < 0.5 * recording.frames
        or recording.support.area < 0.5 * t.min_area
        or share < 0.5 * t.min_inlier_share
    ):
        return (blind,)
    few_frames = recording.fitted < MIN_FRAMES_FOR_SPREAD
    spread = t.max_radius_std_resampled_mm if few_frames else t.max_radius_std_frames_mm
    coverage_deg = math.degrees(recording.support.coverage)
    blocked = recording.support.inside > t.max_inside
    low, high = recording.interval
    checks = (
        ("unstable", 1000 * recording.radius_std > spread or recording.support.taper > t.max_taper),
        (
            "few_points",
            recording.support.area < t.min_area or recording.support.inlier_count < t.min_inliers or share < t.min_inlier_share,
        ),
        ("water", blocked),
        ("aim", coverage_deg < t.min_coverage_deg or recording.proxies["orientation"][0] < t.min_orientation),
        ("shape", recording.support.out_of_round > t.max_out_of_round),
        ("motion", 1000 * recording.sway > t.max_sway_mm),
        ("wide_interval", 500 * (high - low) > t.max_half_interval_mm),
    )
    return tuple(code for code, failed in checks if failed)
