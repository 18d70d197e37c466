"""An inspection with everything that an export may need, as plain data. Lengths in metres unless the name says otherwise."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

Direction = Literal["downstream", "upstream"]
Method = Literal["crawler", "rod", "pushrod", "manhole"]


@dataclass(frozen=True)
class NodeRecord:
    """A manhole. ``easting`` and ``northing`` are in the site's reference system (metres, or degrees where that is
    geographic), ``level`` is the cover's height; None where nobody has entered them."""

    name: str
    easting: float | None = None
    northing: float | None = None
    level: float | None = None

    @property
    def placed(self) -> bool:
        """Whether it can be drawn on a map."""
        return self.easting is not None and self.northing is not None


@dataclass(frozen=True)
class PipeRecord:
    """A pipe between two nodes; water flows from ``upstream`` to ``downstream``. ``dn_mm`` is what the map says of it."""

    name: str
    upstream: NodeRecord
    downstream: NodeRecord
    material: str = "unknown"
    shape: str = "circular"
    dn_mm: int | None = None
    length: float | None = None


@dataclass(frozen=True)
class Photo:
    """A JPEG under the name that observations call it by."""

    name: str
    jpeg: bytes


@dataclass(frozen=True)
class Observation:
    """One coded observation (EN 13508-2): ``station`` from the start node, main ``code``, characterisations ``ch1`` and
    ``ch2``, quantifications ``q1`` and ``q2`` in the units of the code, clock hours 1 to 12 from and to, ``continuous``
    A1 ... or B1 ... for the ends of a defect that goes on, ``at_joint``, ``remark``, the name of its ``photo`` and the
    ``source`` that it was derived from ("" where somebody entered it)."""

    station: float
    code: str
    ch1: str = ""
    ch2: str = ""
    q1: float | None = None
    q2: float | None = None
    clock_from: int | None = None
    clock_to: int | None = None
    continuous: str = ""
    at_joint: bool = False
    remark: str = ""
    photo: str = ""
    source: str = ""
    number: int = 0


@dataclass(frozen=True)
class DiameterSheet:
    """What a lining is ordered by, in millimetres: one measured position at ``station``. ``profile`` are points (x, y) of the
    cross-section around its centre, x right and y down, None where no wall was seen; ``frames_mm`` the diameters of the single
    frames."""

    survey: int
    verdict: str
    reasons: tuple[str, ...]
    diameter_mm: float | None
    interval_mm: tuple[float, float] | None
    minimum_mm: float | None = None
    maximum_mm: float | None = None
    ovality: float | None = None
    dn: str | None = None
    station: float | None = None
    position: str | None = None
    camera: str = ""
    frames_mm: tuple[float, ...] = ()
    profile_mm: tuple[tuple[float, float] | None, ...] = ()
    water_mm: float | None = None


@dataclass(frozen=True)
class AnomalySheet:
    """One scan of the anomaly survey from ``station`` on (m, None where nobody said): mean deviations inwards and outwards,
    share of the wall in view that was measured, ``near`` and ``far`` (m ahead) between which it was, regions that one pair saw
    alone, the pipe's height (None where it cannot be believed). ``picture`` and ``wall`` are names of photos."""

    survey: int
    verdict: str
    reasons: tuple[str, ...]
    station: float | None
    score_mm: float | None
    outward_mm: float | None
    coverage: float
    near: float | None = None
    far: float | None = None
    unconfirmed: int = 0
    height_mm: float | None = None
    picture: str = ""
    wall: str = ""


@dataclass(frozen=True)
class Cloud:
    """Points (x, y, z) of one depth recording in its camera's frame, which of them lie on the wall, the fitted cylinder's
    ``axis`` and a ``point`` of it (None where nothing was fitted), and where along the pipe the camera stood."""

    survey: int
    points: tuple[tuple[float, float, float], ...]
    on_wall: tuple[bool, ...]
    axis: tuple[float, float, float] | None = None
    point: tuple[float, float, float] | None = None
    station: float | None = None


@dataclass(frozen=True)
class Instrument:
    """The ``sensor`` that made a ``survey`` of this ``kind``; ``calibration`` states it by the keys of ``export.wording``."""

    survey: int
    kind: str
    sensor: str
    calibration: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Inspection:
    """One inspection of one pipe. ``crs`` is the EPSG number of the nodes' coordinates; ``date`` is ISO 8601, None where the
    box did not know it; ``landmarks`` and ``structures`` are what the surveys state, as JSON; ``anomalies`` (regions),
    ``joints`` and ``bands`` what the ``scans`` state together, see ``device.anomaly.along``."""

    number: int
    site: str
    pipe: PipeRecord
    operator: str = ""
    date: str | None = None
    direction: Direction = "downstream"
    method: Method = "crawler"
    length: float | None = None
    crs: int | None = None
    note: str = ""
    observations: tuple[Observation, ...] = ()
    photos: tuple[Photo, ...] = ()
    diameters: tuple[DiameterSheet, ...] = ()
    clouds: tuple[Cloud, ...] = ()
    landmarks: tuple[Mapping[str, Any], ...] = ()
    anomalies: tuple[Mapping[str, Any], ...] = ()
    joints: tuple[Mapping[str, Any], ...] = ()
    bands: tuple[Mapping[str, Any], ...] = ()
    scans: tuple[AnomalySheet, ...] = ()
    structures: tuple[Mapping[str, Any], ...] = ()
    instruments: tuple[Instrument, ...] = ()

    @property
    def start(self) -> NodeRecord:
        """The node that stations count from."""
        return self.pipe.upstream if self.direction == "downstream" else self.pipe.downstream

    @property
    def end(self) -> NodeRecord:
        """The other one."""
        return self.pipe.downstream if self.direction == "downstream" else self.pipe.upstream

    def photo(self, name: str) -> Photo | None:
        """By name."""
        return next((photo for photo in self.photos if photo.name == name), None)
