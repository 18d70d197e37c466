"""What the detector is taught with: labelled stills, stills with boxes, pictures of the virtual sewer."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from device.fcdd.archive import NORMAL, Still, read_picture
from device.fcdd.frames import rendered_frames
from estimators.detections import CLASSES

KEPT = (480, 360)
"""Pictures are kept a little larger than the network sees them, so that an augmentation can look closer."""
AUXILIARY = ("obstacle", "broken", "deformation", "open joint")
"""Labels that archives have beside the classes: learnt too, for what they teach the head, and cut off at the end."""
UNKNOWN = 0.7
"""How much counts that a still of another defect lacks a label: it was not verified to be absent."""
UNHEARD = 0.3
"""The same of a label that no still of the archive has: nobody looked for it at all."""
UPRIGHT = {"deposit", "obstacle"}
"""What lies at the invert: a picture with it must not be turned upside down."""
FRAMES_EACH = 6
PLACED = ("connection", "deposit")
"""What is learnt from where it is in rendered pictures, whose image-level labels teach the network only to know those: hardly
any archive of stills has connections, and no deposit of a still looks like those of the virtual sewer."""


@dataclass(frozen=True)
class Place:
    """Where a thing is: ``u``, ``v`` and points of its ``outline`` as shares of width and height; none for a point."""

    label: str
    u: float
    v: float
    outline: tuple[tuple[float, float], ...] = ()


@dataclass(frozen=True)
class Lesson:
    """One picture with what is known of it. ``labels`` and ``weights`` (names,), 0 for what is not known; ``group`` and
    ``source`` for splitting; ``kind`` is "stills", "boxes" or "rendered"."""

    picture: NDArray[np.uint8]
    labels: NDArray[np.float32]
    weights: NDArray[np.float32]
    group: str
    source: str
    upright: bool
    kind: str
    places: tuple[Place, ...] = ()


def taught_names(classes: tuple[str, ...]) -> tuple[str, ...]:
    """The classes, and what is learnt beside them."""
    return (*classes, *(name for name in AUXILIARY if name not in classes))


def lessons_of(stills: list[Still], names: tuple[str, ...], kind: str = "stills") -> list[Lesson]:
    """Labelled stills. Only a picture that is said to be normal surely lacks everything."""
    known = {label for still in stills for label in still.labels}
    found = []
    for still in stills:
        labels = np.array([name in still.labels for name in names], np.float32)
        doubt = np.array([UNKNOWN if name in known else UNHEARD for name in names], np.float32)
        if NORMAL in still.labels:
            doubt = np.maximum(doubt, np.float32(0.999))
        weights = np.where(labels > 0, np.float32(1), doubt).astype(np.float32)
        picture = np.asarray(cv2.resize(read_picture(still), KEPT, interpolation=cv2.INTER_AREA), np.uint8)
        found.append(Lesson(picture, labels, weights, still.cluster, still.source, bool(still.labels & UPRIGHT), kind))
    return found


def rendered_lessons(pipes: int, seed: int, names: tuple[str, ...], work: Path) -> list[Lesson]:
    """Pictures of the virtual sewer, kept in ``work``; what may or may not be made out in one weighs nothing."""
    file = work / f"rendered_places_{seed}_{pipes}.npz"
    if not file.exists():
        _render(file, pipes, seed)
    kept = np.load(file)
    pictures, facts = kept["pictures"], json.loads(str(kept["facts"]))
    found = []
    for number, (picture, fact) in enumerate(zip(pictures, facts, strict=True)):
        places = tuple(Place(label, u, v, tuple((x, y) for x, y in outline)) for label, u, v, outline in fact["seen"])
        seen = {place.label for place in places}
        labels = np.array([name in seen for name in names], np.float32)
        weights = np.array([name in CLASSES and name not in fact["unsure"] for name in names], np.float32)
        group = f"virtual {seed}.{number // FRAMES_EACH}"
        found.append(Lesson(picture, labels, weights, group, "virtual", bool(seen & UPRIGHT), "rendered", places))
    return found


def _render(file: Path, pipes: int, seed: int) -> None:
    pictures, facts = [], []
    for frame in rendered_frames(pipes, FRAMES_EACH, seed):
        height, width = frame.image.shape[:2]
        pictures.append(cv2.resize(frame.image, KEPT, interpolation=cv2.INTER_AREA))
        seen = [
            (one.label, one.u / width, one.v / height, [(u / width, v / height) for u, v in one.outline]) for one in frame.seen
        ]
        facts.append({"seen": seen, "unsure": sorted(frame.unsure)})
    part = file.with_suffix(".part.npz")
    np.savez(part, facts=json.dumps(facts), pictures=np.stack(pictures))
    part.replace(file)
