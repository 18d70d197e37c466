"""A scan taken apart: motion undone, flat surfaces removed, pipes found, objects cut out (paper, Sec. 3 and Fig. 1)."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from estimators.structure.cloud import surface_of, thinned
from estimators.structure.objects import ObjectSettings, find_objects
from estimators.structure.pipes import PipeSettings, find_pipes
from estimators.structure.planes import PlaneSettings, find_planes, off_planes
from estimators.structure.types import Array, Parts


@dataclass(frozen=True)
class ApartSettings:
    """``coarse`` cells (m) are fine enough for the tank, ``fine`` ones for pipes; ``margin``: what is so near a plane is on
    it."""

    coarse: float = 0.03
    fine: float = 0.008
    neighbours: int = 24
    margin: float = 0.028
    planes: PlaneSettings = field(default_factory=PlaneSettings)
    pipes: PipeSettings = field(default_factory=PipeSettings)
    objects: ObjectSettings = field(default_factory=ObjectSettings)


def for_radius(radius: float) -> ApartSettings:
    """The settings for pipes of another known radius (m)."""
    return ApartSettings(pipes=PipeSettings(radius=radius), objects=ObjectSettings(radius=radius))


def undistorted(points: Array, late: Array | None, velocity: Array, rate: Array) -> Array:
    """Points (N, 3), each seen ``late`` (N,) seconds after the scan's time, as they would look from where the sensor was then.

    ``velocity`` (3,) and turning ``rate`` (3,) of the sensor along and about its own axes: to first order in both.
    """
    if late is None:
        return points
    return points + late[:, None] * (velocity + np.cross(rate, points))


def take_apart(points: Array, rng: np.random.Generator, settings: ApartSettings | None = None) -> Parts:
    """The pipes and objects of one scan (N, 3) in the sensor's frame."""
    settings = settings or ApartSettings()
    if len(points) < settings.neighbours:
        return Parts((), ())
    coarse = thinned(points, settings.coarse)
    planes = find_planes(surface_of(coarse, 12), settings.planes) if len(coarse) > 50 else []
    structure = points[off_planes(points, planes, settings.margin)]
    fine = thinned(structure, settings.fine)
    if len(fine) < settings.neighbours:
        return Parts((), ())
    surface = surface_of(fine, settings.neighbours)
    segments, on_pipes = find_pipes(surface.points, surface.normals, rng, settings.pipes)
    sightings = find_objects(structure, surface.points, on_pipes, segments, settings.objects)
    return Parts(tuple(segments), tuple(sightings))
