"""What a detector says of the virtual sewer's pictures: the truth, or as much of it as the CCTV paper's Table II leaves.

A frame's detections depend on the drive, the moment and the generator alone. Misses and false detections that last for some
frames are settled by the detector's ``seed`` and the drive's, so that any frame can be asked for, in any order.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from drivers.virtual.camera import CctvCamera, on_wall
from drivers.virtual.drive import Drive
from drivers.virtual.landmarks import LandmarkTruth
from drivers.virtual.rig import Pose

Array = NDArray[np.float64]
TABLE_II: Mapping[str, tuple[float, float]] = MappingProxyType(
    {
        "connection": (0.71, 0.88),
        "deposit": (0.70, 0.74),
        "displaced joint": (0.69, 0.94),
        "fracture": (0.74, 0.74),
        "roots": (0.75, 0.87),
    }
)
"""Precision and recall of the CCTV paper's Table II."""
NEAR_M, FAR_M = 0.4, 2.5
"""What lies nearer or farther ahead of the camera than this is not seen."""
_POINT_PX = 900.0
"""Area of a detection of a thing without extent one metre ahead; the paper's heatmaps are coarse."""
_SAMPLES = 200


@dataclass(frozen=True)
class SeenLandmark:
    """One detection: its centroid ``u``, ``v`` (px), its class, its ``area`` (px), points (u, v) on its ``outline``, and the id
    of the landmark that it is, None for a false one."""

    u: float
    v: float
    label: str
    area: float = 0.0
    outline: tuple[tuple[float, float], ...] = ()
    landmark_id: int | None = None


@dataclass(frozen=True)
class Detector:
    """``table`` is (precision, recall) per class; ``noise_px`` the standard deviation of u and of v; ``bursty`` the share of
    misses and of false detections that come in bursts of ``burst`` frames at ``fps``, false ones fixed in the picture.

    Of a class that does not occur in the pipe, where precision says nothing, ``absent_rate`` false ones come per frame.
    """

    table: Mapping[str, tuple[float, float]] = field(default_factory=lambda: TABLE_II, hash=False)
    noise_px: float = 15.0
    bursty: float = 0.5
    burst: tuple[int, int] = (5, 20)
    absent_rate: float = 0.02
    fps: float = 25.0
    seed: int = 0


def ideal(drive: Drive, t: float) -> list[SeenLandmark]:
    """Every landmark that the camera sees at ``t`` seconds, where it is."""
    return ideal_at(drive.camera, drive.pose(t), drive.sewer.radius, drive.sewer.landmarks)


def ideal_at(camera: CctvCamera, pose: Pose, radius: float, landmarks: Sequence[LandmarkTruth]) -> list[SeenLandmark]:
    """The ``landmarks`` that a camera at ``pose`` in a pipe of ``radius`` (m) sees.

    A long one is seen from NEAR_M to FAR_M ahead, and its centroid is that of the part that lies in the picture.
    """
    found = []
    for landmark in landmarks:
        first = max(landmark.chainage, pose.chainage + NEAR_M)
        last = min(landmark.chainage_to, pose.chainage + FAR_M)
        if last < first:
            continue
        seen = _seen(camera, pose, radius, landmark, first, last)
        if seen is not None:
            found.append(seen)
    return found


def corrupted(drive: Drive, t: float, rng: np.random.Generator, detector: Detector | None = None) -> list[SeenLandmark]:
    """What a detector like the paper's makes of the picture at ``t`` seconds. ``rng`` gives pixel noise and what is missed or
    invented in a single frame."""
    detector = detector or Detector()
    plan = _plan(drive, detector)
    return plan.applied(round(t * detector.fps), ideal(drive, t), rng)


