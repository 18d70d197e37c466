"""One pair of pictures as a result: numbers in the units of the page (mm, m, clock), or why there are none."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import zip_longest
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from estimators.anomaly.colour import RegionColour, named_by_colour, region_colours
from estimators.anomaly.joints import Joint
from estimators.anomaly.pair import PairFindings, inspect_pair
from estimators.anomaly.regions import Region
from estimators.anomaly.score import BandScore
from estimators.radial_profile.shape import Z95, Extent
from estimators.stereo.follow import Refused
from estimators.stereo.rig import StereoRig

Result = dict[str, Any]

WIDEST_INTERVAL = 0.25
"""Widths whose 95 % interval is wider than this share of them are not told: they would choose no liner."""
SMOOTH_M2 = 0.002
"""Places of this area are to be seen, or it is said that they are not: a hand's breadth by two fingers."""
_UNSURE = "No width: the calibration makes this wall more conical than pipes are, and the wall alone does not tell better."
_NO_SCALE = (
    "No width: this pair does not tell its own scale. All lengths, peaks and scores too, may be {percent:.0f} % wrong alike. "
    "Calibrate the rig with a pipe of known size."
)
_SEED = 6


def grey(picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """A picture (H, W) or (H, W, 3) BGR as grey."""
    return picture if picture.ndim == 2 else np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY), dtype=np.uint8)


def inspect(left: NDArray[np.uint8], right: NDArray[np.uint8], rig: StereoRig) -> tuple[Result, PairFindings | None]:
    """Result and findings of one pair; without findings the result says why."""
    try:
        findings = inspect_pair(grey(left), grey(right), rig, np.random.default_rng(_SEED))
    except Refused as refusal:
        return refused(refusal.reason, str(refusal)), None
    camera = findings.followed.wall.rig.intrinsics
    colours = region_colours(left, findings.map, camera, findings.regions)
    findings = replace(findings, regions=named_by_colour(findings.regions, colours))
    return result_of(findings, colours), findings


def refused(reason: str, message: str) -> Result:
    """The result of a pair that tells nothing."""
    empty: Result = dict.fromkeys(
        ("score_mm", "outward_mm", "width_mm", "width_interval_mm", "height_mm", "height_interval_mm", "seen_height_mm")
    )
    return {
        "fitted": False,
        "reason": reason,
        "message": message,
        **empty,
        "coverage": 0.0,
        "regions": [],
        "joints": [],
        "bands": [],
        "smooth": [],
    }


def result_of(findings: PairFindings, colours: Sequence[RegionColour | None] = ()) -> Result:
    """The result of a pair that was fitted; ``colours`` of its regions, where they were asked for."""
    shape = findings.shape
    unsure = findings.followed.unsure_scale
    alike = Z95 * findings.followed.wall.rig.relative_std(shape.depth)
    no_scale = not unsure and 2 * alike > WIDEST_INTERVAL
    width, width_interval = _extent(None if unsure or no_scale else shape.width)
    height, height_interval = _extent(None if unsure or no_scale else shape.height)
    named = shape.name != "free"
    depth = findings.map.depth
    return {
        "fitted": True,
        "reason": "offset_unsure" if unsure else "scale_unsure" if no_scale else "",
        "message": _UNSURE if unsure else _NO_SCALE.format(percent=100 * alike) if no_scale else "",
        "score_mm": _mm(findings.inward, 3),
        "outward_mm": _mm(findings.outward, 3),
        "outward_of": round(findings.told, 4),
        "sure_inward_mm": _mm(findings.sure[0], 3),
        "width_mm": width,
        "width_interval_mm": width_interval,
        "height_mm": height,
        "height_interval_mm": height_interval,
        "seen_height_mm": _mm(shape.seen_height, 1),
        "profile": shape.name,
        "profile_width_mm": _mm(shape.fitted_width, 1) if named and width is not None else None,
        "profile_height_mm": _mm(shape.fitted_height, 1) if named and width is not None else None,
        "ovality_percent": None if np.isnan(shape.ovality) else round(100 * shape.ovality, 2),
        "coverage": round(findings.followed.coverage, 4),
        "rough": round(findings.followed.rough, 4),
        "anomalous_share": round(findings.anomalous, 5),
        "near_m": round(float(depth[0]), 3),
        "far_m": round(float(depth[-1]), 3),
        "lengths_within_percent": round(100 * alike, 1),
        "offset_px": round(findings.offset_px, 2),
        "offset_std_px": round(findings.offset_std_px, 2),
        "own_offset": findings.own_offset,
        "regions": [_region(region, colour) for region, colour in zip_longest(findings.regions, colours)],
        "joints": [_joint(joint) for joint in findings.joints],
        "bands": [
            {
                "first_m": round(band.first, 3),
                "last_m": round(band.last, 3),
                "score_mm": _mm(band.inward, 3),
                "outward_mm": _mm(band.outward, 3),
                "measured": round(band.measured, 3),
                "sees_mm2": None if np.isnan(band.sees) else round(1e6 * band.sees),
            }
            for band in findings.bands
        ],
        "smooth": smooth_stretches(findings.bands),
    }


