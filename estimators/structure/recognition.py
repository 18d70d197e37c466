"""What class an object is: the nearest views of a data base (Sec. 3.5), fused over sightings by Bayes with a confusion
matrix (Sec. 3.6, 3.7), among the classes that the pipes leaving it allow (Sec. 3.8, Table 2)."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from estimators.structure.cloud import surface_of, thinned
from estimators.structure.cvfh import CvfhSettings, cvfh
from estimators.structure.types import CLASSES, Array, Mask


@dataclass(frozen=True)
class DescriptorSettings:
    """The object's cloud is thinned to ``cell`` (m); normals from ``neighbours`` points; ``cvfh`` as set for that density."""

    cell: float = 0.008
    neighbours: int = 16
    least_points: int = 25
    cvfh: CvfhSettings = field(
        default_factory=lambda: CvfhSettings(curvature=0.06, reach=0.03, angle=0.20, least_points=25, normal_radius=0.03)
    )


@dataclass(frozen=True)
class Views:
    """The data base: ``histograms`` (n, 308), each summing to 1 in each of its five blocks, and the class number of each
    (n,), and the direction (n, 3) in the object's own frame that it was seen from."""

    histograms: Array
    labels: NDArray[np.intp]
    directions: Array


def describe(cloud: Array, settings: DescriptorSettings | None = None) -> Array | None:
    """Normalised histograms (parts, 308) of an object's cloud (N, 3) as seen from the origin; None where it has too few
    points."""
    settings = settings or DescriptorSettings()
    points = thinned(cloud, settings.cell)
    if len(points) < settings.least_points:
        return None
    histograms = cvfh(surface_of(points, settings.neighbours), settings.cvfh)
    return histograms / len(points)


def nearest_class(histograms: Array, views: Views, allowed: Mask | None = None) -> tuple[int, Array]:
    """Number of the class whose view is nearest to any of the histograms, and the least distance (6,) to each class.

    Distance: the sum of absolute differences. ``allowed`` (6,) leaves the other classes out.
    """
    apart = np.abs(histograms[:, None, :] - views.histograms[None]).sum(axis=2).min(axis=0)
    least = np.array([apart[views.labels == k].min() if np.any(views.labels == k) else np.inf for k in range(len(CLASSES))])
    shown = least if allowed is None else np.where(allowed, least, np.inf)
    return int(np.argmin(shown)), least


def updated(belief: Array, seen: int, confusion: Array) -> Array:
    """Beliefs (6,) after an object was recognised as class ``seen``; ``confusion[actual, seen]`` is P(Z_C | X_i) of Sec.
    3.7."""
    posterior: Array = belief * confusion[:, seen]
    posterior /= posterior.sum()
    return posterior


# Table 2: which classes each disposition of pipes leaves. The text excludes sockets between two pipes in line, which is what
# sockets join: they stay.
_THREE = np.array([label in ("tee", "3-way valve") for label in CLASSES])
_SQUARE = np.array([label in ("elbow", "tee", "3-way valve") for label in CLASSES])
_IN_LINE = np.array([label != "elbow" for label in CLASSES])
CONFIGURATIONS: tuple[Mask, ...] = (_THREE, _SQUARE, _IN_LINE, np.ones(len(CLASSES), dtype=bool))
"""Configurations 1 to 4, the most restrictive first."""


def configuration(pipes: Array, angle: float = 0.35) -> int:
    """Which of Table 2's dispositions (0 to 3) the unit vectors (n, 3) of the pipes that leave an object are."""
    cosines = pipes @ pipes.T if len(pipes) else np.zeros((0, 0))
    above = cosines[np.triu_indices(len(pipes), 1)]
    in_line = bool(np.any(above < -np.cos(angle)))
    square = bool(np.any(np.abs(above) < np.sin(angle)))
    if in_line and square:
        return 0
    if square:
        return 1
    return 2 if in_line else 3


CONNECTED = 0.9
"""Probability that a port carries a pipe at all: an open end is rarer than a connected one."""
MISSED = 0.7
"""Probability that one sighting of an object does not map a pipe that leaves it."""
_STRAY = 0.01
"""Probability of a disposition that a class cannot have: a pipe of the map that is none."""
_PORTS = {"elbow": "square", "tee": "three", "3-way valve": "three"}


def ports_likelihood(pipes: Array, sightings: int, angle: float = 0.35) -> Array:
    """Probability (6,) that an object of each class, after so many sightings, shows just the pipes (n, 3) that leave it.

    Table 2 says what cannot be; this says how likely the rest is. A valve at the end of a pipe shows one pipe, a three-way
    valve that shows one has two ports open or unseen, which is rare after many sightings.
    """
    shown = CONNECTED * (1 - MISSED ** max(sightings, 1))
    hidden = 1 - shown
    straight = {0: hidden**2, 1: 2 * shown * hidden, 2: shown**2}
    three = {0: hidden**3, 1: 3 * shown * hidden**2, 3: shown**3}
    count, kind = min(len(pipes), 3), configuration(pipes, angle)
    square, in_line = kind == 1, kind == 2
    of = {
        "line": straight.get(count, 0.0) if count < 2 or in_line else 0.0,
        "square": straight.get(count, 0.0) if count < 2 or square else 0.0,
        "three": (shown**2 * hidden * (2 if square else 1 if in_line else 0)) if count == 2 else three[count],
    }
    return np.array([max(of[_PORTS.get(label, "line")], _STRAY * shown**count) for label in CLASSES])


def allowed_by(configurations: set[int]) -> Mask:
    """Classes that all the dispositions seen so far leave: two that exclude each other are three pipes, of which each showed
    two."""
    allowed: Mask = np.ones(len(CLASSES), dtype=bool)
    for number in configurations:
        allowed = allowed & CONFIGURATIONS[number]
    return allowed