def recorded(
    camera: CctvCamera,
    radius: float,
    positions: Sequence[float] | Array,
    landmarks: Sequence[LandmarkTruth],
    rng: np.random.Generator,
    detector: Detector | None = None,
) -> list[list[SeenLandmark]]:
    """The same for a recorded way: one list for each frame, whose camera was at ``positions`` (m) on the axis of a pipe of
    ``radius`` (m) in which ``landmarks`` lie."""
    detector = detector or Detector()
    frames = [ideal_at(camera, Pose(chainage=float(z)), radius, landmarks) for z in positions]
    plan = _Plan(detector, camera, landmarks, frames, len(frames), rng)
    return [plan.applied(number, seen, rng) for number, seen in enumerate(frames)]


def _seen(
    camera: CctvCamera, pose: Pose, radius: float, landmark: LandmarkTruth, first: float, last: float
) -> SeenLandmark | None:
    if landmark.chainage == landmark.chainage_to and landmark.angle == landmark.angle_to:
        pixel = camera.project(pose, on_wall(radius, np.array([first]), np.array([landmark.angle])))
        if not camera.holds(pixel)[0]:
            return None
        u, v = (float(value) for value in pixel[0])
        return SeenLandmark(u, v, landmark.label, _POINT_PX / (first - pose.chainage) ** 2, (), landmark.id)
    outline = _outline(camera, pose, radius, landmark, first, last)
    if len(outline) < 2:
        return None
    u, v, area = _centroid(outline)
    points = tuple((float(x), float(y)) for x, y in outline)
    return SeenLandmark(u, v, landmark.label, area, points, landmark.id)


def _outline(camera: CctvCamera, pose: Pose, radius: float, landmark: LandmarkTruth, first: float, last: float) -> Array:
    """Border (n, 2) in the picture of the part from chainage ``first`` to ``last``: near edge, far edge, cut at the picture's
    border. A thing without length or without width is a line there and back."""
    angle = np.linspace(landmark.angle, landmark.angle_to, 9)
    # evenly in the picture, where depth counts by its inverse
    depth = 1 / np.linspace(1 / (first - pose.chainage), 1 / (last - pose.chainage), 9)
    along = pose.chainage + depth
    chainage = np.concatenate([np.full(9, along[0]), along, np.full(9, along[-1]), along[::-1]])
    around = np.concatenate([angle, np.full(9, angle[-1]), angle[::-1], np.full(9, angle[0])])
    pixels = camera.project(pose, on_wall(radius, chainage, around))
    return _cut(pixels[np.isfinite(pixels[:, 0])], camera)


def _cut(polygon: Array, camera: CctvCamera) -> Array:
    """The part of a ``polygon`` (n, 2) that lies in the picture (Sutherland and Hodgman)."""
    if len(polygon) == 0 or camera.holds(polygon).all():
        return polygon
    points = [(float(u), float(v)) for u, v in polygon]
    for axis, side, limit in ((0, 1, 0.0), (0, -1, camera.width - 1.0), (1, 1, 0.0), (1, -1, camera.height - 1.0)):
        kept: list[tuple[float, float]] = []
        for a, b in zip(points, points[1:] + points[:1], strict=True):
            inside_a, inside_b = side * (a[axis] - limit) >= 0, side * (b[axis] - limit) >= 0
            if inside_a:
                kept.append(a)
            if inside_a != inside_b:
                share = (limit - a[axis]) / (b[axis] - a[axis])
                across = a[1 - axis] + share * (b[1 - axis] - a[1 - axis])
                kept.append((limit, across) if axis == 0 else (across, limit))
        points = kept
    return np.array(points).reshape(-1, 2)


def _centroid(polygon: Array) -> tuple[float, float, float]:
    """u, v of the middle and the area (px); of a line the middle of its points."""
    after = np.roll(polygon, -1, axis=0)
    origin = polygon.mean(axis=0)
    (x0, y0), (x1, y1) = (polygon - origin).T, (after - origin).T
    cross = x0 * y1 - x1 * y0
    area = float(cross.sum() / 2)
    if abs(area) < 4.0:
        return float(origin[0]), float(origin[1]), max(abs(area), 4.0)
    u, v = origin + np.array([((x0 + x1) * cross).sum(), ((y0 + y1) * cross).sum()]) / (6 * area)
    return float(u), float(v), abs(area)


