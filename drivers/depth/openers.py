"""How the cameras of each kind are made. One function a kind, named in ``drivers.registry``; imports stay inside them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from drivers.depth.base import DepthCamera, DepthSettings
from drivers.depth.librealsense import LibrealsenseCamera
from drivers.library import library


def realsense(settings: DepthSettings) -> list[DepthCamera]:
    """The Intel RealSense camera on the USB bus: the one of ``settings.serial``, or the first that is found."""
    return [LibrealsenseCamera(library("pyrealsense2"), settings)]


def oak(settings: DepthSettings) -> list[DepthCamera]:
    """The Luxonis OAK camera on the USB bus: the one of ``settings.serial``, or the first that is found."""
    library("depthai")
    import drivers.depth.depthai_rs as depthai_rs

    return [LibrealsenseCamera(depthai_rs, settings)]


def replay(
    settings: DepthSettings,
    *,
    source: Path,
    rate_hz: float | None = None,
    loop: bool = False,
    recording: str | None = None,
) -> list[DepthCamera]:
    """A recording, see ``drivers.depth.replay.ReplayCamera``. The settings are the recording's own."""
    from drivers.depth.replay import ReplayCamera

    return [ReplayCamera(source, rate_hz, loop, recording=recording)]


def virtual(settings: DepthSettings, *, seed: int = 1, cameras: int = 1, description: Path | None = None) -> list[DepthCamera]:
    """Cameras that look into the virtual sewer: active stereo, and with ``cameras`` 2 time of flight beside it.

    ``description`` is a JSON file, see ``drivers.virtual.demo.Description``. The time-of-flight camera has one size and rate.
    """
    from drivers.virtual.cameras import STEREO_SERIAL, TIME_OF_FLIGHT_FPS, TIME_OF_FLIGHT_SERIAL, demo_bus
    from drivers.virtual.depth_camera import TIME_OF_FLIGHT_LENSES

    bus = demo_bus(seed, description)
    width, height = TIME_OF_FLIGHT_LENSES[0].size
    asked = [
        replace(settings, serial=STEREO_SERIAL),
        DepthSettings(width, height, TIME_OF_FLIGHT_FPS, color=False, serial=TIME_OF_FLIGHT_SERIAL),
    ]
    return [LibrealsenseCamera(bus, one) for one in asked[:cameras]]
