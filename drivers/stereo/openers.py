"""How the live stereo cameras of each kind are made, as named in ``drivers.registry``; imports stay inside."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from drivers.library import library
from drivers.stereo.base import PairSettings, StereoCamera
from drivers.stereo.live import LivePair

if TYPE_CHECKING:
    from drivers.stereo.rectifier import Calibrated
    from drivers.stereo.two_cameras import GrabberPair


def realsense(**settings: Any) -> StereoCamera:
    """Infrared 1 and 2 of a RealSense on the USB bus: the one of ``serial``, or the first that is found."""
    return LivePair(library("pyrealsense2"), PairSettings(**settings))


def oak(**settings: Any) -> StereoCamera:
    """The pair of an OAK on the USB bus: the one of ``serial``, or the first that is found."""
    library("depthai")
    import drivers.depth.depthai_rs as depthai_rs

    return LivePair(depthai_rs, PairSettings(**{"height": 800, **settings}))  # the whole of its sensors


def two_cameras(
    *, left: str, right: str, calibrated: Callable[[], Calibrated | None], fps: float = 6.0, **grabbers: Any
) -> StereoCamera:
    """Two V4L2 devices side by side; ``calibrated`` says what is known of their lenses; ``fps`` is no more than a scan needs,
    for each pair is rectified; ``grabbers`` as in ``grabber_pair``."""
    from drivers.stereo.two_cameras import TwoCameras

    return TwoCameras(grabber_pair(left, right, known=calibrated(), fps=fps, **grabbers), calibrated)


def grabber_pair(
    left: str,
    right: str,
    *,
    known: Calibrated | None = None,
    width: int = PairSettings.width,
    height: int = PairSettings.height,
    fps: float | None = None,
    codec: str | None = None,
) -> GrabberPair:
    """Two V4L2 devices side by side, as their lenses throw their pictures; of the size that the lenses are ``known`` for, where
    that is told. Raises ValueError for what cannot be asked for."""
    from drivers.grabber.v4l2 import V4l2Grabber
    from drivers.stereo.two_cameras import GrabberPair

    size = (width, height) if known is None else known.lenses.left.size
    return GrabberPair(*(V4l2Grabber(device, size, fps, codec=codec) for device in (left, right)))
