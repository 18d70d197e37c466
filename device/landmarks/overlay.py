"""The CCTV picture with what the box makes of it drawn in: the projected cylinder, tracked landmarks, joints just seen."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from estimators.landmarks.projection import PipeCamera, View, project

Image = NDArray[np.uint8]
Color = tuple[int, int, int]

NEAREST_M = 0.25
FARTHEST_M = 6.0
_AROUND = np.linspace(-math.pi, math.pi, 73)
_HOURS = np.arange(12) * math.pi / 6
_GRID: Color = (96, 176, 96)
_JOINT: Color = (240, 200, 60)
_TRACK: dict[str, Color] = {"candidate": (170, 170, 170), "confirmed": (60, 220, 255), "passed": (120, 160, 120)}
_BACK: Color = (0, 0, 0)


@dataclass(frozen=True)
class Mark:
    """A tracked landmark: ``text`` beside the place (chainage m, image angle rad) where it should be seen."""

    text: str
    status: str
    chainage: float
    angle: float


@dataclass(frozen=True)
class Scene:
    """What is drawn. ``camera`` is None while f * R is not known: then there is no grid. ``joints`` are ellipses as cv2 takes
    them: centre, axes (px), angle (deg)."""

    camera: PipeCamera | None
    view: View
    marks: Sequence[Mark] = ()
    joints: Sequence[tuple[tuple[float, float], tuple[float, float], float]] = ()


def draw(image: Image, scene: Scene) -> Image:
    """A copy of ``image`` (H, W, 3) with ``scene`` drawn in."""
    picture = image.copy()
    for joint in scene.joints:
        if all(math.isfinite(value) for value in (*joint[0], *joint[1])) and min(joint[1]) >= 1:
            cv2.ellipse(picture, joint, _JOINT, 1, cv2.LINE_AA)
    if scene.camera is not None:
        _grid(picture, scene.camera, scene.view)
        _marks(picture, scene.camera, scene.view, scene.marks)
    _cross(picture, scene.view.centre)
    return picture


def _grid(picture: Image, camera: PipeCamera, view: View) -> None:
    begin = math.ceil(view.position + NEAREST_M)
    for metre in range(begin, math.floor(view.position + FARTHEST_M) + 1):
        ring = project(camera, view, np.stack([np.full_like(_AROUND, metre), _AROUND], axis=1))
        _line(picture, ring)
        _label(picture, f"{metre} m", project(camera, view, np.array([[metre, -math.pi / 4]]))[0], _GRID)
    along = view.position + np.geomspace(NEAREST_M, FARTHEST_M, 24)
    for hour in _HOURS:
        _line(picture, project(camera, view, np.stack([along, np.full_like(along, hour)], axis=1)))


def _marks(picture: Image, camera: PipeCamera, view: View, marks: Sequence[Mark]) -> None:
    if not marks:
        return
    places = project(camera, view, np.array([(mark.chainage, mark.angle) for mark in marks], dtype=np.float64))
    for mark, place in zip(marks, places, strict=True):
        if not _within(picture, place):
            continue
        color = _TRACK.get(mark.status, _GRID)
        at = (round(float(place[0])), round(float(place[1])))
        cv2.circle(picture, at, 14, _BACK, 3, cv2.LINE_AA)
        cv2.circle(picture, at, 14, color, 2, cv2.LINE_AA)
        _label(picture, mark.text, place + np.array([18.0, 4.0]), color)


def _line(picture: Image, points: NDArray[np.float64]) -> None:
    """The runs of ``points`` (n, 2) that are anywhere near the picture; nan breaks the line."""
    height, width = picture.shape[:2]
    near = np.isfinite(points).all(axis=1) & (np.abs(points) < 4 * max(width, height)).all(axis=1)
    for run in np.split(np.arange(len(points)), np.flatnonzero(~near)):
        kept = run[near[run]]
        if len(kept) > 1:
            cv2.polylines(picture, [np.round(points[kept]).astype(np.int32)], False, _GRID, 1, cv2.LINE_AA)


def _label(picture: Image, text: str, place: NDArray[np.float64], color: Color) -> None:
    if not _within(picture, place):
        return
    at = (round(float(place[0])), round(float(place[1])))
    for shade, thickness in ((_BACK, 3), (color, 1)):
        cv2.putText(picture, text, at, cv2.FONT_HERSHEY_SIMPLEX, 0.42, shade, thickness, cv2.LINE_AA)


def _cross(picture: Image, centre: tuple[float, float]) -> None:
    if _within(picture, np.asarray(centre, dtype=np.float64)):
        at = (round(centre[0]), round(centre[1]))
        cv2.drawMarker(picture, at, (255, 255, 255), cv2.MARKER_CROSS, 14, 1, cv2.LINE_AA)


def _within(picture: Image, place: NDArray[np.float64]) -> bool:
    height, width = picture.shape[:2]
    return bool(np.isfinite(place).all() and 0 <= place[0] < width and 0 <= place[1] < height)
