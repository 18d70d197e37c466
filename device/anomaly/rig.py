"""From the settings to the stereo camera of the anomaly survey, and the rig that its pictures are read with. Nothing is opened
here."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

from device.anomaly.calibration import RigSource, load_calibration
from device.config import StereoSettings
from device.errors import Invalid
from device.feed import StereoFeed
from drivers.base import DriverError
from drivers.registry import open_stereo_camera


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
    dwell = max(1, round(settings.hold_s * settings.rate_hz))
    arguments: dict[str, Any] = {"rate_hz": settings.rate_hz, "dwell": dwell}
    if kind == "replay":
        if settings.source is None:
            raise Invalid("Say with source in [stereo] which folder of pairs to replay.")
        arguments |= {"folder": settings.source, "loop": True}
    else:
        arguments |= {"seed": seed}
    source = RigSource(None if settings.calibration is None else load_calibration(settings.calibration))
    make = partial(open_stereo_camera, kind, **arguments)
    try:
        camera = make()
        if kind == "replay":
            camera.open()  # its manifest can be read
            camera.close()
    except DriverError as error:
        raise Invalid(str(error)) from None
    return StereoEye(StereoFeed(camera.name, kind, make, recorded=kind == "replay", on_change=on_change), source)
