"""Other structures than the paper's, drawn from it: turned, stretched, mirrored, with other objects where the pipes allow
them."""

from __future__ import annotations

import numpy as np

from drivers.virtual.chamber.objects import WITH_HANDLE
from drivers.virtual.chamber.solids import Array
from drivers.virtual.chamber.structure import Description, ObjectLine, PipeLine, Structure, Vector, load_structure, structure_of

_BRANCHED = ("tee", "3-way valve")
_STRAIGHT = ("ball valve", "butterfly valve", "socket")


def varied(seed: int) -> Structure:
    """One of many structures; the same for the same ``seed``."""
    rng = np.random.default_rng([seed, 5])
    base = load_structure().description
    angle = rng.uniform(0, 2 * np.pi)
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    if rng.random() < 0.5:
        turn = turn @ np.diag([1.0, -1.0, 1.0])
    stretch = np.array([*rng.uniform(0.97, 1.15, 2), rng.uniform(0.97, 1.05)])
    foot = np.array([0.0, 0.0, base.tank.depth_m - 0.1])

    def moved(point: Vector) -> Vector:
        return _vector(turn @ ((np.array(point) - foot) * stretch) + foot)

    pipes = tuple(
        PipeLine.model_validate({"from": moved(p.start), "to": moved(p.end), "radius_m": p.radius_m}) for p in base.pipes
    )
    objects = tuple(_redrawn(thing, moved(thing.position), turn, rng) for thing in base.objects)
    return structure_of(
        Description(
            name=f"variation {seed}",
            pipes=pipes,
            objects=objects,
            tank=base.tank,
            path=base.path,
            scanner=base.scanner,
            navigation=base.navigation,
        )
    )


def _redrawn(thing: ObjectLine, position: Vector, turn: Array, rng: np.random.Generator) -> ObjectLine:
    label: str = thing.label
    if label in _BRANCHED:
        label = _BRANCHED[int(rng.integers(len(_BRANCHED)))]
    elif label in _STRAIGHT:
        label = _STRAIGHT[int(rng.integers(len(_STRAIGHT)))]
    axis = np.array(thing.axis)
    branch = None if thing.branch is None else np.array(thing.branch)
    handle: Array | None = None
    if label in WITH_HANDLE:
        side = np.cross(axis, branch) if branch is not None else _across(axis, rng)
        handle = turn @ (side * rng.choice([-1.0, 1.0]))
    return ObjectLine.model_validate(
        {
            "class": label,
            "position": position,
            "axis": _vector(turn @ axis),
            "branch": None if branch is None else _vector(turn @ branch),
            "handle": None if handle is None else _vector(handle),
            "open": bool(rng.integers(2)),
        }
    )


def _across(axis: Array, rng: np.random.Generator) -> Array:
    """Across a pipe: up or outwards where it lies, anywhere level where it stands."""
    if abs(axis[2]) > 0.5:
        return np.asarray(np.eye(3)[int(rng.integers(2))])
    return np.array([0.0, 0.0, 1.0]) if rng.random() < 0.7 else np.cross(axis, [0.0, 0.0, 1.0])


def _vector(values: Array) -> Vector:
    return float(values[0]), float(values[1]), float(values[2])
