"""The table of what the box can be plugged into: a kind of camera, and what opens it, loaded when it is asked for."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from typing import Any

from drivers.base import SensorMissing
from drivers.depth.base import DepthCamera, DepthSettings

DEPTH_CAMERAS: dict[str, str] = {
    "realsense": "drivers.depth.openers:realsense",
    "oak": "drivers.depth.openers:oak",
    "replay": "drivers.depth.openers:replay",
    "virtual": "drivers.depth.openers:virtual",
}
"""Kind -> "module:function"; the function takes DepthSettings and keyword arguments of its own and returns the cameras."""


def open_depth_cameras(kind: str, settings: DepthSettings | None = None, **arguments: Any) -> list[DepthCamera]:
    """The depth cameras of a kind, made but not yet streaming: ``open`` is the caller's, who can wait and try again.

    ``arguments``: "replay" takes ``source`` (folder or file), ``rate_hz``, ``loop`` and ``recording``; "virtual" what
    ``drivers.depth.openers.virtual`` takes. Raises SensorMissing for an unknown kind and for software that is not installed.
    """
    if kind not in DEPTH_CAMERAS:
        raise SensorMissing(f"There is no kind of depth camera named {kind}; known are {', '.join(DEPTH_CAMERAS)}.")
    module_name, function_name = DEPTH_CAMERAS[kind].split(":")
    opener: Callable[..., list[DepthCamera]] = getattr(importlib.import_module(module_name), function_name)
    return opener(settings or DepthSettings(), **arguments)