class _Plan:
    """Which bursts befall a run of ``frames`` frames, and how often single frames go wrong."""

    def __init__(
        self,
        detector: Detector,
        camera: CctvCamera,
        landmarks: Sequence[LandmarkTruth],
        sample: Sequence[Sequence[SeenLandmark]],
        frames: int,
        rng: np.random.Generator,
    ) -> None:
        self._detector, self._camera, self._frames = detector, camera, max(frames, 1)
        self._missing: dict[int, NDArray[np.bool_]] = {}
        self._single: dict[str, float] = {}
        for landmark in landmarks:
            missed = 1 - detector.table[landmark.label][1]
            bursty = missed * detector.bursty
            self._single[landmark.label] = (missed - bursty) / max(1 - bursty, 1e-9)
            self._missing[landmark.id] = struck(self._frames, bursty, detector.burst, rng)
        self._single_false: dict[str, float] = {}
        self._false: dict[int, list[SeenLandmark]] = {}
        for label, (precision, recall) in detector.table.items():
            right = recall * sum(seen.label == label for frame in sample for seen in frame) / max(len(sample), 1)
            occurs = any(landmark.label == label for landmark in landmarks)
            rate = right * (1 - precision) / precision if occurs else detector.absent_rate
            self._single_false[label] = rate * (1 - detector.bursty)
            mean_frames = (detector.burst[0] + detector.burst[1]) / 2
            for start in np.flatnonzero(rng.random(self._frames) < rate * detector.bursty / mean_frames):
                invented = self._invented(label, rng)
                for number in range(int(start), int(start) + int(rng.integers(detector.burst[0], detector.burst[1] + 1))):
                    self._false.setdefault(number % self._frames, []).append(invented)

    def applied(self, number: int, seen: Sequence[SeenLandmark], rng: np.random.Generator) -> list[SeenLandmark]:
        """What the detector makes of frame ``number`` in which ``seen`` is to be seen."""
        number %= self._frames
        found = []
        for one in seen:
            assert one.landmark_id is not None
            single = rng.random() < self._single[one.label]
            du, dv = (float(value) for value in rng.normal(0, self._detector.noise_px, 2))
            u, v = one.u + du, one.v + dv
            if single or self._missing[one.landmark_id][number] or not self._camera.holds(np.array([[u, v]]))[0]:
                continue
            outline = tuple((x + du, y + dv) for x, y in one.outline)
            found.append(SeenLandmark(u, v, one.label, one.area, outline, one.landmark_id))
        found += self._false.get(number, [])
        for label, rate in self._single_false.items():
            found += [self._invented(label, rng) for _ in range(int(rng.poisson(rate)))]
        return found

    def _invented(self, label: str, rng: np.random.Generator) -> SeenLandmark:
        """A false detection somewhere in the picture."""
        u, v = rng.uniform(0, (self._camera.width - 1, self._camera.height - 1))
        return SeenLandmark(float(u), float(v), label, float(rng.uniform(0.3, 3.0)) * _POINT_PX)


@lru_cache(maxsize=8)
def _plan(drive: Drive, detector: Detector) -> _Plan:
    frames = math.ceil(drive.length_s * detector.fps)
    sample = [ideal(drive, float(t)) for t in np.linspace(0, drive.length_s, _SAMPLES)]
    rng = np.random.default_rng([drive.seed, detector.seed, 81])
    return _Plan(detector, drive.camera, drive.sewer.landmarks, sample, frames, rng)


def struck(frames: int, share: float, burst: tuple[int, int], rng: np.random.Generator) -> NDArray[np.bool_]:
    """Which of ``frames`` are hit by bursts that hit ``share`` of them; a frame is free of them with (1 - rate)^length."""
    rate = 1 - (1 - share) ** (2 / (burst[0] + burst[1]))
    struck = np.zeros(frames, bool)
    for start in np.flatnonzero(rng.random(frames + burst[1]) < rate) - burst[1]:
        struck[max(int(start), 0) : max(int(start) + int(rng.integers(burst[0], burst[1] + 1)), 0)] = True
    return struck
