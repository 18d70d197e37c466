"""The structure file: pipes, objects, tank, path and sensors of a virtual chamber, as JSON; and the true map in it.

World frame: x north, y east, z down from the water surface (NED), metres. The file is described in the README.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from drivers.base import RecordingBroken
from drivers.virtual.chamber.objects import PORTS, WITH_HANDLE
from drivers.virtual.chamber.solids import Array

Vector = tuple[float, float, float]
Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
Angle = Annotated[float, Field(gt=0, le=170)]

ON_AXIS_M = 0.03
"""An object further from a pipe's axis is not on that pipe."""
AT_END_M = 0.15
"""A pipe that ends nearer than this to an object on its axis ends in it."""
DEFAULT_PIPE_RADIUS_M = 0.0315


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, populate_by_name=True, allow_inf_nan=False)


class PipeLine(_Strict):
    """One piece of pipe."""

    start: Vector = Field(alias="from")
    end: Vector = Field(alias="to")
    radius_m: Annotated[float, Field(ge=0.01, le=0.064)] = DEFAULT_PIPE_RADIUS_M


class ObjectLine(_Strict):
    """One object."""

    label: Literal["ball valve", "elbow", "tee", "socket", "butterfly valve", "3-way valve"] = Field(alias="class")
    position: Vector
    axis: Vector
    branch: Vector | None = None
    handle: Vector | None = None
    open: bool = True


class Tank(_Strict):
    """A tank with a flat floor, upright walls, and slopes along the two walls at the ends of x."""

    size_m: tuple[Positive, Positive] = (12.0, 12.0)
    depth_m: Positive = 5.0
    slope_width_m: NotNegative = 2.0
    slope_height_m: NotNegative = 1.5


class Path_(_Strict):
    """Around ``centre``, always facing it; or through ``waypoints`` of (x, y, z)."""

    centre: tuple[float, float] = (0.0, 0.0)
    radius_m: tuple[Positive, Positive] = (3.0, 3.8)
    depth_m: tuple[float, float] = (3.3, 4.2)
    turns: float = 2.0
    waypoints: tuple[Vector, ...] | None = Field(default=None, min_length=4)
    duration_s: Positive = 490.0
    sway_deg: NotNegative = 1.5


class Scanner(_Strict):
    """A scanner that sweeps columns from left to right in ``sweep_s``, mounted with its view ``tilt_deg`` down."""

    rate_hz: Positive = 0.5
    sweep_s: NotNegative = 0.3
    columns: Annotated[int, Field(ge=16, le=2000)] = 220
    rows: Annotated[int, Field(ge=16, le=2000)] = 180
    field_deg: tuple[Angle, Angle] = (40.0, 33.0)
    range_m: tuple[NotNegative, Positive] = (0.5, 4.6)
    noise_m: NotNegative = 0.005
    dropout: Annotated[float, Field(ge=0, lt=1)] = 0.02
    tilt_deg: float = 10.0

    @model_validator(mode="after")
    def _near_before_far(self) -> Scanner:
        if self.range_m[0] >= self.range_m[1]:
            raise ValueError("range_m: the nearer range comes first")
        return self


class Navigation(_Strict):
    """Rates and noise (one sigma) of the navigation sensors; outages of the DVL as (from_s, for_s)."""

    dvl_hz: Positive = 5.0
    dvl_noise_m_s: NotNegative = 0.01
    dvl_outages_s: tuple[tuple[NotNegative, Positive], ...] = ((90.0, 20.0), (250.0, 20.0), (380.0, 12.0))
    pressure_hz: Positive = 8.0
    pressure_noise_m: NotNegative = 0.02
    ahrs_hz: Positive = 20.0
    ahrs_noise_deg: NotNegative = 0.3
    ahrs_rate_noise_deg_s: NotNegative = 0.1


class Description(_Strict):
    """The whole file."""

    name: str = "structure"
    pipes: tuple[PipeLine, ...] = Field(min_length=1)
    objects: tuple[ObjectLine, ...] = ()
    tank: Tank = Tank()
    path: Path_ = Path_()
    scanner: Scanner = Scanner()
    navigation: Navigation = Navigation()


