"""How the cameras of each kind are made. One function a kind, named in ``drivers.registry``; imports stay inside them."""

from __future__ import annotations

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
