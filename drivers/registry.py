"""The table of what the box can be plugged into: a kind of sensor, and what makes it, loaded when it is asked for."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from typing import Any

from drivers.base import SensorMissing
from drivers.depth.base import DepthCamera, DepthSettings
from drivers.encoder.base import Encoder
from drivers.grabber.base import FrameGrabber
from drivers.lamp.base import Lamp
from drivers.navigation.base import NavigationSensor
from drivers.stereo.base import StereoCamera

DEPTH_CAMERAS: dict[str, str] = {
    "realsense": "drivers.depth.openers:realsense",
    "oak": "drivers.depth.openers:oak",
    "replay": "drivers.depth.openers:replay",
    "virtual": "drivers.depth.openers:virtual",
}
"""Kind -> "module:function"; the function takes DepthSettings and keyword arguments of its own and returns the cameras."""

GRABBERS: dict[str, str] = {
    "v4l2": "drivers.grabber.v4l2:V4l2Grabber",
    "stream": "drivers.grabber.stream:StreamGrabber",
    "video": "drivers.grabber.video:VideoFile",
    "stills": "drivers.grabber.stills:StillsFolder",
    "virtual": "drivers.virtual.openers:grabber",
}
"""Kind -> "module:callable"; the callable takes keyword arguments of its own and returns the grabber."""

ENCODERS: dict[str, str] = {
    "qsb": "drivers.encoder.qsb:QsbEncoder",
    "lci90": "drivers.encoder.lci90:Lci90Encoder",
    "modbus": "drivers.encoder.modbus:ModbusEncoder",
    "nmea": "drivers.encoder.nmea:NmeaEncoder",
    "pattern": "drivers.encoder.pattern:PatternEncoder",
    "csv": "drivers.encoder.recorded:RecordedEncoder",
    "virtual": "drivers.virtual.openers:encoder",
}
"""Kind -> "module:callable"; the callable takes keyword arguments of its own and returns the encoder."""

LAMPS: dict[str, str] = {
    "gpiozero": "drivers.lamp.pwm:PwmLamp",
    "virtual": "drivers.lamp.virtual:VirtualLamp",
}
"""Kind -> "module:callable"; the callable takes keyword arguments of its own and returns the lamp."""

NAVIGATION: dict[str, str] = {
    "waterlinked": "drivers.navigation.dvl:WaterLinkedDvl",
    "nmea": "drivers.navigation.pressure:NmeaPressure",
    "vectornav": "drivers.navigation.ahrs:VectorNavAhrs",
    "xsens": "drivers.navigation.ahrs:XsensAhrs",
}
"""Kind -> "module:callable"; the callable takes keyword arguments of its own and returns the sensor."""

STEREO_CAMERAS: dict[str, str] = {
    "realsense": "drivers.stereo.openers:realsense",
    "oak": "drivers.stereo.openers:oak",
    "pair": "drivers.stereo.openers:two_cameras",
    "replay": "drivers.stereo.replay:PairReplay",
    "virtual": "drivers.virtual.openers:stereo_camera",
}
"""Kind -> "module:callable"; the callable takes keyword arguments of its own and returns the camera."""


def open_depth_cameras(kind: str, settings: DepthSettings | None = None, **arguments: Any) -> list[DepthCamera]:
    """The depth cameras of a kind, made but not yet streaming: ``open`` is the caller's, who can wait and try again.

    ``arguments``: "replay" takes ``source`` (folder or file), ``rate_hz``, ``loop`` and ``recording``; "virtual" what
    ``drivers.depth.openers.virtual`` takes. Raises SensorMissing for an unknown kind and for software that is not installed.
    """
    opener: Callable[..., list[DepthCamera]] = _named(DEPTH_CAMERAS, kind, "depth camera")
    return opener(settings or DepthSettings(), **arguments)


def open_grabber(kind: str, **arguments: Any) -> FrameGrabber:
    """The CCTV grabber of a kind, made but not yet running: ``open`` is the caller's, who can wait and try again.

    ``arguments``: "v4l2" takes ``device``, ``size``, ``fps``, ``input_index`` and ``standard``; "stream" ``url``; "video"
    ``file``; "stills" ``folder``; "virtual" ``seed``. Raises SensorMissing for an unknown kind, ValueError for arguments that
    cannot be.
    """
    maker: Callable[..., FrameGrabber] = _named(GRABBERS, kind, "CCTV grabber")
    return maker(**arguments)


def open_stereo_camera(kind: str, **arguments: Any) -> StereoCamera:
    """The stereo camera of a kind, made but not yet streaming: ``open`` is the caller's, who can wait and try again.

    ``arguments``: "realsense" and "oak" take the fields of ``drivers.stereo.base.PairSettings``; "pair" ``left``, ``right``,
    ``calibrated``, ``fps`` and ``codec``; "replay" ``folder``, ``rate_hz``, ``loop`` and ``calibrated``; "virtual" ``seed``,
    ``dwell`` and ``rate_hz``. Raises SensorMissing for an unknown kind and for software that is not installed, ValueError for
    arguments that cannot be.
    """
    maker: Callable[..., StereoCamera] = _named(STEREO_CAMERAS, kind, "stereo camera")
    return maker(**arguments)


def open_encoder(kind: str, **arguments: Any) -> Encoder:
    """The tether encoder of a kind, made but not yet running: ``open`` is the caller's, who can wait and try again.

    ``arguments``: the serial ones take ``port`` and ``baud``, "qsb" and "modbus" also ``rate_hz``, "modbus" ``device_id``,
    ``address``, ``word_order`` and ``bits``, "lci90" ``metres_per_unit``, "pattern" ``pattern``, ``metres_per_unit``, ``bits``
    and ``name``; "csv" ``file`` and ``frame_rate``; "virtual" ``seed``, the same as its grabber's. Raises
    SensorMissing for an unknown kind, ValueError for arguments that cannot be.
    """
    maker: Callable[..., Encoder] = _named(ENCODERS, kind, "tether encoder")
    return maker(**arguments)


def open_navigation(kind: str, **arguments: Any) -> NavigationSensor:
    """The DVL ("waterlinked"), pressure sensor ("nmea") or AHRS ("vectornav", "xsens") of a kind, made but not yet running.

    ``arguments``: all take ``port`` and ``baud``, "nmea" also ``density``, ``surface_pa`` and ``sigma``. Raises SensorMissing
    for an unknown kind, ValueError for arguments that cannot be.
    """
    maker: Callable[..., NavigationSensor] = _named(NAVIGATION, kind, "navigation sensor")
    return maker(**arguments)


def open_lamp(kind: str, **arguments: Any) -> Lamp:
    """The lamp of a kind, made but not yet held: ``open`` is the caller's.

    ``arguments``: "gpiozero" takes ``pin`` and ``hz``. Raises SensorMissing for an unknown kind, ValueError for arguments that
    cannot be.
    """
    maker: Callable[..., Lamp] = _named(LAMPS, kind, "lamp")
    return maker(**arguments)


def _named(table: dict[str, str], kind: str, what: str) -> Callable[..., Any]:
    if kind not in table:
        raise SensorMissing(f"There is no kind of {what} named {kind}; known are {', '.join(table)}.")
    module_name, name = table[kind].split(":")
    made: Callable[..., Any] = getattr(importlib.import_module(module_name), name)
    return made
