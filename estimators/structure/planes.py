"""The flat surfaces of the tank, found by growing regions and taken away (paper, Sec. 3.2, Algorithm 1)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from estimators.structure.cloud import Surface
from estimators.structure.types import Array, Mask


@dataclass(frozen=True)
class PlaneSettings:
    """``angle`` between normals of neighbours of one region and ``flat``, the mean curvature below which a region is a
    plane, are the paper's; ``seed``: curvature up to which a point's own neighbours join. A plane also spreads over
    ``spread`` (m, standard deviation) in its second direction: the side of a wide object does not."""

    angle: float = np.radians(30.0)
    flat: float = 0.025
    seed: float = 0.04
    spread: float = 0.12
    reach: int = 8
    least_points: int = 60


def find_planes(surface: Surface, settings: PlaneSettings | None = None) -> list[tuple[Array, float]]:
    """Flat regions of ``surface`` as (unit normal (3,), offset): points on one have normal @ point = offset.

    The regions are those of Algorithm 1: points of small curvature grow them, the others only border on them. Growing one seed
    after the other gives the connected components of the graph of such steps, which is how they are found here.
    """
    settings = settings or PlaneSettings()
    count = len(surface.points)
    near = surface.neighbours[:, 1 : 1 + settings.reach]
    seeds = surface.curvature < settings.seed
    turned = np.abs(np.einsum("nkj,nj->nk", surface.normals[near], surface.normals))
    smooth = turned > np.cos(settings.angle)
    rows, columns = np.nonzero(smooth & seeds[:, None] & seeds[near])
    graph = coo_array((np.ones(len(rows), dtype=np.int8), (rows, near[rows, columns])), shape=(count, count))
    regions, label = connected_components(graph, directed=False)
    for column in range(near.shape[1]):  # a point of large curvature belongs to the first seed beside it
        joins = ~seeds & smooth[:, column] & seeds[near[:, column]]
        label[joins] = label[near[joins, column]]
        seeds = seeds | joins
    sizes = np.bincount(label, minlength=regions)
    mean_curvature = np.bincount(label, surface.curvature, regions) / np.maximum(sizes, 1)
    planes = []
    for region in np.flatnonzero((mean_curvature < settings.flat) & (sizes >= settings.least_points)):
        points = surface.points[label == region]
        centre = points.mean(axis=0)
        values, vectors = np.linalg.eigh(np.cov(points.T))
        if values[1] > settings.spread**2:
            planes.append((vectors[:, 0], float(vectors[:, 0] @ centre)))
    return planes


def off_planes(points: Array, planes: list[tuple[Array, float]], margin: float) -> Mask:
    """Which points (N,) are further than ``margin`` from every plane."""
    off = np.ones(len(points), dtype=bool)
    for normal, offset in planes:
        off &= np.abs(points @ normal - offset) > margin
    return off
