"""From the mapper to the smoother and back."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from estimators.landmarks.projection import NEAREST, PipeCamera
from estimators.landmarks.smoothing.doubles import find_doubles, identified, merged
from estimators.landmarks.smoothing.solve import smooth
from estimators.landmarks.smoothing.types import (
    NO_RINGS,
    Array,
    Constraints,
    Frames,
    Noise,
    RingSightings,
    Run,
    Sightings,
    Smoothed,
)
from estimators.landmarks.types import Landmark, Observation


def run_of(
    observations: Sequence[Observation],
    landmarks: Sequence[Landmark],
    camera: PipeCamera,
    pixel_std: float = 15.0,
    rings: RingSightings = NO_RINGS,
    suspected: Sequence[float] = (),
) -> Run:
    """The run behind a map: ``observations`` of every frame (also of those without detections: they carry the tether), and the
    mapper's ``landmarks`` with their sightings. ``rings`` count frames as ``observations`` does, from 0.

    A long thing is sighted now here, now there: its sightings scatter by its extent too, and say little of the way.
    """
    views = [seen.view for seen in observations]
    frames = Frames(
        np.array([seen.time_s for seen in observations], dtype=np.float64),
        np.array([view.position for view in views], dtype=np.float64),
        np.array([view.centre for view in views], dtype=np.float64).reshape(-1, 2),
        np.array([view.axis for view in views], dtype=np.float64).reshape(-1, 2) / camera.radius,
    )
    place = {seen.frame: k for k, seen in enumerate(observations)}
    owner, frame, pixels, std = [], [], [], []
    for landmark in landmarks:
        reach = (landmark.chainage_to - landmark.chainage_from) / np.sqrt(12)
        for sighting in landmark.sightings:
            if sighting.frame not in place:
                continue
            depth = max(landmark.chainage - sighting.view.position, 10 * NEAREST)
            along = camera.fx * camera.radius / depth**2 * reach
            owner.append(landmark.id)
            frame.append(place[sighting.frame])
            pixels.append(sighting.on_wall or (sighting.u, sighting.v))
            std.append(float(np.hypot(pixel_std, along)))
    sightings = Sightings(
        np.array(owner, dtype=np.int64),
        np.array(frame, dtype=np.int64),
        np.array(pixels, dtype=np.float64).reshape(-1, 2),
        np.array(std, dtype=np.float64),
    )
    labels = {landmark.id: landmark.label for landmark in landmarks}
    return Run(frames, sightings, rings, camera.fy / camera.fx, labels, tuple(suspected))


def smooth_survey(
    run: Run,
    constraints: Constraints | None = None,
    noise: Noise | None = None,
    rng: np.random.Generator | None = None,
) -> tuple[Smoothed, dict[int, int]]:
    """Smooth, merge what was mapped twice, find the known laterals, and smooth with them; also tells which landmark (id) became
    which other."""
    constraints = constraints or Constraints()
    known = tuple(lateral for lateral in constraints.laterals if lateral.landmark is not None)
    smoothed = smooth(run, replace(constraints, laterals=known), noise, rng)
    same = find_doubles(run, smoothed)
    run = merged(run, same)
    laterals = identified(constraints.laterals, run, smoothed)
    laterals = tuple(
        replace(one, landmark=same.get(one.landmark, one.landmark)) for one in laterals if one.landmark is not None
    )
    if same or laterals != known:
        smoothed = smooth(run, replace(constraints, laterals=laterals), noise, rng)
    return smoothed, same


def moved(landmarks: Sequence[Landmark], smoothed: Smoothed) -> list[Landmark]:
    """The mapper's landmarks where the smoother puts them, extents and all; those it does not know (merged into another, or
    without sightings) are left out."""
    found = {mark.id: mark for mark in smoothed.landmarks}
    result = []
    for landmark in landmarks:
        mark = found.get(landmark.id)
        if mark is None:
            continue
        along = mark.chainage - landmark.chainage
        turn = float(np.angle(np.exp(1j * (mark.angle - landmark.angle))))
        covariance: Array = mark.covariance
        # where its ends lie about its middle is what it was
        ends = None if landmark.ends is None else landmark.ends + (covariance - landmark.covariance)[0, 0]
        result.append(
            replace(
                landmark,
                chainage=mark.chainage,
                angle=mark.angle,
                covariance=covariance,
                ends=ends,
                chainage_from=landmark.chainage_from + along,
                chainage_to=landmark.chainage_to + along,
                angle_from=landmark.angle_from + turn,
                angle_to=landmark.angle_to + turn,
            )
        )
    return sorted(result, key=lambda landmark: landmark.chainage)
