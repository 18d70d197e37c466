"""What a structure survey listens to: a scanner (or a depth camera that serves as one) and the navigation of what carries it.

Nothing is opened here.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from device.config import StructureSettings
from device.errors import Invalid
from device.feeds.feed import CameraFeed, Feed
from device.feeds.reader import FeedTiming
from device.feeds.samples import NAVIGATION, SCAN
from device.feeds.tap import Tap
from drivers.base import DriverError
from drivers.depth.base import DepthFrame
from drivers.navigation.base import NavigationSensor
from drivers.navigation.readings import NavReading
from drivers.navigation.scans import Mount, Scan, mount_at
from drivers.registry import open_navigation
from estimators.pinhole import rays

ROLES = ("dvl", "pressure", "ahrs")
MOST_POINTS = 40_000
"""A denser picture of a depth camera is thinned to so many points."""
_SCANNER_TIMING = FeedTiming(read_s=8.0, stale_s=8.0, read_limit_s=90.0)
_NAVIGATION_TIMING = FeedTiming(read_s=2.0, stale_s=3.0)
_SCANS_WAITING = 3
_READINGS_WAITING = 8192


class CameraScans(Tap[Scan]):
    """The pictures of a depth camera as scans, no more than one each ``period_s``."""

    def __init__(self, feed: CameraFeed, period_s: float) -> None:
        super().__init__(_SCANS_WAITING, lambda tap: None)
        self._period_ns = round(period_s * 1e9)
        self._due_ns = 0
        self._pictures = feed.follow(self._take)

    def _take(self, frame: DepthFrame) -> None:
        if frame.monotonic_ns >= self._due_ns:
            self._due_ns = frame.monotonic_ns + self._period_ns
            self.offer(scan_of(frame))

    def close(self) -> None:
        """No more scans. May be called twice."""
        self._pictures.close()
        super().close()


def scan_of(frame: DepthFrame) -> Scan:
    """A depth picture as a scan: all its points are of one moment."""
    seen = frame.depth > 0
    step = max(1, int(np.ceil(np.sqrt(seen.sum() / MOST_POINTS))))
    depth = frame.depth[::step, ::step]
    kept = depth > 0
    z = depth[kept].astype(np.float64) * frame.depth_unit_m
    xy = rays(frame.intrinsics)[::step, ::step][kept]
    return Scan(frame.monotonic_ns / 1e9, np.column_stack([xy * z[:, None], z]))


@dataclass
class ChamberRig:
    """``scanner`` is None on a box that maps no chambers; ``navigation`` by "dvl", "pressure" and "ahrs".

    ``begin`` is called as a survey begins: the virtual vehicle sets off. ``close`` ends what is no feed.
    """

    scanner: Feed[Scan] | CameraFeed | None = None
    navigation: dict[str, Feed[NavReading]] = field(default_factory=dict)
    mount: Mount = field(default_factory=lambda: mount_at(0.0, np.zeros(3)))
    radius_m: float = 0.0315
    upright: bool = False
    scan_period_s: float = 2.0
    start: Callable[[], None] = lambda: None
    begin: Callable[[], None] = lambda: None
    close: Callable[[], None] = lambda: None

    @property
    def feeds(self) -> list[Feed[Any]]:
        """All that are this rig's own; a depth camera is the box's."""
        own: list[Feed[Any]] = [] if self.scanner is None or isinstance(self.scanner, CameraFeed) else [self.scanner]
        return [*own, *self.navigation.values()]

    def scans(self) -> Tap[Scan]:
        """Every scan from now on. Close it after use."""
        if isinstance(self.scanner, CameraFeed):
            return CameraScans(self.scanner, self.scan_period_s)
        assert self.scanner is not None  # whoever asks has looked
        return self.scanner.tap(_SCANS_WAITING)

    def readings(self) -> list[Tap[NavReading]]:
        """Every reading of each sensor from now on."""
        return [feed.tap(_READINGS_WAITING) for feed in self.navigation.values()]


def make_rig(settings: StructureSettings, seed: int, cameras: list[CameraFeed], on_change: Callable[[], None]) -> ChamberRig:
    """The rig of the settings. Raises Invalid where they name what cannot be."""
    if settings.scanner == "none":
        return ChamberRig()
    if settings.scanner == "virtual":
        return virtual_rig(settings, seed, on_change)
    if not cameras:
        raise Invalid("The scanner of a structure survey is the depth camera, and this box has none.")
    navigation = {}
    for role in ROLES:
        kind = getattr(settings, role)
        if kind == "none":
            continue
        port = getattr(settings, f"{role}_port")
        if not port:
            raise Invalid(f"Say with {role}_port where the {kind} {role} is plugged in.")
        navigation[role] = _sensor_feed(kind, on_change, {"port": port, **settings.options.get(role, {})})
    if "ahrs" not in navigation or "dvl" not in navigation:
        raise Invalid("A structure survey needs a DVL and an AHRS beside the camera: name both in the settings.")
    return ChamberRig(
        cameras[0],
        navigation,
        mount_at(float(np.radians(settings.tilt_deg)), np.array(settings.offset_m)),
        settings.pipe_radius_m,
        settings.upright,
        1.0 / settings.scan_hz,
    )


def virtual_rig(settings: StructureSettings, seed: int, on_change: Callable[[], None]) -> ChamberRig:
    """The virtual chamber: its scanner's twin, and the real drivers on the wires of the others' twins."""
    from statistics import median

    from drivers.virtual.chamber.live import LiveChamber
    from drivers.virtual.chamber.structure import load_structure

    try:
        chamber = LiveChamber(load_structure(settings.file), seed)
    except DriverError as error:
        raise Invalid(str(error)) from None
    kinds = {"dvl": "waterlinked", "pressure": "nmea", "ahrs": "xsens"}
    navigation = {
        role: _sensor_feed(kind, on_change, {"port": chamber.wires.port(role)}, virtual=True) for role, kind in kinds.items()
    }
    scanner: Feed[Scan] = Feed(
        "virtual scanner",
        "virtual",
        chamber.scanner,
        SCAN,
        on_demand=True,
        timing=_SCANNER_TIMING,
        on_change=on_change,
    )
    return ChamberRig(
        scanner,
        navigation,
        chamber.mount,
        median(pipe.radius for pipe in chamber.structure.runs),
        settings.upright,
        start=chamber.wires.start,
        begin=chamber.begin,
        close=chamber.close,
    )


def _sensor_feed(
    kind: str, on_change: Callable[[], None], arguments: dict[str, Any], virtual: bool = False
) -> Feed[NavReading]:
    def make() -> NavigationSensor:
        return open_navigation(kind, **arguments)

    try:
        name = make().name
    except (DriverError, ValueError) as error:
        raise Invalid(str(error)) from None
    except TypeError as error:
        raise Invalid(f"The settings name an option that its driver does not have: {error}.") from None
    return Feed(
        f"virtual {name}" if virtual else name,
        "virtual" if virtual else kind,
        make,
        NAVIGATION,
        timing=_NAVIGATION_TIMING,
        on_demand=virtual,
        on_change=on_change,
    )
