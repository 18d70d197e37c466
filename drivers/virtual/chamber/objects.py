"""The six classes of PVC objects of the subsea paper, as solids of the sizes in its Table 1.

An object's own frame: the origin is where its pipes' axes meet, x runs along its straight way (an elbow: out of its first
port), y out of its branch (an elbow: out of its second port), z along the stem to the handle. Pipes are 63 mm wide.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from drivers.virtual.chamber.solids import Array, Box, Cylinder, Solid, Sphere

CLASSES = ("ball valve", "elbow", "tee", "socket", "butterfly valve", "3-way valve")
"""In the order of Table 1."""
SIZES_M = {
    "ball valve": (0.198, 0.120, 0.160),
    "elbow": (0.1225, 0.1225, 0.077),
    "tee": (0.168, 0.1225, 0.077),
    "socket": (0.088, 0.075, 0.075),
    "butterfly valve": (0.2875, 0.121, 0.243),
    "3-way valve": (0.240, 0.172, 0.160),
}
"""Extents along x, y and z: ball and 3-way valves closed, butterfly valves open."""
WITH_HANDLE = ("ball valve", "butterfly valve", "3-way valve")
PORTS: dict[str, tuple[tuple[float, float, float], ...]] = {
    "ball valve": ((1, 0, 0), (-1, 0, 0)),
    "elbow": ((1, 0, 0), (0, 1, 0)),
    "tee": ((1, 0, 0), (-1, 0, 0), (0, 1, 0)),
    "socket": ((1, 0, 0), (-1, 0, 0)),
    "butterfly valve": ((1, 0, 0), (-1, 0, 0)),
    "3-way valve": ((1, 0, 0), (-1, 0, 0), (0, 1, 0)),
}
"""Directions in which pipes leave, in the object's own frame."""

_X, _Y, _Z = np.eye(3)
_O = np.zeros(3)
_FITTING = 0.0385
_NUT = 0.05
_BODY = 0.055
_TIP = 0.105


def solids_of(label: str, is_open: bool = True) -> list[Solid]:
    """The solids of one object in its own frame. Raises KeyError for a class that is not known."""
    return _MAKERS[label](is_open)


def _tube(start: NDArray[np.float64], end: NDArray[np.float64], radius: float) -> Cylinder:
    return Cylinder(np.asarray(start, float), np.asarray(end, float), radius)


def _block(low: tuple[float, float, float], high: tuple[float, float, float]) -> Box:
    lower, upper = np.array(low), np.array(high)
    return Box((lower + upper) / 2, (upper - lower) / 2, np.eye(3))


def _elbow(_: bool) -> list[Solid]:
    return [_tube(_O, 0.084 * _X, _FITTING), _tube(_O, 0.084 * _Y, _FITTING), Sphere(_O, _FITTING)]


def _tee(_: bool) -> list[Solid]:
    return [_tube(-0.084 * _X, 0.084 * _X, _FITTING), _tube(_O, 0.084 * _Y, _FITTING)]


def _socket(_: bool) -> list[Solid]:
    return [_tube(-0.044 * _X, 0.044 * _X, 0.0375)]


def _stem_and_bar(along: bool) -> list[Solid]:
    """A handle of 120 mm across the stem, along x or along y."""
    a, b = (0.06, 0.011) if along else (0.011, 0.06)
    return [_tube(0.05 * _Z, 0.09 * _Z, 0.012), _block((-a, -b, 0.09), (a, b, _TIP))]


def _ball_valve(is_open: bool) -> list[Solid]:
    return [
        _tube(-0.099 * _X, 0.099 * _X, _FITTING),
        _tube(0.06 * _X, 0.099 * _X, _NUT),
        _tube(-0.099 * _X, -0.06 * _X, _NUT),
        Sphere(_O, _BODY),
        *_stem_and_bar(is_open),
    ]


def _butterfly_valve(is_open: bool) -> list[Solid]:
    lever = _block((-0.02, -0.015, 0.165), (0.2425, 0.015, 0.1825))
    if not is_open:
        lever = _block((-0.015, -0.02, 0.165), (0.015, 0.2425, 0.1825))
    return [_tube(-0.045 * _X, 0.045 * _X, 0.0605), _tube(0.05 * _Z, 0.17 * _Z, 0.018), lever]


def _three_way_valve(is_open: bool) -> list[Solid]:
    """Open where the handle stands along the branch."""
    return [
        _tube(-0.12 * _X, 0.12 * _X, _FITTING),
        _tube(0.08 * _X, 0.12 * _X, _NUT),
        _tube(-0.12 * _X, -0.08 * _X, _NUT),
        _tube(_O, 0.117 * _Y, _FITTING),
        _tube(0.08 * _Y, 0.117 * _Y, _NUT),
        Sphere(_O, _BODY),
        *_stem_and_bar(not is_open),
    ]


_MAKERS = {
    "ball valve": _ball_valve,
    "elbow": _elbow,
    "tee": _tee,
    "socket": _socket,
    "butterfly valve": _butterfly_valve,
    "3-way valve": _three_way_valve,
}


def placed(label: str, is_open: bool, rotation: Array, position: Array) -> list[Solid]:
    """The solids of one object at its pose."""
    return [solid.moved(rotation, position) for solid in solids_of(label, is_open)]
