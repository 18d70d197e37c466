"""A whole run laid out as arrays, and where a landmark of the wall shows in each of its frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimators.landmarks import belief
from estimators.landmarks.ekf import wrap
from estimators.landmarks.extent import wall_patches
from estimators.landmarks.mapper import MapperConfig
from estimators.landmarks.projection import NEAREST, PipeCamera
from estimators.landmarks.types import Observation

Array = NDArray[np.float64]
Index = NDArray[np.intp]

LONG_FROM = 0.12
"""Shorter than this (m) a thing is a point."""


@dataclass(frozen=True)
class Detections:
    """All detections of a run, one row each: ``frame`` is the place of its observation in the run, ``pixels`` (n, 2) the point
    of the wall in its middle, by its outline where it has one, and ``centroid`` (n, 2) what the detector said."""

    frame: Index
    pixels: Array
    centroid: Array
    label: Index
    score: Array
    inverse_depth: Array
    """1/Z (1/m) on the wall (eq. 20)."""
    angle: Array
    before: Array
    after: Array
    """How far each reaches round the pipe of its angle (rad), nan where it has no outline."""
    near: Array
    far: Array
    """1/Z (1/m) of its outline's near and far edge, nan where it has none."""


@dataclass(frozen=True)
class Frames:
    """All frames of a run: ``position`` (m), ``centre`` (n, 2) px, ``axis`` (n, 2) m, ``std`` (n,) of the position and
    ``centre_std`` (n,) (px), ``number`` (n,), ``time_s`` (n,), and ``weight`` (n,): how much of a fresh look each is, by how
    far the crawler had moved."""

    position: Array
    centre: Array
    axis: Array
    std: Array
    centre_std: Array
    number: NDArray[np.int64]
    time_s: Array
    weight: Array


@dataclass(frozen=True)
class Run:
    """All there is: ``names`` are the classes, ``matrix`` their confusion."""

    camera: PipeCamera
    frames: Frames
    detections: Detections
    names: Sequence[str]
    matrix: Array
    config: MapperConfig


@dataclass(frozen=True)
class Errors:
    """Errors (3,) of centre (px, two) and of the logarithm of a landmark's distance from the axis as its sightings show them,
    with their variances (3,)."""

    value: Array
    variance: Array


@dataclass(frozen=True)
class Granted:
    """Standard deviations of what is taken for granted: ``centre`` (px, each coordinate), and ``share`` of the logarithm of how
    far from the axis, in radii, a landmark is taken to be."""

    centre: float
    share: float


@dataclass(frozen=True)
class Spot:
    """A landmark while it is being worked on; ``rows`` of the Detections that are its own; ``ends`` (2, 2) is the covariance of
    ``low`` and ``high``, None for a point; ``errors`` what a point's sightings say of what is taken for granted."""

    low: float
    high: float
    angle: float
    covariance: Array
    label: int
    belief: Array
    rows: Index
    ends: Array | None = None
    errors: Errors | None = None

    @property
    def middle(self) -> float:
        return (self.low + self.high) / 2


@dataclass(frozen=True)
class Reach:
    """The detector sees things from ``near`` to ``far`` (m) ahead; ``near`` is 0 where it sees them until they leave the
    picture, and where nobody knows (``near_known``)."""

    near: float
    far: float
    near_known: bool = False


def lay_out(camera: PipeCamera, observations: Sequence[Observation], names: Sequence[str], config: MapperConfig) -> Run:
    """The run as arrays. ``names`` must hold every label there is."""
    frames = _frames(observations, config.fresh)
    detections = _detections(camera, observations, frames, names)
    return Run(camera, frames, detections, names, belief.confusion(len(names), config.right_label), config)


def _frames(observations: Sequence[Observation], fresh: float) -> Frames:
    position = np.array([o.view.position for o in observations])
    moved = np.abs(np.diff(position, prepend=position[:1] - fresh))
    weight = np.zeros(len(position))
    since = 0.0
    for k, step in enumerate(moved):
        since += step
        if observations[k].detections is None:
            continue
        weight[k] = min(since / fresh, 1.0)
        since = 0.0
    return Frames(
        position,
        np.array([o.view.centre for o in observations]).reshape(-1, 2),
        np.array([o.view.axis for o in observations]).reshape(-1, 2),
        np.array([o.position_std for o in observations]),
        np.array([o.centre_std for o in observations]),
        np.array([o.frame for o in observations], dtype=np.int64),
        np.array([o.time_s for o in observations]),
        weight,
    )


