"""From frame estimates to the finding that is stored and shown: verdict, interval, DN, profile, prompts, as JSON-ready data."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from device import dn
from device.diameter.verdict import SECOND_POSITION_FROM_MM, TOLERANCE_MM, reasons_to_refuse, shipped
from device.prompts import PROMPTS
from drivers.depth.base import STEREO_SCALE_STD
from estimators.cylinder import CylinderFit, orthonormal_basis
from estimators.frame import FrameEstimate, estimate_frame
from estimators.picture import PictureQuality, picture_quality
from estimators.pinhole import Intrinsics, project_rays
from estimators.profile import Profile
from estimators.recording import RecordingEstimate, combine

ALIKE = 1.2
"""Intervals that differ by less than this factor tell no better camera: their shape terms are estimates themselves."""
Result = dict[str, Any]
SINGLE_FRAME_RESAMPLES = 10
LIVE_FRAMES = 10
QUESTIONS = {
    "image_good": "Is the picture good: sharp, lit, looking into the pipe?",
    "cloud_is_pipe": "Does the point cloud look like a pipe?",
    "fit_aligned": "Does the fitted cylinder lie on the point cloud?",
}


@dataclass(frozen=True)
class PipeContext:
    """What is known before measuring. ``position`` is entrance, top or middle, ``scale_std`` the relative
    scale error of the camera."""

    material: str | None = None
    reference_dn: int | None = None
    position: str | None = None
    ask_second_position: bool = False
    scale_std: float = STEREO_SCALE_STD


def frame_result(
    depth: NDArray[np.uint16], intrinsics: Intrinsics, depth_unit_m: float, color: NDArray[np.uint8] | None = None
) -> Result:
    """The whole survey on one picture: the spread comes from resampling its points."""
    frame = estimate_frame(depth, intrinsics, depth_unit_m, resamples=SINGLE_FRAME_RESAMPLES)
    return diameter_result([frame], PipeContext(), None if color is None else picture_quality(color))


def diameter_result(frames: Sequence[FrameEstimate], context: PipeContext, quality: PictureQuality | None = None) -> Result:
    """The finding of one recording (one camera, one position)."""
    thresholds, errors = shipped()
    recording = combine(frames, replace(errors, scale_std=context.scale_std))
    reasons = list(reasons_to_refuse(recording, thresholds))
    measured = recording.fitted > 0
    diameter_mm = 1000 * recording.diameter
    if not reasons and context.ask_second_position and diameter_mm > SECOND_POSITION_FROM_MM:
        reasons.append("second_position")
    low, high = recording.interval
    std_mm = 1000 * (high - low) / 3.92
    guess = dn.guess(diameter_mm, std_mm, context.material) if measured else None
    agrees = (
        dn.agrees(diameter_mm, context.reference_dn, context.material, TOLERANCE_MM)
        if measured and context.reference_dn is not None
        else None
    )
    typical = recording.typical
    profile = typical.profile if typical is not None else None
    return {
        "verdict": "retry" if reasons else "accept",
        "reasons": reasons,
        "prompts": [PROMPTS[code].to_json() for code in reasons],
        "warnings": _warnings(agrees, context.reference_dn, profile),
        "diameter_mm": _mm(recording.diameter),
        "interval_mm": [_mm(low), _mm(high)] if measured else None,
        "radius_std_mm": _mm(recording.radius_std, 3),
        "mean_mm": _mm(recording.mean),
        "inlier_weighted_mean_mm": _mm(recording.inlier_weighted_mean),
        "dn": None if guess is None else _dn_json(guess),
        "reference": None if agrees is None else {"dn": context.reference_dn, "agrees": agrees},
        "profile": None if profile is None else _profile_json(profile),
        "proxies": _proxies_json(recording),
        "frames": [_frame_json(frame) for frame in frames],
        "picture": {"good": None, "reasons": []}
        if quality is None
        else {"good": quality.good, "reasons": list(quality.reasons)},
        "questions": _questions(recording, quality),
        "position": context.position,
        "frames_used": recording.fitted,
    }


def choose(results: Sequence[Result]) -> Result:
    """Of several recordings of one pipe the surer one: accepted before refused, then of two cameras the one with the clearly
    narrower interval, which knows of the camera's own error, and then the one with the smaller radius std.

    Two positions settle a ``second_position``; two accepted results that differ by more than the tolerance settle nothing.
    """
    if not results:
        raise ValueError("there is no result to choose from")
    positions = {result["position"] for result in results}
    if len(positions) > 1:
        results = [_without(result, "second_position") for result in results]
    two_cameras = len({result.get("camera") for result in results}) > 1
    best = min(_clearly_narrowest(results) if two_cameras else results, key=_unsureness)
    rivals = [
        other
        for other in results
        if other is not best and other["verdict"] == "accept" and abs(other["diameter_mm"] - best["diameter_mm"]) > TOLERANCE_MM
    ]
    if best["verdict"] == "accept" and rivals:
        return {
            **best,
            "verdict": "retry",
            "reasons": ["unstable"],
            "prompts": [PROMPTS["unstable"].to_json()],
            "warnings": [*best["warnings"], {"code": "positions_disagree", "text": _disagreement(best, rivals[0])}],
        }
    return best


def live_summary(frames: Sequence[FrameEstimate]) -> Result:
    """What the page shows while the operator aims: the last few estimates with a gauge of trust and its reason."""
    thresholds, errors = shipped()
    recording = combine(frames[-LIVE_FRAMES:], errors)
    reasons = list(reasons_to_refuse(recording, thresholds))
    latest = frames[-1] if frames else None
    trust = _trust(recording, bool(reasons))
    level = "none" if recording.fitted == 0 else "good" if not reasons else "fair" if trust >= 0.4 else "poor"
    low, high = recording.interval
    return {
        "diameter_mm": _mm(recording.diameter),
        "interval_mm": [_mm(low), _mm(high)] if recording.fitted else None,
        "radius_std_mm": _mm(recording.radius_std, 3),
        "trust": round(trust, 2),
        "level": level,
        "reasons": reasons,
        "prompt": PROMPTS[reasons[0]].to_json() if reasons else None,
        "circle": circles(latest.fit, latest.intrinsics) if latest is not None and latest.fit is not None else [],
    }


def circles(fit: CylinderFit, intrinsics: Intrinsics, count: int = 3) -> list[list[list[float]]]:
    """The fitted cylinder as closed lines in the picture: rings along the seen wall, as fractions of width and height."""
    angle = np.linspace(0, 2 * np.pi, 49)
    basis = orthonormal_basis(fit.axis)
    ring = fit.radius * (np.cos(angle)[:, None] * basis[:, 0] + np.sin(angle)[:, None] * basis[:, 1])
    lines = []
    for along in np.linspace(-0.4, 0.4, count) * fit.length:
        points = fit.point + along * fit.axis + ring
        if points[:, 2].min() < 0.05:
            continue
        pixels = project_rays(points[:, :2] / points[:, 2:], intrinsics)
        fractions = np.clip(pixels / [intrinsics.width, intrinsics.height], -2.0, 3.0)
        lines.append([[round(float(x), 4), round(float(y), 4)] for x, y in fractions])
    return lines


def _trust(recording: RecordingEstimate, refused: bool) -> float:
    """0 to 1 for the gauge: half from the spread against the tolerance, half from the angle that is seen; below 0.7 where
    refused."""
    if recording.fitted == 0:
        return 0.0
    steadiness = math.exp(-2000 * recording.radius_std / TOLERANCE_MM)
    view = min(recording.support.coverage / math.pi, 1.0)
    trust = 0.5 * steadiness + 0.5 * view
    return min(trust, 0.69) if refused else max(trust, 0.7)


def _unsureness(result: Result) -> tuple[bool, float]:
    spread = result["radius_std_mm"]
    return result["verdict"] != "accept", math.inf if spread is None else spread


def _clearly_narrowest(results: Sequence[Result]) -> list[Result]:
    """Of the accepted ones, or of all where none is, those whose interval is not clearly wider than the narrowest."""
    sound = [result for result in results if result["verdict"] == "accept"] or list(results)
    widths = [math.inf if result["interval_mm"] is None else float(np.ptp(result["interval_mm"])) for result in sound]
    return [result for result, width in zip(sound, widths, strict=True) if width <= ALIKE * min(widths)]


def _without(result: Result, code: str) -> Result:
    reasons = [reason for reason in result["reasons"] if reason != code]
    prompts = [prompt for prompt in result["prompts"] if prompt["code"] != code]
    return {**result, "reasons": reasons, "prompts": prompts, "verdict": "retry" if reasons else "accept"}


def _disagreement(one: Result, other: Result) -> str:
    return f"Two measurements of this pipe differ: {one['diameter_mm']:.0f} mm and {other['diameter_mm']:.0f} mm."


def _warnings(agrees: bool | None, reference_dn: int | None, profile: Profile | None) -> list[dict[str, str]]:
    warnings = []
    if agrees is False:
        warnings.append(
            {"code": "reference", "text": f"The map says DN {reference_dn}; the measured diameter does not fit that."}
        )
    if profile is not None and profile.water is not None:
        warnings.append(
            {
                "code": "water",
                "text": f"A flat surface {1000 * profile.water.depth:.0f} mm deep lies in the invert: water or deposit.",
            }
        )
    if profile is not None and profile.ovality > 0.05:
        warnings.append({"code": "ovality", "text": f"The pipe is out of round by {100 * profile.ovality:.0f} %."})
    return warnings


def _questions(recording: RecordingEstimate, quality: PictureQuality | None) -> list[Result]:
    """The paper's three visual questions with what can be measured of their answers."""
    fit = recording.typical.fit if recording.typical is not None else None
    measured = {
        "image_good": None if quality is None else quality.good,
        "cloud_is_pipe": None if fit is None else fit.area >= 4.0 and fit.inlier_share >= 0.35,
        "fit_aligned": None if fit is None else math.sqrt(fit.mse) < 0.03 * fit.radius + 0.002,
    }
    return [{"code": code, "text": text, "measured": measured[code]} for code, text in QUESTIONS.items()]


