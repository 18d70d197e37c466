"""What the table of drivers opens for the kind "virtual": a grabber and an encoder on one crawler, and a stereo camera."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from drivers.virtual.crawler import DriveClock
from drivers.virtual.drive import demo_drive
from drivers.virtual.encoder import VirtualEncoder
from drivers.virtual.grabber import Footage, VirtualGrabber
from drivers.virtual.landmarks import Patch
from drivers.virtual.profile import circular
from drivers.virtual.stereo_camera import StereoLens, StereoLook, StereoPainter, VirtualStereoCamera
from drivers.virtual.world import Joint, VirtualSewer


@lru_cache(maxsize=2)
def crawler(seed: int) -> tuple[Footage, DriveClock]:
    """The demo's crawler of a ``seed``, on its way there and back until the process ends."""
    footage = Footage(demo_drive(seed))
    clock = DriveClock(footage.drive.length_s, loop=True)
    clock.begin()
    return footage, clock


def grabber(seed: int = 1) -> VirtualGrabber:
    """What the crawler's camera sees."""
    return VirtualGrabber(*crawler(seed))


def encoder(seed: int = 1) -> VirtualEncoder:
    """What its tether counts (m)."""
    footage, clock = crawler(seed)
    return VirtualEncoder(footage.drive, clock)


def stereo_camera(seed: int = 1, dwell: int = 1, rate_hz: float | None = None) -> VirtualStereoCamera:
    """A stereo camera that goes through a round pipe with deposits, lost wall, joints and a smooth stretch; see there for
    ``dwell`` and ``rate_hz``."""
    rng = np.random.default_rng([seed, 9])
    patches = []
    for at in np.arange(1.2, 7.0, 0.8):
        height = float(rng.uniform(0.008, 0.045)) * (1.0 if rng.random() < 0.7 else -0.5)
        angle = float(rng.normal(np.pi / 2, 0.4) if height > 0 else rng.uniform(-np.pi, np.pi))
        patches.append(Patch(float(at), float(at + rng.uniform(0.08, 0.25)), angle, float(rng.uniform(0.15, 0.4)), height))
    sewer = VirtualSewer(circular(0.4), 9.0, joints=(Joint(2.4), Joint(4.8)), things=tuple(patches))
    painter = StereoPainter(sewer, StereoLens(), StereoLook(smooth=((3.4, 3.8),)), seed)
    return VirtualStereoCamera(painter, seed=seed, dwell=dwell, rate_hz=rate_hz)