def _detections(camera: PipeCamera, observations: Sequence[Observation], frames: Frames, names: Sequence[str]) -> Detections:
    place = {name: k for k, name in enumerate(names)}
    listed = [(k, d.u, d.v, place[d.label], d.score) for k, o in enumerate(observations) for d in o.detections or ()]
    table = np.array(listed, dtype=np.float64).reshape(-1, 5)
    frame = table[:, 0].astype(np.intp)
    pixels = table[:, 1:3]
    a = (pixels[:, 0] - frames.centre[frame, 0]) / camera.fx
    b = (pixels[:, 1] - frames.centre[frame, 1]) / camera.fy
    axis = frames.axis[frame]
    along = a * axis[:, 0] + b * axis[:, 1]
    rho2 = np.maximum(a * a + b * b, 1e-12)
    depth = (along + np.sqrt(along**2 + rho2 * (camera.radius**2 - (axis**2).sum(axis=1)))) / rho2
    angle = np.arctan2(b * depth - axis[:, 1], a * depth - axis[:, 0])
    before, after, near, far = np.full((4, len(frame)), np.nan)
    row = 0
    for observation in observations:
        found = observation.detections or ()
        drawn = [k for k, d in enumerate(found) if d.outline]
        if drawn:
            rows = [row + k for k in drawn]
            patches = wall_patches(camera, observation.view, [found[k].outline for k in drawn], pixels[rows])
            before[rows], after[rows] = patches.before, patches.after
            near[rows] = 1 / (patches.low - observation.view.position)
            far[rows] = 1 / (patches.high - observation.view.position)
        row += len(found)
    # a component that is bent round the pipe has its centroid inside the pipe: its middle on the wall is that of its outline
    outlined = np.isfinite(near) & np.isfinite(far)
    turn = np.where(outlined, (before + after) / 2, 0.0)
    angle, inverse = wrap(angle + turn), np.where(outlined, (near + far) / 2, 1.0 / depth)
    wall = axis + camera.radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    middle = frames.centre[frame] + np.array([camera.fx, camera.fy]) * wall * inverse[:, None]
    on_wall = np.where(outlined[:, None], middle, pixels)
    return Detections(
        frame,
        on_wall,
        pixels,
        table[:, 3].astype(np.intp),
        table[:, 4],
        inverse,
        angle,
        before - turn,
        after - turn,
        near,
        far,
    )


def predict(run: Run, which: Index, chainage: Array, angle: Array | float) -> tuple[Array, Array]:
    """Pixels (n, 2) of a point of the wall in the frames ``which`` (n,), and its depth (n,) (eq. 5)."""
    depth = chainage - run.frames.position[which]
    safe = np.maximum(depth, NEAREST)
    x = run.frames.axis[which, 0] + run.camera.radius * np.cos(angle)
    y = run.frames.axis[which, 1] + run.camera.radius * np.sin(angle)
    u = run.frames.centre[which, 0] + run.camera.fx * x / safe
    v = run.frames.centre[which, 1] + run.camera.fy * y / safe
    return np.stack([u, v], axis=1), depth


def spread(camera: PipeCamera, depth: Array, std: Array, pixel_std: float) -> tuple[Array, Array]:
    """Standard deviations (px) of a sighting along and across the ray from the centre: the tether's error moves it along."""
    f = np.sqrt(camera.fx * camera.fy)
    return np.hypot(pixel_std, f * camera.radius / np.maximum(depth, NEAREST) ** 2 * std), np.full_like(depth, pixel_std)


def distance2_of(run: Run, rows: Index, spot: Spot, pixel_std: float) -> Array:
    """Squared Mahalanobis distance of detections ``rows`` to the nearest point of the landmark, which may reach further by what
    its ends are unsure of: what is kept from it would confirm that it ends there."""
    which = run.detections.frame[rows]
    seen = run.frames.position[which] + 1.0 / run.detections.inverse_depth[rows]
    before, after = (0.0, 0.0) if spot.ends is None else np.sqrt(np.diag(spot.ends))
    chainage = np.clip(seen, spot.low - before, spot.high + after)
    expected, depth = predict(run, which, chainage, spot.angle)
    off = run.detections.pixels[rows] - expected
    ray = expected - run.frames.centre[which]
    ray /= np.maximum(np.hypot(ray[:, 0], ray[:, 1]), 1e-6)[:, None]
    radial = (off * ray).sum(axis=1)
    across = off[:, 0] * ray[:, 1] - off[:, 1] * ray[:, 0]
    along_std, across_std = spread(run.camera, depth, run.frames.std[which], pixel_std)
    f = np.sqrt(run.camera.fx * run.camera.fy)
    slope = f * run.camera.radius / np.maximum(depth, NEAREST)
    along_std = np.hypot(along_std, slope / np.maximum(depth, NEAREST) * np.sqrt(spot.covariance[0, 0]))
    across_std = np.hypot(across_std, slope * np.sqrt(spot.covariance[1, 1]))
    distance2 = (radial / along_std) ** 2 + (across / across_std) ** 2
    return np.where((depth > NEAREST) & (run.detections.inverse_depth[rows] > 0), distance2, np.inf)


def nearest_depth(camera: PipeCamera, centre: Array, angle: float) -> float:
    """Depth (m) at which a point of the wall at ``angle`` leaves the picture."""
    x, y = camera.fx * camera.radius * np.cos(angle), camera.fy * camera.radius * np.sin(angle)
    room_x = camera.width - centre[0] if x > 0 else centre[0]
    room_y = camera.height - centre[1] if y > 0 else centre[1]
    return float(max(abs(x) / max(room_x, 1.0), abs(y) / max(room_y, 1.0), NEAREST))