def smooth_stretches(bands: Sequence[BandScore]) -> list[Result]:
    """Where the wall has so little texture, for how far off it is, that a place of SMOOTH_M2 may go unseen: from and to (m
    ahead), and up to which size."""
    stretches: list[Result] = []
    for band in bands:
        if not band.sees >= SMOOTH_M2:
            continue
        first, size = round(band.first, 3), round(1e6 * band.sees)
        if stretches and stretches[-1]["to_m"] == first:
            stretches[-1].update(to_m=round(band.last, 3), sees_mm2=max(size, stretches[-1]["sees_mm2"]))
        else:
            stretches.append({"from_m": first, "to_m": round(band.last, 3), "sees_mm2": size})
    return stretches


def clock(theta: float) -> float:
    """Clock hour, 12 at the crown, of an image angle (rad)."""
    hour = round((3.0 + np.degrees(theta) / 30.0) % 12.0, 1)
    return 12.0 if hour in (0.0, 12.0) else float(hour)


def _region(region: Region, colour: RegionColour | None) -> Result:
    return {
        "area_mm2": round(region.area * 1e6),
        "peak_mm": _mm(region.peak, 1),
        "volume_cm3": round(region.volume * 1e6, 1),
        "z_m": round(region.depth, 3),
        "clock": clock(region.theta),
        "from_m": round(region.depths[0], 3),
        "to_m": round(region.depths[1], 3),
        "width_hours": round(np.degrees(region.width) / 30.0, 1),
        "kind": region.kind,
        "expected": region.expected,
        "confidence": round(region.confidence, 2),
        "colour": None
        if colour is None
        else {"region": list(colour.region), "wall": list(colour.wall), "tint": round(colour.tint, 3), "plain": colour.plain},
    }


def _joint(joint: Joint) -> Result:
    return {
        "z_m": round(joint.depth, 3),
        "gap_mm": _mm(joint.gap, 1),
        "gap_sigma_mm": _mm(joint.gap_std, 1),
        "step_mm": _mm(joint.step, 1),
        "offset_mm": _mm(joint.offset, 1) if joint.offset is not None else None,
        "offset_sigma_mm": _mm(joint.offset_std, 1),
        "offset_clock": clock(joint.offset_theta) if joint.offset_theta is not None else None,
    }


def _extent(extent: Extent | None) -> tuple[float | None, list[float] | None]:
    if extent is None or extent.interval[1] - extent.interval[0] > WIDEST_INTERVAL * extent.value:
        return None, None
    return _mm(extent.value, 1), [round(1000 * end, 1) for end in extent.interval]


def _mm(metres: float, digits: int) -> float | None:
    return None if np.isnan(metres) else round(1000 * float(metres), digits)
