"""The data base of views (paper, Sec. 3.1): twelve of each object, cast at its solids, with the descriptor of each."""

from __future__ import annotations

from functools import cache
from importlib import resources
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from drivers.virtual.chamber.objects import CLASSES, PORTS, WITH_HANDLE, solids_of
from drivers.virtual.chamber.solids import Cylinder, Solid, cast
from estimators.structure.mapper import Knowledge
from estimators.structure.objects import ObjectSettings
from estimators.structure.recognition import DescriptorSettings, Views, describe
from estimators.structure.types import PIPE_RADIUS

Array = NDArray[np.float64]

DISTANCE_M = 2.8
RAY_RAD = np.radians(40.0 / 220)
VIEWS = 12


def view_directions(count: int = VIEWS) -> Array:
    """Directions (count, 3) from which an object is looked at: spread evenly over the sphere by a spiral."""
    k = np.arange(count) + 0.5
    height = 1 - 2 * k / count
    turn = np.pi * (1 + 5**0.5) * k
    ring = np.sqrt(1 - height**2)
    return np.column_stack([ring * np.cos(turn), ring * np.sin(turn), height])


def looked_at(label: str, is_open: bool, direction: Array, roll: float = 0.0, distance: float = DISTANCE_M) -> Array:
    """The cloud (N, 3), in a sensor's frame, of one object alone seen from ``direction`` (3,)."""
    forward = -direction / np.linalg.norm(direction)
    right = np.cross(forward, np.eye(3)[int(np.argmin(np.abs(forward)))])
    right /= np.linalg.norm(right)
    down = np.cross(forward, right)
    right, down = np.cos(roll) * right + np.sin(roll) * down, np.cos(roll) * down - np.sin(roll) * right
    axes = np.column_stack([right, down, forward])
    steps = np.arange(-np.arctan(0.3 / distance), np.arctan(0.3 / distance), RAY_RAD)
    azimuth, elevation = np.meshgrid(steps, steps, indexing="ij")
    rays = np.stack([np.sin(azimuth) * np.cos(elevation), np.sin(elevation), np.cos(azimuth) * np.cos(elevation)], axis=-1)
    rays = rays.reshape(-1, 3)
    origin = np.broadcast_to(-distance * forward, rays.shape)
    ranges, _ = cast(_with_stubs(label, is_open), origin, rays @ axes.T)
    hit = np.isfinite(ranges)
    return rays[hit] * ranges[hit, None]


def _with_stubs(label: str, is_open: bool) -> list[Solid]:
    """The object with its pipes as far as the base of a crop reaches: so it is cut out of a scan."""
    reach = ObjectSettings().base_length
    ports = [Cylinder(np.zeros(3), np.array(port, float) * reach, PIPE_RADIUS) for port in PORTS[label]]
    return [*solids_of(label, is_open), *ports]


def states(label: str) -> tuple[bool, ...]:
    """Open and closed, where there is a handle to tell."""
    return (True, False) if label in WITH_HANDLE else (True,)


def views(settings: DescriptorSettings | None = None) -> Views:
    """The data base, computed: twelve views of each object, of valves open and closed."""
    histograms, labels, directions = [], [], []
    for number, label in enumerate(CLASSES):
        for is_open in states(label):
            for direction in view_directions():
                found = describe(looked_at(label, is_open, direction), settings)
                if found is not None:
                    histograms.append(found)
                    labels += [number] * len(found)
                    directions += [direction] * len(found)
    return Views(np.concatenate(histograms), np.array(labels), np.array(directions))


def save_knowledge(knowledge: Knowledge, path: Path) -> None:
    """As a file for ``shipped_knowledge``."""
    np.savez_compressed(
        path,
        histograms=knowledge.views.histograms.astype(np.float32),
        labels=knowledge.views.labels.astype(np.int8),
        directions=knowledge.views.directions,
        confusion=knowledge.confusion,
        fused_confusion=knowledge.fused_confusion,
        handles=knowledge.handles,
    )


@cache
def shipped_knowledge() -> Knowledge:
    """What comes with the box; ``python -m tests.bench.structure_fit --save FILE`` makes it anew."""
    with resources.files("device").joinpath("data/structure/knowledge.npz").open("rb") as file, np.load(file) as saved:
        base = Views(saved["histograms"].astype(float), saved["labels"].astype(np.intp), saved["directions"])
        return Knowledge(base, saved["confusion"], saved["fused_confusion"], saved["handles"])