def _dn_json(guess: dn.DnGuess) -> Result:
    others = [{"name": name, "probability": round(p, 3)} for name, p in guess.alternatives]
    return {"name": guess.name, "probability": round(guess.probability, 3), "alternatives": others}


def _proxies_json(recording: RecordingEstimate) -> Result:
    units = {
        "inlier_share": ("inlier_share", 1.0),
        "mse": ("mse_mm2", 1e6),
        "radius": ("radius_mm", 1e3),
        "orientation": ("orientation", 1.0),
    }
    return {
        name: {"mean": _number(recording.proxies[key][0] * scale), "std": _number(recording.proxies[key][1] * scale)}
        for key, (name, scale) in units.items()
    }


def _frame_json(frame: FrameEstimate) -> Result:
    fit = frame.fit
    if fit is None:
        return {"diameter_mm": None, "inlier_share": None, "mse_mm2": None, "orientation": None}
    return {
        "diameter_mm": _mm(2 * fit.radius),
        "inlier_share": round(fit.inlier_share, 3),
        "mse_mm2": round(1e6 * fit.mse, 2),
        "orientation": round(fit.orientation, 4),
    }


def _profile_json(profile: Profile) -> Result:
    water = profile.water
    return {
        "minimum_mm": _mm(profile.minimum_diameter),
        "maximum_mm": _mm(profile.maximum_diameter),
        "mean_mm": _mm(profile.mean_diameter),
        "ovality_percent": _number(100 * profile.ovality, 2),
        "coverage_deg": round(math.degrees(profile.coverage)),
        "angles_deg": [round(math.degrees(a), 1) for a in profile.angles],
        "radii_mm": [_mm(float(r)) for r in profile.radii],
        "water": None
        if water is None
        else {
            "depth_mm": _mm(water.depth),
            "width_mm": _mm(water.width),
            "from_clock": _clock(
                water.angle - math.asin(min(water.width / (2 * math.hypot(water.width / 2, water.height)), 1.0))
            ),
            "to_clock": _clock(
                water.angle + math.asin(min(water.width / (2 * math.hypot(water.width / 2, water.height)), 1.0))
            ),
        },
    }


def _clock(image_angle: float) -> float:
    """Clock hour of an image angle atan2(v, u): (3 + degrees / 30) mod 12, with 12 for 0."""
    return round((3 + math.degrees(image_angle) / 30) % 12, 1) or 12.0


def _mm(metres: float, digits: int = 1) -> float | None:
    return _number(1000 * metres, digits)


def _number(value: float, digits: int = 4) -> float | None:
    return round(value, digits) if math.isfinite(value) else None
