"""Clouds: thinned to cells, with a normal and a curvature for each point."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from estimators.structure.types import Array


@dataclass(frozen=True)
class Surface:
    """``points`` (N, 3), ``normals`` (N, 3) towards the sensor, ``curvature`` (N,) of eq. 1, ``neighbours`` (N, k)."""

    points: Array
    normals: Array
    curvature: Array
    neighbours: NDArray[np.intp]


def thinned(points: Array, cell: float) -> Array:
    """The means (M, 3) of the points of each cubic cell of side ``cell``."""
    if not len(points):
        return points
    keys = np.floor(points / cell).astype(np.int64)
    keys -= keys.min(axis=0)
    spans = keys.max(axis=0) + 1
    flat = (keys[:, 0] * spans[1] + keys[:, 1]) * spans[2] + keys[:, 2]
    _, inverse, counts = np.unique(flat, return_inverse=True, return_counts=True)
    return np.column_stack([np.bincount(inverse, points[:, axis]) / counts for axis in range(3)])


def surface_of(points: Array, count: int, viewpoint: Array | None = None) -> Surface:
    """Normals and curvature (paper, eq. 1) from the ``count`` nearest points of each, itself included."""
    count = min(count, len(points))
    _, neighbours = cKDTree(points).query(points, k=count)
    neighbours = np.asarray(neighbours, dtype=np.intp).reshape(len(points), count)
    normals, curvature = _principal(points[neighbours])
    towards = (np.zeros(3) if viewpoint is None else viewpoint) - points
    normals *= np.where(np.einsum("ij,ij->i", normals, towards) < 0, -1.0, 1.0)[:, None]
    return Surface(points, normals, curvature, neighbours)


def _principal(patches: Array) -> tuple[Array, Array]:
    """Normals (N, 3) and eq. 1's ratio (N,) of patches (N, k, 3)."""
    centred = patches - patches.mean(axis=1, keepdims=True)
    scatter = np.matmul(np.swapaxes(centred, 1, 2), centred)
    values, vectors = np.linalg.eigh(scatter)
    total = values.sum(axis=1)
    curvature = np.where(total > 0, np.maximum(values[:, 0], 0.0) / np.where(total > 0, total, 1.0), 0.0)
    return vectors[:, :, 0].copy(), curvature
