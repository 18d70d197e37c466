"""Point clouds for the operator's eye: a few thousand points with the fitted cylinder."""

from __future__ import annotations

from typing import Any

from drivers.depth.base import DepthFrame
from estimators.frame import FrameEstimate, sample_cloud

MAX_POINTS = 3000
EMPTY: dict[str, Any] = {"points": [], "inlier": [], "cylinder": None}


def cloud_json(frame: DepthFrame, estimate: FrameEstimate) -> dict[str, Any]:
    """{"points": [[x, y, z]] in metres to the millimetre, "inlier": [0 or 1], "cylinder": {...} or None}.

    The cylinder's "from" and "to" are metres along its axis, counted from its point.
    """
    fit = estimate.fit
    points, on_wall = sample_cloud(frame.depth, frame.intrinsics, frame.depth_unit_m, fit, MAX_POINTS)
    cylinder = None
    if fit is not None:
        cylinder = {
            "axis": [round(float(value), 5) for value in fit.axis],
            "point": [round(float(value), 4) for value in fit.point],
            "radius": round(float(fit.radius), 5),
            "from": round(-0.5 * fit.length, 3),
            "to": round(0.5 * fit.length, 3),
        }
    return {
        "points": [[round(float(value), 3) for value in point] for point in points],
        "inlier": [int(value) for value in on_wall],
        "cylinder": cylinder,
    }
