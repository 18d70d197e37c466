"""From a depth picture to a thin cloud of oriented points.

A stereo camera measures disparity, so noise is even in inverse depth q = 1/Z, and a plane is linear there:
n . P = d with P = (x, y, 1) Z gives q = (n . (x, y, 1)) / d. Normals therefore come from a linear fit of q over
the rays (x, y) in a small window, at the same cost and quality at every range, without any search tree.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from estimators.pinhole import Intrinsics, rays

CELLS_ACROSS = 212
"""Columns of the thinned grid: about 4 x 4 pixels a cell at 848 x 480, whatever the resolution."""
MIN_RANGE_M, MAX_RANGE_M = 0.1, 2.5
"""The crop along z: eq. 5 tightened to 2.5 m as in step 1 of Algorithm 1; nearer than 0.1 m no camera of ours measures."""
MAX_LATERAL_M = 1.0
"""The crop of eqs. 3 and 4."""
_MIN_CELL_FILL = 0.2
_WINDOW = 2
_MIN_NEIGHBOURS = 7
_MAX_STEP = 0.35
"""Largest change of q (1/m) to a neighbour that may lie on the same surface: 2 cells along the wall of a 150 mm pipe."""


@dataclass(frozen=True)
class OrientedPoints:
    """Points (N, 3) in metres, unit normals (N, 3) towards the camera, and the rms of the local fit in 1/m (N,).

    ``cells`` (N, 2) are (row, column) in the thinned grid of ``shape``; ``valid_share`` is the share of pixels with a depth
    in the crop.
    """

    points: NDArray[np.float32]
    normals: NDArray[np.float32]
    roughness: NDArray[np.float32]
    cells: NDArray[np.int32]
    shape: tuple[int, int]
    valid_share: float

    def __len__(self) -> int:
        return len(self.points)

    def take(self, index: NDArray[np.intp] | NDArray[np.bool_]) -> OrientedPoints:
        """The points of ``index``, everything else alike."""
        return OrientedPoints(
            self.points[index], self.normals[index], self.roughness[index], self.cells[index], self.shape, self.valid_share
        )


def oriented_points(depth: NDArray[np.uint16], intrinsics: Intrinsics, depth_unit_m: float) -> OrientedPoints:
    """Crop (eqs. 3 to 5), thin to cells and fit a normal to each: see the module's text.

    ``depth`` (H, W) uint16 in ``depth_unit_m``. Cells whose depth or whose neighbours disagree (speckle, edges) are left out.
    """
    if depth.shape != (intrinsics.height, intrinsics.width):
        raise ValueError(f"depth picture is {depth.shape}, intrinsics say {(intrinsics.height, intrinsics.width)}")
    step = max(1, round(intrinsics.width / CELLS_ACROSS))
    rows, cols = intrinsics.height // step, intrinsics.width // step
    grid_x, grid_y, limit_far = _grid(intrinsics, step)
    cropped = depth[: rows * step, : cols * step]
    near, far = MIN_RANGE_M / depth_unit_m, limit_far / depth_unit_m
    valid = (cropped > near) & (cropped <= far)
    inverse = np.zeros(cropped.shape, np.float32)
    np.divide(np.float32(1.0 / depth_unit_m), cropped, out=inverse, where=valid)

    fill = cv2.resize(valid.astype(np.float32), (cols, rows), interpolation=cv2.INTER_AREA)
    mean = cv2.resize(inverse, (cols, rows), interpolation=cv2.INTER_AREA)
    square = cv2.resize(inverse * inverse, (cols, rows), interpolation=cv2.INTER_AREA)
    full = fill >= _MIN_CELL_FILL
    share = np.where(full, fill, 1.0)
    q = mean / share
    spread = np.sqrt(np.maximum(square / share - q * q, 0.0))
    full &= spread < 0.04 + 0.04 * q  # steeper than any wall within one cell: two surfaces mixed, or speckle
    q = np.where(full, q, 0.0)

    a, b, level, rms, count = _local_planes(np.asarray(q, np.float32), full, grid_x, grid_y)
    keep = full & (count >= _MIN_NEIGHBOURS) & (level > 0)
    cells = np.argwhere(keep).astype(np.int32)
    x, y, a, b, level, rms = (array[keep] for array in (grid_x, grid_y, a, b, level, rms))
    depth_m = 1.0 / level
    points = np.stack([x * depth_m, y * depth_m, depth_m], axis=1)
    normals = np.stack([a, b, level - a * x - b * y], axis=1)
    normals /= -np.linalg.norm(normals, axis=1, keepdims=True)  # (a, b, c) . P = 1 looks away from the camera: turn it
    return OrientedPoints(
        points.astype(np.float32), normals.astype(np.float32), rms.astype(np.float32), cells, (rows, cols), float(valid.mean())
    )


@lru_cache(maxsize=16)
def _grid(intrinsics: Intrinsics, step: int) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
    """Rays at the cell centres, and per pixel the depth at which the crop ends."""
    rows, cols = intrinsics.height // step, intrinsics.width // step
    full = rays(intrinsics)[: rows * step, : cols * step]
    centre = cv2.resize(full, (cols, rows), interpolation=cv2.INTER_AREA)
    lateral = np.abs(full).max(axis=2)
    limit = np.minimum(MAX_RANGE_M, MAX_LATERAL_M / np.maximum(lateral, 1e-6)).astype(np.float32)
    return np.ascontiguousarray(centre[..., 0]), np.ascontiguousarray(centre[..., 1]), limit


def _local_planes(
    q: NDArray[np.float32], full: NDArray[np.bool_], grid_x: NDArray[np.float32], grid_y: NDArray[np.float32]
) -> tuple[NDArray[np.float32], ...]:
    """Fit q = level + a dx + b dy in the window around each cell, over the neighbours that are within reach of its value."""
    rows, cols = q.shape
    pad = _WINDOW
    q_pad, full_pad = np.pad(q, pad), np.pad(full, pad)
    x_pad, y_pad = np.pad(grid_x, pad, mode="edge"), np.pad(grid_y, pad, mode="edge")
    sums = np.zeros((10, rows, cols), np.float32)  # n x y xx xy yy q xq yq qq, all relative to the centre cell
    for dr in range(2 * pad + 1):
        for dc in range(2 * pad + 1):
            window = slice(dr, dr + rows), slice(dc, dc + cols)
            dq = q_pad[window] - q
            weight = (full_pad[window] & full & (np.abs(dq) < _MAX_STEP)).astype(np.float32)
            dx, dy, dq = (x_pad[window] - grid_x) * weight, (y_pad[window] - grid_y) * weight, dq * weight
            for k, term in enumerate((weight, dx, dy, dx * dx, dx * dy, dy * dy, dq, dx * dq, dy * dq, dq * dq)):
                sums[k] += term
    n, sx, sy, sxx, sxy, syy, sq, sxq, syq, sqq = sums
    inv = 1.0 / np.maximum(n, 1.0)
    mx, my, mq = sx * inv, sy * inv, sq * inv
    cxx, cxy, cyy = sxx * inv - mx * mx, sxy * inv - mx * my, syy * inv - my * my
    cxq, cyq, cqq = sxq * inv - mx * mq, syq * inv - my * mq, sqq * inv - mq * mq
    det = cxx * cyy - cxy * cxy
    well_posed = det > 0.02 * (cxx + cyy) ** 2  # neighbours in one line give no normal
    safe = np.where(well_posed, det, 1.0)
    a, b = (cyy * cxq - cxy * cyq) / safe, (cxx * cyq - cxy * cxq) / safe
    rms = np.sqrt(np.maximum(cqq - a * cxq - b * cyq, 0.0))
    level = q + mq - a * mx - b * my
    return tuple(np.asarray(array, np.float32) for array in (a, b, level, rms, np.where(well_posed, n, 0.0)))
