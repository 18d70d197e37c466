"""From the settings to the stereo camera of the anomaly survey, and the rig that its pictures are read with. Nothing is opened
here."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

from device.anomaly.calibration import BoardCalibration, RigSource, load_calibration
from device.config import StereoSettings
from device.errors import Invalid
from device.feeds.feed import StereoFeed
from drivers.base import DriverError
from drivers.registry import open_stereo_camera
from drivers.stereo.base import StereoCamera


@dataclass(frozen=True)
class StereoEye:
    """The camera with its calibration."""

    feed: StereoFeed
    source: RigSource


def make_stereo(settings: StereoSettings, seed: int, on_change: Callable[[], None]) -> StereoEye | None:
    """The stereo camera of the settings, None where the box has none. Raises Invalid where they name what cannot be."""
    kind = settings.driver
    if kind == "none":
        return None
    source = RigSource(None if settings.calibration is None else load_calibration(settings.calibration))
    make = partial(open_stereo_camera, kind, **_arguments(settings, source, seed))
    return StereoEye(
        StereoFeed(_checked(make, settings).name, kind, make, recorded=kind == "replay", on_change=on_change), source
    )


def _arguments(settings: StereoSettings, source: RigSource, seed: int) -> dict[str, Any]:
    """What the driver is made with."""
    kind = settings.driver
    lenses = isinstance(source.calibration, BoardCalibration)
    if lenses and kind not in ("pair", "replay"):
        raise Invalid(f"The calibration {settings.calibration} is of two plain cameras: the driver {kind} rectifies by itself.")
    if kind == "pair":
        if not settings.left or not settings.right or settings.left == settings.right:
            raise Invalid("Say with left and right in [stereo] which two cameras are the pair.")
        if not lenses:
            raise Invalid("Two plain cameras need a calibration by a board: see borescout calibrate stereo --board.")
        return {**settings.options, "left": settings.left, "right": settings.right, "calibrated": source.lenses}
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
