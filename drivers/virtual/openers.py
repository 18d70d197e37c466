"""What the table of drivers opens for the kind "virtual": a grabber and an encoder on one crawler."""

from __future__ import annotations

from functools import lru_cache

from drivers.virtual.crawler import DriveClock
from drivers.virtual.drive import demo_drive
from drivers.virtual.encoder import VirtualEncoder
from drivers.virtual.grabber import Footage, VirtualGrabber


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
