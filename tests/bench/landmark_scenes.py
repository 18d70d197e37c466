"""Drives past landmarks, seen by a detector of stated precision and recall: truth, detections, and how a map compares.

What a detector makes of a deposit of some length is not stated by the paper: it may hit it anywhere (``anywhere``), put its one
point at the centroid of the patch in the picture (``centroid``), or in the middle of what shows along the pipe (``middle``).
That is why these scenes are not the virtual sewer's, whose detector knows outlines; Table II and its bursts are.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.virtual.detections import TABLE_II, struck
from estimators.landmarks.from_detections import Rig, Rows
from estimators.landmarks.types import Landmark

__all__ = ["TABLE_II", "Detector", "Matched", "Seen", "Truth", "compare", "detect", "nearest", "table_rows"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Truth:
    """A landmark from ``low`` to ``high`` (m) at an image angle (rad); ``angle_known`` where the record states it."""

    label: str
    low: float
    high: float
    angle: float
    angle_known: bool = True

    @property
    def middle(self) -> float:
        return (self.low + self.high) / 2


@dataclass(frozen=True)
class Detector:
    """How detections come about. ``absent_rate`` is the rate of false detections per frame of a class that does not occur,
    ``bursty`` the share of misses and of false detections that come in bursts, ``jitter`` (px) how much a burst trembles."""

    table: Mapping[str, tuple[float, float]]
    noise: float = 15.0
    sees: float = 3.0
    law: str = "anywhere"
    absent_rate: float = 0.08
    bursty: float = 0.5
    burst: tuple[int, int] = (5, 20)
    jitter: float = 0.0


@dataclass(frozen=True)
class Seen:
    """One row a detection: ``frame`` (n,), ``pixels`` (n, 2), ``label`` (n), ``truth`` (n,) the number of its landmark or -1;
    ``visible`` counts per class the frames in which a landmark could be seen (for the recall that was reached)."""

    frame: NDArray[np.int64]
    pixels: Array
    label: list[str]
    truth: NDArray[np.int64]
    visible: dict[str, int]


def detect(rig: Rig, positions: Array, truths: Sequence[Truth], detector: Detector, rng: np.random.Generator) -> Seen:
    """Detections of a drive at camera ``positions`` (n,) (m)."""
    rows: list[tuple[int, float, float, str, int]] = []
    visible = dict.fromkeys(detector.table, 0)
    for number, truth in enumerate(truths):
        recall = detector.table[truth.label][1]
        near = nearest(rig, truth.angle)
        first = np.maximum(truth.low - positions, near)
        last = np.minimum(truth.high - positions, detector.sees)
        frames = np.flatnonzero(last >= first)
        visible[truth.label] += len(frames)
        for frame in frames[~missed(len(frames), 1 - recall, detector, rng)]:
            depth = _depth(float(first[frame]), float(last[frame]), detector.law, rng)
            u = rig.cx + rig.fx * rig.radius * np.cos(truth.angle) / depth + rng.normal(0, detector.noise)
            v = rig.cy + rig.fy * rig.radius * np.sin(truth.angle) / depth + rng.normal(0, detector.noise)
            if 0 <= u < rig.width and 0 <= v < rig.height:
                rows.append((int(frame), float(u), float(v), truth.label, number))
    for label, (precision, _) in detector.table.items():
        right = sum(row[3] == label for row in rows)
        rate = right / len(positions) * (1 - precision) / precision if right else detector.absent_rate
        rows += [(*false, label, -1) for false in _false(rig, len(positions), rate, detector, rng)]
    rows.sort(key=lambda row: row[0])
    return Seen(
        np.array([row[0] for row in rows], dtype=np.int64),
        np.array([row[1:3] for row in rows], dtype=np.float64).reshape(-1, 2),
        [row[3] for row in rows],
        np.array([row[4] for row in rows], dtype=np.int64),
        visible,
    )


def nearest(rig: Rig, angle: float) -> float:
    """Depth (m) at which a point of the wall leaves the picture."""
    x, y = rig.fx * rig.radius * np.cos(angle), rig.fy * rig.radius * np.sin(angle)
    room = (rig.width - rig.cx if x > 0 else rig.cx, rig.height - rig.cy if y > 0 else rig.cy)
    return float(max(abs(x) / room[0], abs(y) / room[1]))


def missed(count: int, share: float, detector: Detector, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Which of ``count`` frames in a row are hit by something that strikes ``share`` of them, part of it in bursts.

    Single and bursty ones overlap; both rates are such that together they strike the share that was asked for.
    """
    bursty = share * detector.bursty
    single = rng.random(count) < (share - bursty) / max(1 - bursty, 1e-9)
    return single | struck(count, bursty, detector.burst, rng)


