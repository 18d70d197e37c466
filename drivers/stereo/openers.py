"""How the live stereo cameras of each kind are made, as named in ``drivers.registry``; imports stay inside."""

from __future__ import annotations

from typing import Any

from drivers.library import library
from drivers.stereo.base import PairSettings, StereoCamera
from drivers.stereo.live import LivePair


def realsense(**settings: Any) -> StereoCamera:
    """Infrared 1 and 2 of a RealSense on the USB bus: the one of ``serial``, or the first that is found."""
    return LivePair(library("pyrealsense2"), PairSettings(**settings))


def oak(**settings: Any) -> StereoCamera:
    """The pair of an OAK on the USB bus: the one of ``serial``, or the first that is found."""
    library("depthai")
    import drivers.depth.depthai_rs as depthai_rs

    return LivePair(depthai_rs, PairSettings(**{"height": 800, **settings}))  # the whole of its sensors


def two_cameras(*, left: str, right: str, calibrated: Any, fps: float = 6.0, codec: str | None = None) -> StereoCamera:
    """Two V4L2 devices side by side; ``calibrated`` is a ``drivers.stereo.rectifier.Calibrated``;
    ``fps`` is no more than a scan needs, for each pair is rectified."""
    from drivers.grabber.v4l2 import V4l2Grabber
    from drivers.stereo.two_cameras import GrabberPair, TwoCameras

    size = calibrated.lenses.left.size
    return TwoCameras(GrabberPair(*(V4l2Grabber(device, size, fps, codec=codec) for device in (left, right))), calibrated)
