"""The Clustered Viewpoint Feature Histogram (Aldoma et al. 2011; paper, Sec. 3.5), 308 bins, as PCL's CVFHEstimation has it.

Smooth parts of the surface are found; for each, the whole cloud is described relative to the part's centroid and normal: three
angles (45 bins each), the distance (45) and the angle between normals and the view (128). The sensor is at the origin.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from estimators.structure.cloud import Surface
from estimators.structure.types import Array

BINS = 308
_ANGLE_BINS = 45
_VIEW_BINS = 128


@dataclass(frozen=True)
class CvfhSettings:
    """PCL's: ``curvature`` above which a point is on no smooth part; ``reach`` (m) and ``angle`` between neighbours of one
    part, of at least ``least_points``; ``normal_radius`` (m) of the normals that parts are grown on."""

    curvature: float = 0.03
    reach: float = 0.015
    angle: float = 0.125
    least_points: int = 50
    normal_radius: float = 0.015


def cvfh(surface: Surface, settings: CvfhSettings | None = None) -> Array:
    """Histograms (parts, 308) of counts, one for each smooth part, or one for the whole cloud where there is none."""
    settings = settings or CvfhSettings()
    parts = _smooth_parts(surface, settings)
    if not parts:
        return vfh(surface, surface.points.mean(axis=0), surface.normals.mean(axis=0))[None]
    return np.array([vfh(surface, centroid, normal) for centroid, normal in parts])


def vfh(surface: Surface, centroid: Array, normal: Array) -> Array:
    """One histogram (308,) relative to ``centroid`` (3,) and ``normal`` (3,)."""
    points, normals = surface.points, surface.normals
    angle, first, second, distance = _pair_features(centroid, normal, points, normals)
    furthest = float(np.linalg.norm(points - centroid, axis=1).max())
    told = np.isfinite(angle)
    shares = [
        (angle[told] + np.pi) / (2 * np.pi),
        # PCL bins all three in the same way, though these two are cosines
        (first[told] + np.pi) / (2 * np.pi),
        (second[told] + np.pi) / (2 * np.pi),
        distance[told] / max(furthest, 1e-12),
    ]
    view = -centroid / max(float(np.linalg.norm(centroid)), 1e-12)
    return np.concatenate([*(_binned(share, _ANGLE_BINS) for share in shares), _binned((normals @ view + 1) / 2, _VIEW_BINS)])


def _binned(shares: Array, bins: int) -> Array:
    slot = np.clip(np.floor(shares * bins).astype(int), 0, bins - 1)
    return np.bincount(slot, minlength=bins).astype(float)


def _pair_features(centroid: Array, normal: Array, points: Array, normals: Array) -> tuple[Array, Array, Array, Array]:
    """PCL's computePairFeatures of the centroid with each point: angle, two cosines, distance (N,); nan where undefined."""
    line = points - centroid
    distance = np.linalg.norm(line, axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        cosine1 = line @ normal / distance
        cosine2 = np.einsum("ij,ij->i", line, normals) / distance
        # the point whose normal makes the smaller angle with the line is the origin of the frame
        swapped = np.arccos(np.abs(cosine1)) > np.arccos(np.abs(cosine2))
        one = np.where(swapped[:, None], normals, normal)
        other = np.where(swapped[:, None], normal, normals)
        line = np.where(swapped[:, None], -line, line)
        third = np.where(swapped, -cosine2, cosine1)
        v = np.cross(line, one)
        length = np.linalg.norm(v, axis=1)
        v = v / length[:, None]
        w = np.cross(one, v)
        cosine = np.einsum("ij,ij->i", v, other)
        angle = np.arctan2(np.einsum("ij,ij->i", w, other), np.einsum("ij,ij->i", one, other))
    angle = np.where((distance > 0) & (length > 0), angle, np.nan)
    return angle, cosine, third, distance


def _smooth_parts(surface: Surface, settings: CvfhSettings) -> list[tuple[Array, Array]]:
    """Centroid and unit mean normal of each smooth part."""
    points = surface.points[surface.curvature <= settings.curvature]
    if len(points) < settings.least_points:
        return []
    tree = cKDTree(points)
    pairs = tree.query_pairs(max(settings.normal_radius, settings.reach), output_type="ndarray")
    distance = np.linalg.norm(points[pairs[:, 0]] - points[pairs[:, 1]], axis=1)
    normals = _normals_from_pairs(points, pairs[distance <= settings.normal_radius])
    pairs = pairs[distance <= settings.reach]
    smooth = np.einsum("ij,ij->i", normals[pairs[:, 0]], normals[pairs[:, 1]]) > np.cos(settings.angle)
    pairs = pairs[smooth]
    graph = coo_array((np.ones(len(pairs), dtype=np.int8), (pairs[:, 0], pairs[:, 1])), shape=(len(points), len(points)))
    _, label = connected_components(graph, directed=False)
    sizes = np.bincount(label)
    parts = []
    for part in np.flatnonzero(sizes >= settings.least_points):
        inside = label == part
        normal = normals[inside].mean(axis=0)
        parts.append((points[inside].mean(axis=0), normal / max(float(np.linalg.norm(normal)), 1e-12)))
    return parts


def _normals_from_pairs(points: Array, pairs: np.ndarray) -> Array:
    """Normals (N, 3) towards the origin from all neighbours within the radius that made ``pairs`` (P, 2)."""
    count = len(points)
    i = np.concatenate([pairs[:, 0], pairs[:, 1], np.arange(count)])
    j = np.concatenate([pairs[:, 1], pairs[:, 0], np.arange(count)])
    number = np.bincount(i, minlength=count)
    local = points[j] - points[i]
    mean = np.stack([np.bincount(i, local[:, a], count) for a in range(3)], axis=1) / number[:, None]
    scatter = np.empty((count, 3, 3))
    for a in range(3):
        for b in range(a, 3):
            value = np.bincount(i, local[:, a] * local[:, b], count) / number - mean[:, a] * mean[:, b]
            scatter[:, a, b] = scatter[:, b, a] = value
    normals: Array = np.linalg.eigh(scatter)[1][:, :, 0]
    return normals * np.where(np.einsum("ij,ij->i", normals, points) > 0, -1.0, 1.0)[:, None]
