"""What is kept of a pair for the eye: the deviations of the unrolled wall, the reference picture with and without them, points.

The map is kept in steps of 0.05 mm as compressed whole numbers; every picture of it is drawn when it is asked for.
"""

from __future__ import annotations

import json
import zlib
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from device.anomaly.picture import Picture, deviation_overlay, reference_picture, wall_colours
from device.json_text import dumps
from device.pictures import encode_jpeg
from estimators.anomaly.deviation import DeviationMap
from estimators.anomaly.pair import PairFindings

STEP_MM = 0.05
_UNSEEN, _HIDDEN, _BEYOND = -32768, -32767, -32766
_MOST = 32000
_POINTS = 3000
_CELLS = (40, 72)
"""Rows and angles of the map that goes out as JSON."""


@dataclass(frozen=True)
class KeptMap:
    """The unrolled wall: rows from ``near`` to ``far`` (m) by angles from 9 o'clock over 12 to 9 again. ``deviation`` (Z, A) m,
    outwards positive, nan where nothing was measured; ``hidden`` behind something; ``wall`` what belongs to it."""

    near: float
    far: float
    deviation: NDArray[np.float32]
    hidden: NDArray[np.bool_]
    wall: NDArray[np.bool_]


@dataclass(frozen=True)
class Views:
    """``map`` as ``unpacked`` reads it; JPEGs of the left picture, without and with the deviations; ``cloud`` as the page draws
    it."""

    map: bytes
    reference: bytes
    overlay: bytes
    cloud: dict[str, Any]


def views(left: Picture, findings: PairFindings) -> Views:
    """Of a pair with its reference picture (H, W) or (H, W, 3)."""
    reference, step = reference_picture(left)
    overlay = deviation_overlay(reference, step, findings)
    return Views(packed(findings.map), encode_jpeg(reference), encode_jpeg(overlay), cloud(findings.map))


def packed(found: DeviationMap) -> bytes:
    """The map for the store."""
    steps = np.clip(np.nan_to_num(found.deviation) * (1000 / STEP_MM), -_MOST, _MOST)
    values = np.round(steps).astype("<i2")
    values[~np.isfinite(found.deviation)] = _UNSEEN
    values[found.hidden] = _HIDDEN
    values[~found.wall] = _BEYOND
    head = {"near_m": float(found.depth[0]), "far_m": float(found.depth[-1]), "shape": list(values.shape)}
    return zlib.compress(dumps(head).encode() + b"\n" + values.tobytes(), 6)


def unpacked(kept: bytes) -> KeptMap:
    """What ``packed`` gave."""
    head, _, data = zlib.decompress(kept).partition(b"\n")
    about = json.loads(head)
    values = np.frombuffer(data, "<i2").reshape(about["shape"])
    deviation = np.where(values > _BEYOND, values * np.float32(STEP_MM / 1000), np.float32(np.nan)).astype(np.float32)
    return KeptMap(about["near_m"], about["far_m"], deviation, values == _HIDDEN, values != _BEYOND)


def wall_png(kept: KeptMap) -> bytes:
    """The unrolled wall in colours: crown in the middle, 6 o'clock at both sides, near at the bottom; nothing is written on
    it."""
    _, data = cv2.imencode(".png", wall_colours(kept.deviation, kept.hidden, kept.wall))
    return data.tobytes()


def map_json(kept: KeptMap) -> dict[str, Any]:
    """The map with fewer cells, for programs: mean deviations in mm, null where less than half of a cell was measured."""
    rows, angles = _CELLS
    height, width = kept.deviation.shape
    known = np.isfinite(kept.deviation)
    row = np.arange(height) * rows // height
    column = np.arange(width) * angles // width
    cell = (row[:, None] * angles + column).ravel()
    count = np.bincount(cell, minlength=rows * angles)
    seen = np.bincount(cell, known.ravel(), rows * angles)
    total = np.bincount(cell, np.nan_to_num(kept.deviation).ravel().astype(np.float64), rows * angles)
    mean = np.where(2 * seen >= count, 1000 * total / np.maximum(seen, 1), np.nan).reshape(rows, angles)
    return {
        "near_m": round(kept.near, 3),
        "far_m": round(kept.far, 3),
        "first_clock": 9.0,
        "deviation_mm": [[None if np.isnan(value) else round(float(value), 1) for value in line] for line in mean],
    }


def cloud(found: DeviationMap) -> dict[str, Any]:
    """Points (m) of the wall with their deviations (mm), in the wall's own frame: x right, y down, z along the pipe."""
    row, column = np.nonzero(found.measured)
    chosen = np.linspace(0, len(row) - 1, min(_POINTS, len(row))).astype(int)
    spread = np.random.default_rng(0).permutation(len(row))[chosen] if len(row) else chosen
    row, column = row[spread], column[spread]
    deviation = found.deviation[row, column]
    radius = found.radius[row, column] + deviation
    theta, depth = found.theta[column], found.depth[row]
    points = np.column_stack([radius * np.cos(theta), radius * np.sin(theta), depth])
    return {
        "points": [[round(float(value), 3) for value in point] for point in points],
        "inlier": [1] * len(points),
        "deviation_mm": [round(float(value), 1) for value in 1000 * deviation],
        "cylinder": None,
    }
