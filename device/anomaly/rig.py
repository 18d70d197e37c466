"""From the settings to the stereo camera of the anomaly survey, and the rig that its pictures are read with. Nothing is opened
here."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

from device.anomaly.calibration import KnownPipeCalibration, RigSource, load_calibration
from device.config import StereoSettings
from device.errors import Invalid
from device.feeds.feed import StereoFeed
from drivers.base import DriverError
from drivers.registry import open_stereo_camera
from drivers.stereo.base import StereoCamera
from drivers.stereo.openers import grabber_pair
from drivers.stereo.two_cameras import GrabberPair


@dataclass(frozen=True)
class StereoEye:
    """The camera with its calibration."""

    feed: StereoFeed
    source: RigSource
    lenses: Callable[[], GrabberPair] | None = None
    """Makes the two cameras as their lenses throw their pictures, for a calibration by a board; None where they rectify
    themselves."""


def make_stereo(settings: StereoSettings, seed: int, on_change: Callable[[], None]) -> StereoEye | None:
    """The stereo camera of the settings, None where the box has none. Raises Invalid where they name what cannot be."""
    kind = settings.driver
    if kind == "none":
        return None
    file = settings.calibration
    unknown = file is None or (kind == "pair" and not file.exists())  # a pair may be calibrated on the page
    source = RigSource(None if unknown or file is None else load_calibration(file))
    make = partial(open_stereo_camera, kind, **_arguments(settings, source, seed))
    lenses = partial(_lenses, settings, source) if kind == "pair" else None
    name = _checked(make, settings).name
    return StereoEye(StereoFeed(name, kind, make, recorded=kind == "replay", on_change=on_change), source, lenses)


def _lenses(settings: StereoSettings, source: RigSource) -> GrabberPair:
    """The two cameras, their pictures as large as those that are rectified: a new calibration is of the same."""
    options: Any = settings.options
    return grabber_pair(settings.left, settings.right, known=source.lenses, **options)


def _arguments(settings: StereoSettings, source: RigSource, seed: int) -> dict[str, Any]:
    """What the driver is made with."""
    kind = settings.driver
    if source.lenses is not None and kind not in ("pair", "replay"):
        raise Invalid(f"The calibration {settings.calibration} is of two plain cameras: the driver {kind} rectifies by itself.")
    if kind == "pair":
        if isinstance(source.calibration, KnownPipeCalibration):
            raise Invalid(f"The calibration {settings.calibration} is by a known pipe: two plain cameras need one by a board.")
        if not settings.left or not settings.right or settings.left == settings.right:
            raise Invalid("Say with left and right in [stereo] which two cameras are the pair.")
        if settings.calibration is None:
            raise Invalid("Two plain cameras need a calibration by a board: name its file with calibration in [stereo].")
        return {**settings.options, "left": settings.left, "right": settings.right, "calibrated": lambda: source.lenses}
    if kind in ("realsense", "oak"):
        return dict(settings.options)
    dwell = max(1, round(settings.hold_s * settings.rate_hz))
    paced = {"rate_hz": settings.rate_hz, "dwell": dwell}
    if kind == "virtual":
        return {**paced, "seed": seed}
    if settings.source is None:
        raise Invalid("Say with source in [stereo] which folder of pairs to replay.")
    return {**paced, "folder": settings.source, "loop": True, "calibrated": source.lenses}


def _checked(make: Callable[[], StereoCamera], settings: StereoSettings) -> StereoCamera:
    """A slip of the operator's is told now, before anything is started."""
    try:
        camera = make()
        if settings.driver == "replay":
            camera.open()  # its manifest can be read
            camera.close()
    except (DriverError, ValueError) as error:
        text = str(error).rstrip(".")
        raise Invalid(f"{text[:1].upper()}{text[1:]}.") from None
    except TypeError:
        named = ", ".join(settings.options)
        raise Invalid(f"The stereo driver {settings.driver} does not know all of its options: {named}.") from None
    return camera
