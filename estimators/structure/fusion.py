"""Several scans of one object as one cloud with less noise (the paper leaves it for later, Sec. 7)."""

from __future__ import annotations

import numpy as np

from estimators.structure.types import Array

CELL = 0.004
"""Directions (rad) that are one: a little more than the step of a scanner."""
DEPTH = 0.03
"""What lies further behind the nearest point of a direction than this (m) is another surface, hidden from here."""


def fused(clouds: list[Array]) -> Array:
    """The clouds (N, 3), all in the frame of the latest sensor, as that sensor would have seen them without noise: one point
    for each direction, at the mean range of what lies in front there."""
    points = np.concatenate(clouds)
    if len(clouds) == 1 or not len(points):
        return points
    ranges = np.linalg.norm(points, axis=1)
    azimuth = np.floor(np.arctan2(points[:, 0], points[:, 2]) / CELL).astype(np.int64)
    elevation = np.floor(np.arcsin(np.clip(points[:, 1] / ranges, -1, 1)) / CELL).astype(np.int64)
    _, cell = np.unique(np.column_stack([azimuth, elevation]), axis=0, return_inverse=True)
    cell = cell.reshape(-1)
    front = np.full(cell.max() + 1, np.inf)
    np.minimum.at(front, cell, ranges)
    kept = ranges <= front[cell] + DEPTH
    count = np.bincount(cell[kept], minlength=len(front))
    return np.column_stack([np.bincount(cell[kept], points[kept, axis], len(front)) / count for axis in range(3)])
