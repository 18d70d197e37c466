"""From what a drive has seen to the smoother and back: the same landmarks at better places, and what the smoother found out."""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimators.landmarks.projection import View
from estimators.landmarks.smoothing import (
    NO_RINGS,
    Constraints,
    Frames,
    Known,
    RingSightings,
    Run,
    Sightings,
    Smoothed,
    smooth,
)
from estimators.landmarks.types import Landmark

log = logging.getLogger(__name__)

Array = NDArray[np.float64]

PIXEL_STD = 8.0
"""Of one sighting (px): a centroid wanders over its landmark. The smoother finds by how much this is wrong."""
RING_STD = 1.5
LENGTH_STD = 0.03
"""Of the length from node to node that somebody states (m)."""
CALIBRATED_STD = 0.005
TRUSTED = 0.5
"""Probability from which a slip is told."""
LEAST_SLIP_M = 0.05


@dataclass(frozen=True)
class FrameNote:
    """What the smoother needs of one frame: ``number`` and time, metres by the tether (nan for none), where it looked."""

    number: int
    time_s: float
    encoder: float
    view: View


@dataclass(frozen=True)
class SeenJoint:
    """One sighting of joint ``joint``: radius (px) of its ring along u in frame ``number``."""

    joint: int
    number: int
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
    frames: Sequence[FrameNote],
    landmarks: Sequence[Landmark],
    joints: Sequence[SeenJoint],
    radius: float,
    aspect: float,
    focal_radius: Known | None,
    length: float | None = None,
) -> Mapped | None:
    """The map of a drive, smoothed; None where there is nothing to smooth or the smoother does not come to an end.

    ``radius`` (m) is what ``View.axis`` counts in; ``length`` the way from the first frame to the last, where it is known.
    """
    index = {note.number: k for k, note in enumerate(frames)}
    run = Run(_frames(frames, radius), _sightings(landmarks, index), _rings(joints, index), aspect, _labels(landmarks))
    encoder = run.frames.encoder
    if np.isfinite(encoder).sum() < 2 or (len(run.sightings.landmark) == 0 and len(run.rings.joint) == 0):
        return None
    constraints = Constraints(
        focal_radius=focal_radius,
        length=None if length is None else Known(math.copysign(length, _way(encoder)), LENGTH_STD),
    )
    smoothed = smooth(run, constraints)
    if not smoothed.converged or not np.isfinite(smoothed.positions).all():
        log.warning("smoothing did not converge; the map stays as it was")
        return None
    return _mapped(smoothed, frames, landmarks)


def _frames(frames: Sequence[FrameNote], radius: float) -> Frames:
    return Frames(
        np.array([note.time_s for note in frames], dtype=np.float64),
        np.array([note.encoder for note in frames], dtype=np.float64),
        np.array([note.view.centre for note in frames], dtype=np.float64).reshape(-1, 2),
        np.array([note.view.axis for note in frames], dtype=np.float64).reshape(-1, 2) / radius,
    )


def _sightings(landmarks: Sequence[Landmark], index: dict[int, int]) -> Sightings:
    rows = [
        (landmark.id, index[seen.frame], seen.u, seen.v)
        for landmark in landmarks
        if landmark.chainage_to - landmark.chainage_from < 1e-6  # the middle of what shows of a long thing is no one place
        for seen in landmark.sightings
        if seen.frame in index
    ]
    ids = np.array([row[0] for row in rows], dtype=np.int64)
    at = np.array([row[1] for row in rows], dtype=np.int64)
    pixels = np.array([row[2:] for row in rows], dtype=np.float64).reshape(-1, 2)
    return Sightings(ids, at, pixels, np.full(len(rows), PIXEL_STD))


def _rings(joints: Sequence[SeenJoint], index: dict[int, int]) -> RingSightings:
    rows = [(seen.joint, index[seen.number], seen.radius_px) for seen in joints if seen.number in index]
    if not rows:
        return NO_RINGS
    ids, at, radii = (np.array(column) for column in zip(*rows, strict=True))
    return RingSightings(ids.astype(np.int64), at.astype(np.int64), radii.astype(np.float64), np.full(len(rows), RING_STD))


def _labels(landmarks: Sequence[Landmark]) -> dict[int, str]:
    return {landmark.id: landmark.label for landmark in landmarks}


def _way(encoder: Array) -> float:
    known = encoder[np.isfinite(encoder)]
    return float(known[-1] - known[0])


def _mapped(smoothed: Smoothed, frames: Sequence[FrameNote], landmarks: Sequence[Landmark]) -> Mapped:
    times = np.array([note.time_s for note in frames])
    shifts = smoothed.positions - np.array([note.view.position for note in frames])
    better = {found.id: found for found in smoothed.landmarks}
    moved: list[Landmark] = []
    for landmark in landmarks:
        found = better.get(landmark.id)
        if found is not None:
            shift, angle = found.chainage - landmark.chainage, found.angle - landmark.angle
            covariance = found.covariance
        else:  # a long thing goes where the frames went that saw it
            seen = [entry.time_s for entry in landmark.sightings]
            shift = float(np.interp(seen, times, shifts).mean()) if seen else 0.0
            angle, covariance = 0.0, landmark.covariance
        moved.append(
            replace(
                landmark,
                chainage=landmark.chainage + shift,
                chainage_from=landmark.chainage_from + shift,
                chainage_to=landmark.chainage_to + shift,
                angle=landmark.angle + angle,
                angle_from=landmark.angle_from + angle,
                angle_to=landmark.angle_to + angle,
                covariance=covariance,
            )
        )
    slips = [
        {
            "time_s": round(slip.start_s, 2),
            "chainage_m": round(slip.chainage, 2),
            "what": "slip_found",
            "text": f"The crawler went {slip.metres:+.2f} m (to {slip.std:.2f} m) that the tether did not count.",
        }
        for slip in smoothed.slips
        if slip.probability >= TRUSTED and abs(slip.metres) >= LEAST_SLIP_M
    ]
    summary = {
        "from_m": round(float(smoothed.positions.min()), 3),
        "to_m": round(float(smoothed.positions.max()), 3),
        "scale": {"value": round(smoothed.scale.value, 5), "sigma": round(smoothed.scale.std, 5)},
        "focal_radius": {"value": round(smoothed.focal_radius.value, 2), "sigma": round(smoothed.focal_radius.std, 3)},
    }
    joints = [
        {"chainage_m": round(joint.chainage, 3), "sightings": joint.sightings, "sigma_chainage_m": round(joint.std, 4)}
        for joint in smoothed.joints
    ]
    return Mapped(tuple(moved), joints, slips, summary, times, shifts)
