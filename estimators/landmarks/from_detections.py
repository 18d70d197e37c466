"""A map from a table of detections and a tether: what an old inspection leaves when nobody was there to drive.

All frames are at hand, so the counter's steps are seen through with both neighbours known, the mapper runs once more with the
detector's noise as found the first time, and each landmark is estimated from all its sightings at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from estimators.detections import Detection
from estimators.landmarks.mapper import Mapper, MapperConfig
from estimators.landmarks.projection import PipeCamera, View
from estimators.landmarks.refine import refine
from estimators.landmarks.types import Landmark, Observation
from estimators.odometry import FASTEST, bridge, destep

Array = NDArray[np.float64]

PASSES = 3
FALLING = 0.7
"""So much of the way downwards is a drive downwards."""
AGREED = 0.12
"""The noise (px) is found when it changes by less than this share from one pass to the next."""
LEAST_STEP = 0.004
"""A counter with smaller steps (m) is as good as one without."""
NOMINAL_FPS = 25.0
SAME = 0.01
"""Chainages (m) of one frame that differ by more contradict each other."""
SMOOTH_STD = 0.004
"""Of a position (m) that comes without steps."""


@dataclass(frozen=True)
class Rig:
    """The camera in the pipe: focal lengths and principal point (px), interior radius (m), size of the picture (px)."""

    fx: float
    fy: float
    cx: float
    cy: float
    radius: float
    width: int
    height: int


@dataclass(frozen=True)
class Rows:
    """Detections, one row each, and one with nan ``u`` for each frame without: ``frame`` (n,), ``time_s`` (n,), ``chainage``
    (n,) as the counter showed it (m), ``u``, ``v`` (n,) px, ``label`` (n), ``score`` (n,); ``foe`` (n, 2) the principal point
    of the row's frame (px), nan or None where it is that of the rig."""

    frame: NDArray[np.int64]
    time_s: Array
    chainage: Array
    u: Array
    v: Array
    label: Sequence[str]
    score: Array
    foe: Array | None = None


@dataclass(frozen=True)
class CounterJump:
    """The counter jumped by ``metres`` at ``time_s``, when the crawler was at ``position`` (m, on the way that goes on); how
    far it drove meanwhile is known to ``std`` (m)."""

    time_s: float
    metres: float
    position: float
    std: float


@dataclass(frozen=True)
class Way:
    """Of each frame, in the order of frames: ``times`` (n,) s, and ``shown`` (n,) m by the counter, its ``jumps`` taken out: up
    to the first one the way is the counter's, beyond it goes on from where it was. ``step`` (m) of the counter, or 0."""

    times: Array
    shown: Array
    step: float
    jumps: tuple[CounterJump, ...]


def map_detections(rows: Rows, rig: Rig, config: MapperConfig | None = None) -> list[Landmark]:
    """The landmarks, along the pipe. Raises ValueError for a table that makes no sense.

    Where the chainage falls nearly all the way, the crawler was pulled back, or it drove towards its zero: which of the two,
    the detections tell, for what is ahead grows in the picture.
    """
    config = config or MapperConfig()
    found = _map(rows, rig, config)
    frames = np.unique(rows.frame, return_index=True)[1]
    steps = np.diff(rows.chainage[frames])
    if -steps[steps < 0].sum() < FALLING * np.abs(steps).sum() or not len(steps):
        return found
    ahead = _map(replace(rows, chainage=-rows.chainage), rig, config)
    if sum(one.hits for one in ahead) <= sum(one.hits for one in found):
        return found
    return sorted((_mirrored(one) for one in ahead), key=lambda one: one.chainage)


def _mirrored(landmark: Landmark) -> Landmark:
    """Mapped with chainages of the other sign."""
    turn = np.diag([-1.0, 1.0])
    sightings = tuple(replace(one, view=replace(one.view, position=-one.view.position)) for one in landmark.sightings)
    return replace(
        landmark,
        chainage=-landmark.chainage,
        chainage_from=-landmark.chainage_to,
        chainage_to=-landmark.chainage_from,
        covariance=turn @ landmark.covariance @ turn,
        ends=None if landmark.ends is None else landmark.ends[::-1, ::-1].copy(),
        sightings=sightings,
    )


def _map(rows: Rows, rig: Rig, config: MapperConfig) -> list[Landmark]:
    """The landmarks, for a camera that looks towards growing chainages."""
    camera = PipeCamera(rig.fx, rig.fy, rig.radius, rig.width, rig.height)
    observations, unsure = observations_of(rows, rig)
    jumps = way_of(rows).jumps
    if not any(o.detections for o in observations):
        return []
    names = list(dict.fromkeys([*config.classes, *(name for name in rows.label if name)]))
    reaching = {_plain(name) for name in config.long_classes}
    config = replace(config, long_classes=tuple(name for name in names if _plain(name) in reaching))
    for _ in range(PASSES):
        mapper = Mapper(camera, config)
        for observation in observations:
            mapper.update(observation)
        mapper.finish()
        refined = refine(camera, observations, mapper.landmarks(), config, names)
        settled = abs(refined.pixel_std / config.pixel_std - 1) < AGREED
        config = replace(config, pixel_std=refined.pixel_std)
        if settled:
            break
    # what is beyond a jump is as far from the start as nobody knows how far was driven while the counter leapt
    return [
        landmark.less_sure(unsure**2 + sum(jump.std**2 for jump in jumps if jump.position < landmark.chainage))
        for landmark in refined.landmarks
    ]