@dataclass(frozen=True)
class Pipe:
    """A straight run: valves and sockets sit on it, other pipes leave from it. Ends (3,) in the world."""

    start: Array
    end: Array
    radius: float


@dataclass(frozen=True)
class Object:
    """``rotation`` (3, 3): its own frame in the world, see ``objects``. ``ports``: directions (n, 3) in the world."""

    label: str
    position: Array
    rotation: Array
    is_open: bool | None

    @property
    def ports(self) -> Array:
        """Where pipes may leave, (n, 3) in the world."""
        return np.array(PORTS[self.label]) @ self.rotation.T

    @property
    def handle(self) -> Array | None:
        """Direction of the stem, None without one."""
        return self.rotation[:, 2] if self.label in WITH_HANDLE else None


@dataclass(frozen=True)
class Edge:
    """Object ``object`` sits on pipe ``pipe``: at one of its ends, or the pipe goes on beyond it ("through")."""

    pipe: int
    object: int
    kind: str


@dataclass(frozen=True)
class Structure:
    """The true map. ``runs``: pipes, those in line across an object being one; ``edges`` from ``runs`` to ``objects``."""

    description: Description
    runs: tuple[Pipe, ...]
    objects: tuple[Object, ...]
    edges: tuple[Edge, ...]


PAPER, SMALL = "paper.json", "small.json"
"""Structures that are shipped: the paper's, and one that is mapped within seconds."""


