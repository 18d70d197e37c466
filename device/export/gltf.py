"""A scene for a viewer (glTF 2.0, binary): the pipe as a tube, opened along the crown, with its landmarks and deviations on
the wall. Metres; z along the pipe from the start node, x right, y down."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from device.errors import Invalid
from device.export.base import Options
from device.inspections.model import Inspection

_COLOURS = {
    "connection": (40, 110, 200, 255),
    "deposit": (150, 105, 50, 255),
    "displaced joint": (220, 140, 20, 255),
    "fracture": (190, 30, 30, 255),
    "roots": (50, 140, 60, 255),
}
_OTHER, _WALL, _REGION = (120, 80, 160, 255), (200, 208, 212, 255), (220, 60, 120, 255)
_GAP = math.radians(60)
"""Of the wall left away at the crown, so that one sees in."""
_SIDES, _STEP_M = 40, 0.5


def gltf(inspection: Inspection, options: Options) -> bytes:
    """The file. Raises Invalid where neither a diameter nor a DN tells how wide the pipe is, or nothing how long."""
    from trimesh import Scene, Trimesh, creation  # here, since it takes a while

    radius, length = _radius(inspection), _length(inspection)
    scene = Scene()
    vertices, faces = _tube(radius, length)
    scene.add_geometry(Trimesh(vertices, faces, face_colors=_WALL, process=False), node_name=f"pipe {inspection.pipe.name}")
    for one in inspection.landmarks:
        if one.get("decision") == "rejected" or one.get("status") == "candidate":
            continue
        said = {**one, **(one.get("corrected") or {})}
        ball = creation.icosphere(subdivisions=1, radius=0.08 * radius + 0.01)
        ball.visual.face_colors = _COLOURS.get(str(said["class"]), _OTHER)
        ball.apply_translation(_on_wall(radius, float(said["chainage_m"]), said.get("clock")))
        scene.add_geometry(ball, node_name=f"{said['class']} {one['id']}")
    for number, region in enumerate(inspection.anomalies, 1):
        if region.get("chainage_m") is None:
            continue
        ball = creation.icosphere(subdivisions=1, radius=0.06 * radius + 0.01)
        ball.visual.face_colors = _REGION
        ball.apply_translation(_on_wall(radius, float(region["chainage_m"]), region.get("clock")))
        scene.add_geometry(ball, node_name=f"deviation {number}")
    data: bytes = scene.export(file_type="glb")
    return data


def _radius(inspection: Inspection) -> float:
    measured = [s.diameter_mm for s in inspection.diameters if s.verdict == "accept" and s.diameter_mm is not None]
    diameter_mm = measured[0] if measured else inspection.pipe.dn_mm
    if diameter_mm is None:
        raise Invalid("Nothing tells how wide the pipe is: measure its diameter or enter its DN.")
    return diameter_mm / 2000


def _length(inspection: Inspection) -> float:
    length = inspection.length or inspection.pipe.length or max((o.station for o in inspection.observations), default=0.0)
    if length <= 0:
        raise Invalid("Nothing tells how long the pipe is: enter its length.")
    return length


def _on_wall(radius: float, station: float, clock: float | None) -> tuple[float, float, float]:
    """A place on the wall; the invert where no clock position is known."""
    angle = math.radians(30 * ((clock if clock is not None else 6.0) - 3))
    return radius * math.cos(angle), radius * math.sin(angle), station


def _tube(radius: float, length: float) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Vertices (N, 3) and triangles (M, 3) of the wall but for the gap at the crown (image angle -90 degrees)."""
    rings = max(2, math.ceil(length / _STEP_M) + 1)
    angle = np.linspace(-math.pi / 2 + _GAP / 2, 1.5 * math.pi - _GAP / 2, _SIDES + 1)
    z = np.linspace(0, length, rings)
    zz, aa = np.meshgrid(z, angle, indexing="ij")
    vertices = np.stack([radius * np.cos(aa), radius * np.sin(aa), zz], axis=-1).reshape(-1, 3)
    first = (np.arange(rings - 1)[:, None] * (_SIDES + 1) + np.arange(_SIDES)).reshape(-1)
    one = np.stack([first, first + 1, first + _SIDES + 1], axis=1)
    two = np.stack([first + 1, first + _SIDES + 2, first + _SIDES + 1], axis=1)
    return vertices, np.concatenate([one, two])
