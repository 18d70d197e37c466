"""The crawler as the landmarks survey uses it: where pictures and distances come from, and how its camera looks."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from device.feeds.feed import Feed, GrabberFeed
from device.landmarks.detectors import Detector, NoDetector
from device.landmarks.tether import Tether
from drivers.encoder.base import Encoder
from drivers.lamp.base import Lamp


@dataclass(frozen=True)
class Optics:
    """Focal lengths and principal point of the crawler's camera (px), None for what is not known."""

    focal: tuple[float, float] | None = None
    centre: tuple[float, float] | None = None


@dataclass(frozen=True)
class Crawler:
    """``tether`` is None where the distance is burned into the picture and read by what ``reader`` makes, or is not known at
    all. ``detector`` makes one for each drive, whose beginning also asks for the ``optics``. ``begin`` is told that a drive
    begins and ``hold`` that it pauses: the virtual crawler listens, a real one is driven from its own desk. ``radius`` (m) is
    that of a pipe that states none. ``lamp`` lights the camera's picture, where the box can dim it. ``sparse``: the pictures
    are too far apart in time for flow.
    """

    grabber: GrabberFeed | None = None
    tether: Tether | None = None
    reader: Callable[[], Encoder] | None = None
    detector: Callable[[], Detector] = NoDetector
    optics: Callable[[], Optics] = Optics
    radius: float | None = None
    lamp: Lamp | None = None
    sparse: bool = False
    begin: Callable[[], None] = lambda: None
    hold: Callable[[bool], None] = lambda held: None

    @property
    def feeds(self) -> list[Feed[Any]]:
        """All there are."""
        found: list[Feed[Any]] = [] if self.grabber is None else [self.grabber]
        return found if self.tether is None else [*found, self.tether.feed]
