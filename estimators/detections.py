"""What a detector says of one picture: heatmaps to components, and each component as one detection."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

CLASSES = ("connection", "deposit", "displaced joint", "fracture", "roots")
"""The classes of the paper's Table II. A class file may add others: a class is a name everywhere."""
OUTLINE_POINTS = 32


@dataclass(frozen=True)
class Detection:
    """One component of one class's heatmap. ``u``, ``v`` its centroid (px), ``score`` 0..1 its peak, ``area`` in px.

    ``outline`` are points (u, v) on its border for its extent on the wall, empty where only the centroid is known.
    """

    u: float
    v: float
    label: str
    score: float = 1.0
    area: float = 0.0
    outline: tuple[tuple[float, float], ...] = ()


def from_heatmaps(
    heatmaps: Mapping[str, NDArray[np.float32]],
    thresholds: Mapping[str, float],
    size: tuple[int, int],
    least_area: float = 0.0,
) -> list[Detection]:
    """Detections of one picture: the connected components of A'_k > tau (CCTV paper, "Detection Extraction").

    ``heatmaps`` per class (h, w), each an anomaly map A_k >= 0 (eq. 8), resized bilinearly to ``size`` (width, height) of the
    picture; ``thresholds`` per class, and a class without one is an error. ``least_area`` (px) drops specks. The score is
    1 - exp(-peak), the probability that eq. 9 gives a map of that value. Centroids are those of the component's pixels, as in
    the paper. Strongest first.
    """
    found: list[Detection] = []
    width, height = size
    for label, heatmap in heatmaps.items():
        if label not in thresholds:
            raise ValueError(f"There is no threshold for the class {label!r}.")
        if heatmap.ndim != 2:
            raise ValueError(f"The heatmap of {label!r} has {heatmap.ndim} dimensions; it must have two.")
        full = cv2.resize(np.asarray(heatmap, dtype=np.float32), (width, height), interpolation=cv2.INTER_LINEAR)
        above = np.asarray(full > thresholds[label], dtype=np.uint8)
        count, labels, stats, centroids = cv2.connectedComponentsWithStats(above, connectivity=8)
        for k in range(1, count):
            left, top, w, h, area = (int(value) for value in stats[k])
            if area < least_area:
                continue
            box = (slice(top, top + h), slice(left, left + w))
            inside = labels[box] == k
            peak = float(full[box][inside].max())
            outline = _outline(np.asarray(inside, dtype=np.uint8), left, top)
            u, v = (float(value) for value in centroids[k])
            found.append(Detection(u, v, label, 1.0 - float(np.exp(-max(peak, 0.0))), float(area), outline))
    return sorted(found, key=lambda detection: -detection.score)


def _outline(mask: NDArray[np.uint8], left: int, top: int) -> tuple[tuple[float, float], ...]:
    """At most ``OUTLINE_POINTS`` points round a component, evenly along its border."""
    contours, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    border = max(contours, key=len)[:, 0, :]
    chosen = np.unique(np.linspace(0, len(border) - 1, OUTLINE_POINTS).round().astype(int))
    return tuple((float(u) + left, float(v) + top) for u, v in border[chosen])
