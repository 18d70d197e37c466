"""The map once more, with all frames at hand: every landmark against every sighting of the whole run.

The mapper meets a landmark far off, where its chainage is a guess, and must decide at once. Afterwards the chainage is known
from the last sightings before it left the picture, and the first ones can be looked at again: which detections are its own
(global nearest neighbour with the landmarks held fixed), where it lies (least squares, robust), how far it reaches, and
whether the misses before and after speak against it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from estimators.landmarks import belief
from estimators.landmarks.mapper import MapperConfig, thumbnail_size
from estimators.landmarks.projection import PipeCamera, View
from estimators.landmarks.refine.detector import errors_of, false_density, granted, noise, reach, starts
from estimators.landmarks.refine.doubles import echoes, join, split
from estimators.landmarks.refine.fit import fit
from estimators.landmarks.refine.judge import judge, shows_in
from estimators.landmarks.refine.own import own
from estimators.landmarks.refine.run import Reach, Run, Spot, lay_out
from estimators.landmarks.types import Evidence, Landmark, Observation, Sighting

Array = NDArray[np.float64]

ROUNDS = 3
LEAST = 3
"""Fewer sightings than this are no landmark."""


@dataclass(frozen=True)
class Refined:
    """The landmarks, and what they say of the detector: its noise (px, per axis), and how far it sees (m)."""

    landmarks: list[Landmark]
    pixel_std: float
    far: float


def refine(
    camera: PipeCamera,
    observations: Sequence[Observation],
    found: Sequence[Landmark],
    config: MapperConfig,
    names: Sequence[str],
) -> Refined:
    """Landmarks of a run anew from all of its ``observations``, starting at those the mapper ``found``.

    ``names`` are the classes, those of the mapper that found them.
    """
    run = lay_out(camera, observations, names, config)
    spots = [_first(run, landmark) for landmark in found]
    far, pixel_std = starts(found, 10 * camera.radius), config.pixel_std
    sees = Reach(0.0, far)
    for turn in range(ROUNDS):
        spots = own(run, spots, pixel_std, far if turn else 3 * far)
        sees = reach(run, spots, far)
        far = sees.far
        known = granted(run, spots)
        spots = [fit(run, spot, pixel_std, sees, known) for spot in spots if len(spot.rows) >= LEAST]
        spots = join(run, spots, sees)
        spots = [part for spot in spots for part in split(run, spot, pixel_std, sees)]
        pixel_std = noise(run, spots, pixel_std)
    known = granted(run, spots)
    spots = [fit(run, spot, pixel_std, sees, known) for spot in own(run, spots, pixel_std, far) if len(spot.rows) >= LEAST]
    shown = [shows_in(run, spot, far, pixel_std) for spot in spots]
    errors, density = errors_of(run, spots, shown), false_density(run, spots)
    judged = [(spot, *judge(run, spot, shows, density, errors, pixel_std)) for spot, shows in zip(spots, shown, strict=True)]
    good = [one for one in judged if one[1] > config.confirm and one[2] >= config.least_hits]
    strayed = echoes([one[0] for one in good], [one[2] / (one[2] + one[3]) for one in good], far)
    kept = sorted((one for one, echo in zip(good, strayed, strict=True) if not echo), key=lambda one: one[0].middle)
    landmarks = [_landmark(run, *one, number) for number, one in enumerate(kept, 1)]
    return Refined(landmarks, pixel_std, far)


def same_ids(refined: Sequence[Landmark], found: Sequence[Landmark]) -> list[Landmark]:
    """The ``refined`` landmarks under the ids of those ``found`` (with sightings) that they share most sightings with; what is
    nobody's gets a new one."""
    owner = {(seen.frame, seen.u, seen.v): landmark.id for landmark in found for seen in landmark.sightings}
    shared: list[tuple[int, int, int]] = []
    for k, landmark in enumerate(refined):
        owners = [owner[key] for seen in landmark.sightings if (key := (seen.frame, seen.u, seen.v)) in owner]
        shared += [(owners.count(one), k, one) for one in set(owners)]
    ids: dict[int, int] = {}
    for _, k, one in sorted(shared, reverse=True):
        if k not in ids and one not in ids.values():
            ids[k] = one
    fresh = max((landmark.id for landmark in found), default=0)
    for k in range(len(refined)):
        if k not in ids:
            fresh += 1
            ids[k] = fresh
    return [
        replace(landmark, id=ids[k], sightings=tuple(replace(seen, landmark=ids[k]) for seen in landmark.sightings))
        for k, landmark in enumerate(refined)
    ]


def _first(run: Run, landmark: Landmark) -> Spot:
    shares = np.array([landmark.belief.get(name, 0.0) for name in run.names])
    shares = shares / shares.sum() if shares.sum() > 0 else np.full(len(run.names), 1 / len(run.names))
    return Spot(
        landmark.chainage_from,
        landmark.chainage_to,
        landmark.angle,
        landmark.covariance,
        list(run.names).index(landmark.label),
        shares,
        np.zeros(0, dtype=np.intp),
    )


def _landmark(
    run: Run,
    spot: Spot,
    score: float,
    seen: int,
    missed: int,
    number: int,
) -> Landmark:
    sightings = tuple(
        Sighting(
            number,
            int(run.frames.number[frame]),
            float(run.frames.time_s[frame]),
            View(
                float(run.frames.position[frame]),
                (float(run.frames.centre[frame, 0]), float(run.frames.centre[frame, 1])),
                (float(run.frames.axis[frame, 0]), float(run.frames.axis[frame, 1])),
            ),
            float(run.detections.centroid[row, 0]),
            float(run.detections.centroid[row, 1]),
            run.names[int(run.detections.label[row])],
            float(run.detections.score[row]),
            (float(run.detections.pixels[row, 0]), float(run.detections.pixels[row, 1])),
        )
        for row in spot.rows
        for frame in (int(run.detections.frame[row]),)
    )
    sizes = [thumbnail_size(run.camera, s.view, s.u, s.v, 0.0) for s in sightings]
    inside = [
        size if min(s.u, s.v, run.camera.width - s.u, run.camera.height - s.v) > 0.3 * size else 0.0
        for s, size in zip(sightings, sizes, strict=True)
    ]
    best = int(np.argmax(inside if max(inside) > 0 else sizes))
    shown = sightings[best]
    return Landmark(
        id=number,
        label=run.names[spot.label],
        status="passed",
        chainage=spot.middle,
        angle=spot.angle,
        covariance=spot.covariance,
        chainage_from=spot.low,
        chainage_to=spot.high,
        angle_from=spot.angle + _around(run.detections.before[spot.rows]),
        angle_to=spot.angle + _around(run.detections.after[spot.rows]),
        belief=belief.named(run.names, spot.belief, score),
        hits=seen,
        misses=missed,
        first_frame=sightings[0].frame,
        last_frame=sightings[-1].frame,
        evidence=Evidence(shown.frame, shown.u, shown.v, sizes[best]),
        sightings=sightings,
        ends=spot.ends,
    )


def _around(reach: Array) -> float:
    """Median reach round the pipe (rad) of those outlines there are, 0 without."""
    known = reach[np.isfinite(reach)]
    return float(np.median(known)) if len(known) else 0.0