def _false(rig: Rig, frames: int, rate: float, detector: Detector, rng: np.random.Generator) -> list[tuple[int, float, float]]:
    """False detections anywhere in the picture: single ones, and bursts that stay where they are in it."""
    found = []
    for frame in np.flatnonzero(rng.random(frames) < rate * (1 - detector.bursty)):
        found.append((int(frame), float(rng.uniform(0, rig.width)), float(rng.uniform(0, rig.height))))
    length = (detector.burst[0] + detector.burst[1]) / 2
    for start in np.flatnonzero(rng.random(frames) < rate * detector.bursty / length):
        u, v = rng.uniform(0, rig.width), rng.uniform(0, rig.height)
        stop = min(frames, int(start) + int(rng.integers(detector.burst[0], detector.burst[1] + 1)))
        for frame in range(int(start), stop):
            du, dv = rng.normal(0, detector.jitter, 2) if detector.jitter else (0.0, 0.0)
            found.append((frame, float(u + du), float(v + dv)))
    return found


def _depth(first: float, last: float, law: str, rng: np.random.Generator) -> float:
    """Depth (m) of the one point the detector makes of what shows between two depths."""
    if last - first < 1e-9:
        return first
    if law == "anywhere":
        return float(rng.uniform(first, last))
    if law == "middle":
        return (first + last) / 2
    if law == "centroid":
        return 1.5 * (first**-2 - last**-2) / (first**-3 - last**-3)
    raise ValueError(f"There is no law {law!r}.")


def table_rows(seen: Seen, shown: Array, times: Array, centres: Array | None = None) -> Rows:
    """The detections as the command gets them: one row each, one empty row for a frame without."""
    empty = np.setdiff1d(np.arange(len(shown)), seen.frame)
    frame = np.concatenate([seen.frame, empty])
    order = np.argsort(frame, kind="stable")
    nothing = np.full((len(empty), 2), np.nan)
    pixels = np.concatenate([seen.pixels, nothing])[order]
    labels = [*seen.label, *([""] * len(empty))]
    frame = frame[order]
    return Rows(
        frame=frame,
        time_s=times[frame],
        chainage=shown[frame],
        u=pixels[:, 0],
        v=pixels[:, 1],
        label=[labels[k] for k in order],
        score=np.where(np.isfinite(pixels[:, 0]), 1.0, np.nan),
        foe=None if centres is None else centres[frame],
    )


@dataclass(frozen=True)
class Matched:
    """A truth and the landmark found for it (None: missed); errors along (m) of the middle and around (rad)."""

    truth: Truth
    landmark: Landmark | None
    along: float = np.nan
    around: float = np.nan


def compare(
    truths: Sequence[Truth], landmarks: Sequence[Landmark], tolerance: float = 1.0, turn: float = np.radians(45)
) -> tuple[list[Matched], list[Landmark]]:
    """Each truth with its landmark, of the same class within ``tolerance`` (m) and ``turn`` (rad), best pairs first; and the
    landmarks that are nobody's: the false ones."""
    pairs = []
    for i, truth in enumerate(truths):
        for k, landmark in enumerate(landmarks):
            along = abs((landmark.chainage_from + landmark.chainage_to) / 2 - truth.middle)
            around = abs((landmark.angle - truth.angle + np.pi) % (2 * np.pi) - np.pi)
            if landmark.label == truth.label and along < tolerance and around < turn:
                pairs.append((along / tolerance + around / turn, i, k, along, around))
    found: dict[int, Matched] = {}
    used: set[int] = set()
    for _, i, k, along, around in sorted(pairs):
        if i not in found and k not in used:
            found[i] = Matched(truths[i], landmarks[k], along, around)
            used.add(k)
    matched = [found.get(i, Matched(truth, None)) for i, truth in enumerate(truths)]
    return matched, [landmark for k, landmark in enumerate(landmarks) if k not in used]