def load_structure(path: Path | str | None = None) -> Structure:
    """The structure of a file, or one of those that are shipped. Raises RecordingBroken with one sentence."""
    try:
        if path is None or path in (PAPER, SMALL):
            name = PAPER if path is None else str(path)
            text = resources.files("drivers.virtual.chamber").joinpath(name).read_text(encoding="utf-8")
        else:
            text = Path(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise RecordingBroken(f"The structure file {path} cannot be read: {error}.") from error
    try:
        return structure_of(Description.model_validate(json.loads(text)))
    except json.JSONDecodeError as error:
        raise RecordingBroken(f"The structure file {path} is no JSON: {error}.") from error
    except ValidationError as error:
        raise RecordingBroken(f"The structure file {path} cannot be used: {_first(error)}.") from error
    except ValueError as error:
        raise RecordingBroken(f"The structure file {path} cannot be used: {error}.") from error


def structure_of(description: Description) -> Structure:
    """Raises ValueError for what cannot be built."""
    pieces = [Pipe(np.array(p.start), np.array(p.end), p.radius_m) for p in description.pipes]
    for number, piece in enumerate(pieces):
        if np.linalg.norm(piece.end - piece.start) < 0.05:
            raise ValueError(f"pipe {number + 1} is shorter than 0.05 m")
    objects = tuple(_object(number, line) for number, line in enumerate(description.objects))
    runs = _merged(pieces, objects)
    edges = [
        Edge(i, j, kind)
        for i, run in enumerate(runs)
        for j, thing in enumerate(objects)
        if (kind := _where(run, thing.position)) is not None
    ]
    for number in range(len(objects)):
        if not any(edge.object == number for edge in edges):
            raise ValueError(f"object {number + 1}, a {objects[number].label}, sits on no pipe")
    _fits_in(description.tank, description)
    return Structure(description, tuple(runs), objects, tuple(edges))


def _fits_in(tank: Tank, description: Description) -> None:
    """Raises ValueError for a pipe, or a vehicle on its path, that is not in the water of the tank."""
    half = np.array(tank.size_m) / 2

    def inside(point: Any) -> bool:
        x, y, z = point
        return bool(abs(x) < half[0] and abs(y) < half[1] and 0 <= z < tank.depth_m)

    for number, pipe in enumerate(description.pipes):
        if not (inside(pipe.start) and inside(pipe.end)):
            raise ValueError(f"pipe {number + 1} does not lie in the tank")
    path = description.path
    reach = max(path.radius_m)
    x, y = path.centre
    corners = [(x + i * reach, y + j * reach, z) for i in (-1, 1) for j in (-1, 1) for z in path.depth_m]
    if not all(inside(point) for point in path.waypoints or corners):
        raise ValueError("the path leaves the water of the tank")


def _first(error: ValidationError) -> str:
    one = error.errors()[0]
    place = " ".join(str(part + 1) if isinstance(part, int) else part for part in one["loc"])  # the first is 1, as elsewhere
    return f"{place}: {one['msg'].removeprefix('Value error, ')}"


def _object(number: int, line: ObjectLine) -> Object:
    def unit(vector: Any, what: str) -> Array:
        length = float(np.linalg.norm(vector))
        if length < 1e-6:
            raise ValueError(f"object {number + 1} has a {what} without a length")
        return np.asarray(vector, float) / length

    x = unit(line.axis, "axis")
    second = {"y": line.branch, "z": line.handle}
    has_branch, has_handle = len(PORTS[line.label]) == 3 or line.label == "elbow", line.label in WITH_HANDLE
    if has_branch and second["y"] is None:
        raise ValueError(f"object {number + 1}, a {line.label}, needs a branch")
    if has_handle and not has_branch and second["z"] is None:
        raise ValueError(f"object {number + 1}, a {line.label}, needs a handle")
    if second["y"] is not None:
        y = unit(second["y"], "branch")
        handle_side = None if second["z"] is None else unit(second["z"], "handle")
        _square(number, x, y)
        z = np.cross(x, y)
        if handle_side is not None and z @ handle_side < 0:  # the straight way has no direction of its own: turn it round
            if line.label == "elbow":
                raise ValueError(f"object {number + 1}, an elbow, has no handle")
            x, z = -x, -z
    elif second["z"] is not None:
        z = unit(second["z"], "handle")
        _square(number, x, z)
        y = np.cross(z, x)
    else:
        y = unit(np.cross(x, np.eye(3)[int(np.argmin(np.abs(x)))]), "axis")
        z = np.cross(x, y)
    rotation = np.column_stack([x, y, np.cross(x, y)])
    return Object(line.label, np.array(line.position), rotation, line.open if has_handle else None)


def _square(number: int, a: Array, b: Array) -> None:
    if abs(float(a @ b)) > 0.05:
        raise ValueError(f"object {number + 1}: axis, branch and handle must be at right angles")


def _where(run: Pipe, position: Array) -> str | None:
    axis = run.end - run.start
    length = float(np.linalg.norm(axis))
    axis = axis / length
    along = float((position - run.start) @ axis)
    if np.linalg.norm(position - run.start - along * axis) > ON_AXIS_M or not -AT_END_M <= along <= length + AT_END_M:
        return None
    return "end" if min(along, length - along) < AT_END_M else "through"


def _merged(pieces: list[Pipe], objects: tuple[Object, ...]) -> list[Pipe]:
    """Pipes in line that meet in an object (or end to end) as one run: so the paper merges them, Fig. 8."""
    runs = list(pieces)
    joined = True
    while joined:
        joined = False
        for i in range(len(runs)):
            for j in range(i + 1, len(runs)):
                one = _joined(runs[i], runs[j], objects)
                if one is not None:
                    runs[i] = one
                    del runs[j]
                    joined = True
                    break
            if joined:
                break
    return runs


def _joined(a: Pipe, b: Pipe, objects: tuple[Object, ...]) -> Pipe | None:
    axis = (a.end - a.start) / np.linalg.norm(a.end - a.start)
    if a.radius != b.radius:
        return None
    for end in (b.start, b.end):
        off = end - a.start
        if np.linalg.norm(off - (off @ axis) * axis) > ON_AXIS_M:
            return None
    ends = np.array([a.start, a.end, b.start, b.end])
    along = (ends - a.start) @ axis
    low, high = sorted(along[:2]), sorted(along[2:])
    gap = max(low[0], high[0]) - min(low[1], high[1])
    if gap > 0.01:
        middle = a.start + axis * (min(low[1], high[1]) + gap / 2)
        if gap > 2 * AT_END_M or not any(np.linalg.norm(thing.position - middle) < AT_END_M for thing in objects):
            return None
    order = np.argsort(along)
    return Pipe(ends[order[0]], ends[order[-1]], a.radius)
