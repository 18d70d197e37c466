"""What a detector says of one picture: heatmaps to components, and each component as one detection."""

from __future__ import annotations

from dataclasses import dataclass

CLASSES = ("connection", "deposit", "displaced joint", "fracture", "roots")
"""The classes of the paper's Table II. A class file may add others: a class is a name everywhere."""


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