def _plain(name: str) -> str:
    """A class as others may write it: "Displaced_Joint"."""
    return name.strip().casefold().replace("_", " ")


def observations_of(rows: Rows, rig: Rig) -> tuple[list[Observation], float]:
    """One observation per frame in order of frames, positions freed from the counter's steps; and the standard deviation (m) of
    what no sighting can tell: whether the counter rounds to the nearest step or down.

    The two differ by half a step. With a quarter of a step added neither is off by more than that.
    """
    count = len(rows.frame)
    if not all(len(column) == count for column in (rows.time_s, rows.chainage, rows.u, rows.v, rows.label, rows.score)):
        raise ValueError("The columns of the detections have different lengths.")
    if not np.all(np.isfinite(rows.chainage)):
        raise ValueError("There are frames without a chainage: the map needs the distance in each frame.")
    for name, value in (("fx", rig.fx), ("fy", rig.fy), ("radius_m", rig.radius), ("width", rig.width), ("height", rig.height)):
        if not (np.isfinite(value) and value > 0):
            raise ValueError(f"{name} of the rig must be a positive number, got {value}.")
    numbers, first, inverse = np.unique(rows.frame, return_index=True, return_inverse=True)
    shown = rows.chainage[first]
    other = np.flatnonzero(np.abs(rows.chainage - shown[inverse]) > SAME)
    if len(other):
        at = int(other[0])
        raise ValueError(f"Frame {rows.frame[at]} has two chainages, {shown[inverse[at]]:g} and {rows.chainage[at]:g}.")
    given = np.diff(rows.time_s[first])
    speed = np.abs(np.diff(shown)) / given if (given > 0).all() else np.zeros(0)
    if len(speed) > 1 and float(np.median(speed)) > FASTEST:
        raise ValueError(
            f"The crawler would have driven at {np.median(speed):.0f} m/s: chainage_m is in metres, time_s in seconds."
        )
    way = way_of(rows)
    times, shown, step = way.times, way.shown, way.step
    if step > 0:
        positions, std = destep(times, shown, step)
        positions = positions + step / 4
        unsure = step / 4
    else:
        positions, std, unsure = shown, np.full(len(shown), SMOOTH_STD), 0.0
    centres = np.tile([rig.cx, rig.cy], (len(numbers), 1)).astype(np.float64)
    if rows.foe is not None:
        given = rows.foe[first]
        centres = np.where(np.isfinite(given), given, centres)
    detections: list[list[Detection]] = [[] for _ in numbers]
    for k in np.flatnonzero(np.isfinite(rows.u) & np.isfinite(rows.v)):
        score = float(rows.score[k]) if np.isfinite(rows.score[k]) else 1.0
        detections[inverse[k]].append(Detection(float(rows.u[k]), float(rows.v[k]), rows.label[int(k)], score))
    observations = [
        Observation(
            int(numbers[k]),
            float(times[k]),
            View(float(positions[k]), (float(centres[k, 0]), float(centres[k, 1]))),
            tuple(detections[k]),
            float(std[k]),
            2.0,
        )
        for k in range(len(numbers))
    ]
    return observations, unsure


def way_of(rows: Rows) -> Way:
    """Where the frames of a table were taken, by its counter."""
    first = np.unique(rows.frame, return_index=True)[1]
    times, told = _growing(rows.time_s[first]), rows.chainage[first]
    step = counter_step(told)
    step = step if step > LEAST_STEP else 0.0
    shown, jumps = bridge(times, told, step)
    return Way(
        times,
        shown,
        step,
        tuple(CounterJump(float(times[jump.index]), jump.metres, float(shown[jump.index]), jump.std) for jump in jumps),
    )


def counter_step(shown: Array) -> float:
    """The step (m) of a counter, 0 for one that runs smoothly.

    All changes are multiples of the step. A smooth position that was written with some decimals has a step too, that of the
    last decimal, but a tiny one; and that of a crawler at one speed changes by the same from each frame to the next, which no
    counter does that counts now and then.
    """
    every = np.abs(np.diff(shown))
    moves = every > 1e-6
    changes = every[moves]
    if len(changes) == 0:
        return 0.0
    step = float(np.median(changes[changes < 1.5 * changes.min()]))
    usual = changes[changes <= np.quantile(changes, 0.98, method="lower")]  # without the jumps of one that was set
    if np.ptp(usual) < 0.01 * step and (moves[1:] & moves[:-1]).sum() > 0.9 * (moves.sum() - 1):
        return 0.0
    whole = changes / step
    fits = np.abs(whole - np.round(whole)) < 0.02 + 1e-3 * whole
    return step if fits.mean() > 0.95 else 0.0


def _growing(times: Array) -> Array:
    """Times (s) of the frames; where they do not grow, those of a common frame rate."""
    if len(times) and np.all(np.isfinite(times)) and np.all(np.diff(times) > 0):
        return times
    return np.arange(len(times)) / NOMINAL_FPS
