"""From what a drive has seen to the smoother and back: the same landmarks at better places, and what the smoother found out."""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimators.landmarks.projection import PipeCamera
from estimators.landmarks.smoothing import (
    NO_RINGS,
    Constraints,
    Known,
    RingSightings,
    Smoothed,
    moved,
    run_of,
    smooth_survey,
)
from estimators.landmarks.types import Landmark, Observation

log = logging.getLogger(__name__)

Array = NDArray[np.float64]

POINT_M = 0.1
"""A thing no longer than this (m) is at one place."""
RING_STD = 1.5
TETHER = Known(1.0, 0.02)
"""Metres travelled per metre counted: what a tether that nobody has checked is good for."""
LENGTH_STD = 0.03
"""Of the length from node to node that somebody states (m)."""
TRUSTED = 0.9
"""Probability from which a slip is told."""
LEAST_SLIP_M = 0.15
MOST_FRAMES = 6000
"""Beyond this many the frames without detections are thinned out: they only carry the tether."""


@dataclass(frozen=True)
class SeenJoint:
    """One sighting of joint ``joint`` in frame ``frame``: radius (px) of its ring along u."""

    joint: int
    frame: int
    radius_px: float


@dataclass(frozen=True)
class Mapped:
    """A map after smoothing: JSON-ready but for ``landmarks``. ``slips`` are events of the drive."""

    landmarks: tuple[Landmark, ...]
    joints: list[dict[str, Any]]
    slips: list[dict[str, Any]]
    summary: dict[str, Any]
    times: Array = field(repr=False)
    shifts: Array = field(repr=False)

    def shift(self, time_s: float) -> float:
        """By how much (m) smoothing moved the crawler at a moment."""
        return float(np.interp(time_s, self.times, self.shifts))


def smooth_drive(
    seen: Sequence[Observation],
    landmarks: Sequence[Landmark],
    joints: Sequence[SeenJoint],
    camera: PipeCamera,
    pixel_std: float,
    focal_radius: Known | None,
    length: float | None = None,
    suspected: Sequence[float] = (),
) -> Mapped | None:
    """The map of a drive, smoothed; None where there is nothing to smooth or the smoother does not come to an end.

    ``length`` is the way (m) from the first frame to the last, where it is known; ``suspected`` are the times (s) at which
    picture and tether disagreed.
    """
    seen = _thinned(seen)
    rings = _rings(joints, {one.frame: k for k, one in enumerate(seen)})
    points = [landmark for landmark in landmarks if landmark.chainage_to - landmark.chainage_from <= POINT_M]
    run = run_of(seen, points, camera, pixel_std, rings, suspected)
    if len(seen) < 2 or len(run.sightings.landmark) == 0:
        return None  # joints alone have been fitted to the tether already
    way = seen[-1].view.position - seen[0].view.position
    constraints = Constraints(
        focal_radius=focal_radius,
        scale=TETHER if length is None else None,
        length=None if length is None else Known(math.copysign(length, way), LENGTH_STD),
    )
    try:
        smoothed, _ = smooth_survey(run, constraints)
    except (ValueError, ArithmeticError, RuntimeError, np.linalg.LinAlgError) as error:
        log.warning("smoothing failed, the map stays as it was: %s", error)
        return None
    if not smoothed.converged or not np.isfinite(smoothed.positions).all():
        log.warning("smoothing did not converge; the map stays as it was")
        return None
    times = np.array([one.time_s for one in seen])
    shifts = smoothed.positions - np.array([one.view.position for one in seen])
    begun = float(times[0])
    known = {point.id for point in points}
    stds = smoothed.position_std
    long = [_shifted(landmark, times, shifts, stds) for landmark in landmarks if landmark.id not in known]
    found = sorted([*moved(points, smoothed), *long], key=lambda landmark: landmark.chainage)
    return Mapped(tuple(found), _joints(smoothed), _slips(smoothed, begun), _summary(smoothed), times, shifts)


def _shifted(landmark: Landmark, times: Array, shifts: Array, stds: Array) -> Landmark:
    """A long thing goes where the frames went that saw it, and is no surer than they are: what shows of its middle may go along
    with the camera, and would tell the smoother that the crawler stood."""
    moments = [seen.time_s for seen in landmark.sightings]
    if not moments:
        return landmark
    shift = float(np.interp(moments, times, shifts).mean())
    return replace(
        landmark.less_sure(float(np.interp(moments, times, stds).mean()) ** 2),
        chainage=landmark.chainage + shift,
        chainage_from=landmark.chainage_from + shift,
        chainage_to=landmark.chainage_to + shift,
    )


def _thinned(seen: Sequence[Observation]) -> list[Observation]:
    every = math.ceil(len(seen) / MOST_FRAMES)
    last = len(seen) - 1
    return [one for k, one in enumerate(seen) if one.detections or k % every == 0 or k == last]


def _rings(joints: Sequence[SeenJoint], place: dict[int, int]) -> RingSightings:
    rows = [(one.joint, place[one.frame], one.radius_px) for one in joints if one.frame in place]
    if not rows:
        return NO_RINGS
    ids, at, radii = (np.array(column) for column in zip(*rows, strict=True))
    return RingSightings(ids.astype(np.int64), at.astype(np.int64), radii.astype(np.float64), np.full(len(rows), RING_STD))


def _joints(smoothed: Smoothed) -> list[dict[str, Any]]:
    return [
        {"chainage_m": round(joint.chainage, 3), "sightings": joint.sightings, "sigma_chainage_m": round(joint.std, 4)}
        for joint in sorted(smoothed.joints, key=lambda joint: joint.chainage)
    ]


def _slips(smoothed: Smoothed, begun: float) -> list[dict[str, Any]]:
    return [
        {
            "time_s": round(slip.start_s - begun, 2),
            "chainage_m": round(slip.chainage, 2),
            "what": "slip_found",
            "text": f"The crawler went {slip.metres:+.2f} m, give or take {slip.std:.2f} m, that the tether did not count.",
        }
        for slip in smoothed.slips
        if slip.probability >= TRUSTED and abs(slip.metres) >= LEAST_SLIP_M
    ]


def _summary(smoothed: Smoothed) -> dict[str, Any]:
    return {
        "from_m": round(float(smoothed.positions.min()), 3),
        "to_m": round(float(smoothed.positions.max()), 3),
        "scale": {"value": round(smoothed.scale.value, 5), "sigma": round(smoothed.scale.std, 5)},
        "focal_radius": {"value": round(smoothed.focal_radius.value, 2), "sigma": round(smoothed.focal_radius.std, 3)},
    }
