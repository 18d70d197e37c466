"""The measured points of every depth recording as one PLY cloud, in the pipe's frame: z along the pipe, x right, y down."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from device.errors import Invalid
from device.export.base import Options
from device.inspections.model import Cloud, Inspection
from estimators.cylinder.geometry import orthonormal_basis

_ON_WALL, _OFF_WALL = (90, 160, 110, 255), (190, 90, 60, 255)


def ply(inspection: Inspection, options: Options) -> bytes:
    """The file: metres, each recording at its station, points off the fitted wall in another colour. Raises Invalid without
    points."""
    from trimesh import PointCloud  # here, since it takes a while

    found = [points_in_pipe(cloud) for cloud in inspection.clouds if len(cloud.points)]
    if not found:
        raise Invalid("There is no point cloud in this inspection: measure a diameter first.")
    points = np.concatenate(found)
    on_wall = np.concatenate([np.asarray(cloud.on_wall, bool) for cloud in inspection.clouds if len(cloud.points)])
    colours = np.where(on_wall[:, None], np.array(_ON_WALL, np.uint8), np.array(_OFF_WALL, np.uint8))
    data: bytes = PointCloud(points, colors=colours).export(file_type="ply")
    return data


def points_in_pipe(cloud: Cloud) -> NDArray[np.float64]:
    """The points (N, 3) with z along the fitted axis, from the station that the camera stood at."""
    points = np.asarray(cloud.points, np.float64).reshape(-1, 3)
    if cloud.axis is None or cloud.point is None:
        turned = points
    else:
        axis = np.asarray(cloud.axis, np.float64)
        frame = np.column_stack([orthonormal_basis(axis), axis])
        foot = np.asarray(cloud.point, np.float64)
        turned = (points - (foot - (foot @ axis) * axis)) @ frame
    return np.asarray(turned + np.array([0.0, 0.0, cloud.station or 0.0]))
