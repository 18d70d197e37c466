"""From navigation and scans to the semantic map (paper, Fig. 1): one call for each reading and one for each scan, in order
of time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from estimators.structure.apart import ApartSettings, take_apart, undistorted
from estimators.structure.coverage import Coverage
from estimators.structure.fusion import fused
from estimators.structure.graph import StructureMap, final_map, leaving
from estimators.structure.handles import handle_height
from estimators.structure.objects_map import ObjectRecord, View, belief
from estimators.structure.recognition import (
    DescriptorSettings,
    Views,
    configuration,
    describe,
    nearest_class,
    ports_likelihood,
)
from estimators.structure.slam import Matches, SlamSettings, StructureFilter
from estimators.structure.smoothing import Between, Leg, Spot, Way, smoothed
from estimators.structure.types import Array, Parts, Segment, Sighting
from estimators.structure.vehicle import SensorMount, body_rates


@dataclass(frozen=True)
class Knowledge:
    """What is known of the objects beforehand: the data base of views, and P(recognised | actual) (6, 6) of a single scan's
    descriptor and of several scans' fused one, and P(handle | actual) (6, 3), see ``handles``."""

    views: Views
    confusion: Array
    fused_confusion: Array
    handles: Array


@dataclass(frozen=True)
class MapperSettings:
    """``fuse``: how many scans are fused before the descriptor; ``same_view`` (rad): from directions no further apart than
    this. ``doubt_after``: readings of a sensor that were refused one after the other until the filter doubts itself."""

    apart: ApartSettings = field(default_factory=ApartSettings)
    slam: SlamSettings = field(default_factory=SlamSettings)
    descriptor: DescriptorSettings = field(default_factory=DescriptorSettings)
    fuse: int = 6
    same_view: float = 0.22
    step_s: float = 0.2
    lost_after: int = 5
    doubt_after: Mapping[str, int] = field(default_factory=lambda: {"depth": 8, "velocity": 5, "attitude": 20})


_DOUBT = {"depth": (slice(2, 3), 0.2), "attitude": (slice(3, 6), 0.05)}
"""Of what a sensor tells: where it stands in the state, and by how much (m, rad) it is doubted."""
_DOUBT_VELOCITY = 0.2
_DVL_GAP_S = 0.5
"""Readings of the DVL that are further apart than this have an outage between them."""

_AHRS_GAP_S = 1.0
"""So long a vehicle turns as the AHRS said last."""


@dataclass(frozen=True)
class Recognised:
    """One sighting of object ``number``: class by the descriptor alone, with Bayes, with semantics, and from fused scans."""

    number: int
    descriptor: int
    bayes: int
    semantic: int
    fused: int
    fused_descriptor: int


@dataclass(frozen=True)
class ScanResult:
    """What one scan came to."""

    parts: Parts
    matches: Matches
    recognised: tuple[Recognised, ...]
    consistent: bool


@dataclass
class Doubts:
    """What speaks against the map. Of all scans ``unexpected`` ones did not look as they should from where navigation had the
    vehicle; for ``nowhere`` of them no other place was found, and they were left out; from the others the vehicle was moved, by
    ``furthest`` (m) at most. Of ``near`` observations near known features ``beside`` fitted none of them. Of the sensors'
    ``readings`` some were ``refused``; each was last ``heard`` (s) and at most ``silent`` (s) before."""

    unexpected: int = 0
    nowhere: int = 0
    furthest: float = 0.0
    near: int = 0
    beside: int = 0
    readings: int = 0
    refused: int = 0
    heard: dict[str, float] = field(default_factory=dict)
    silent: dict[str, float] = field(default_factory=dict)

    def hear(self, what: str, time_s: float, fits: bool) -> None:
        """A reading of a sensor."""
        self.readings += 1
        self.refused += not fits
        self.silent[what] = self.silence(what, time_s)
        self.heard[what] = time_s

    def silence(self, what: str, time_s: float) -> float:
        """The longest time (s) up to now in which sensor ``what`` said nothing; 0 where it never spoke."""
        return max(self.silent.get(what, 0.0), time_s - self.heard.get(what, time_s))

    def add(self, matches: Matches) -> None:
        """One scan more."""
        self.unexpected += not matches.expected
        self.nowhere += not matches.agrees
        self.furthest = max(self.furthest, matches.moved)
        if matches.agrees:
            self.near += matches.fitting
            self.beside += matches.beside


class StructureMapper:
    """Builds the map. ``position`` (3,) and ``angles`` (3,) are where the vehicle begins, at ``time_s``."""

    def __init__(
        self,
        time_s: float,
        position: Array,
        angles: Array,
        mount: SensorMount,
        knowledge: Knowledge,
        rng: np.random.Generator,
        settings: MapperSettings | None = None,
    ) -> None:
        self.settings = settings or MapperSettings()
        self.slam = StructureFilter(position, angles, mount, self.settings.slam)
        self.knowledge = knowledge
        self.coverage: dict[int, Coverage] = {}
        self.objects: dict[int, ObjectRecord] = {}
        self.scans = 0
        self.doubts = Doubts(heard={"velocity": time_s, "attitude": time_s})  # not every vehicle has a pressure sensor
        self._rng = rng
        self._time_s = time_s
        self._rates = np.zeros(3)
        self._strange = 0
        self._refused_in_a_row = dict.fromkeys(self.settings.doubt_after, 0)
        self._known_s = time_s  # when a velocity was last taken, or a scan showed what was known
        self._heard_s = time_s  # when the DVL was last heard, or the beginning
        self._contradicted_s = time_s  # since when it has contradicted the filter
        self._leg_s = time_s
        self._between = Between(self.slam.vehicle, mount, self.settings.slam)
        self._begin = self.slam.covariance.copy()
        self._way = Way([self.slam.vehicle.copy()], [], [], {}, {})

    @property
    def lost(self) -> bool:
        """Whether the last scans fit the map so badly that position and map can no longer be trusted."""
        return self._strange >= self.settings.lost_after

    @property
    def time_s(self) -> float:
        """Up to when everything has been taken in."""
        return self._time_s

    # ---- navigation; a reading from before the filter's time counts as of now

    def advance(self, time_s: float) -> None:
        """On to ``time_s``, in steps."""
        while (left := time_s - self._time_s) > 0:
            dt = min(self.settings.step_s, left)
            rates = self._rates if self._time_s - self.doubts.heard["attitude"] < _AHRS_GAP_S else None
            self.slam.predict(dt, rates)
            self._between.predict(dt, rates)
            self._time_s = time_s if dt == left else self._time_s + dt

    def depth(self, time_s: float, depth: float, sigma: float) -> None:
        """A pressure sensor's depth (m)."""
        self.advance(time_s)
        fits = self.slam.depth(depth, sigma)
        self._judge("depth", fits)
        if fits:
            self._between.depth(depth, sigma)

    def velocity(self, time_s: float, velocity: Array, sigma: float) -> None:
        """A DVL's velocity (3,) along the body's axes."""
        self.advance(time_s)
        if not self._refused_in_a_row["velocity"]:
            self._contradicted_s = max(self._heard_s, self._time_s - _DVL_GAP_S)
        self._heard_s = self._time_s
        change = velocity - self.slam.vehicle[6:9]
        fits = self.slam.velocity(velocity, sigma)
        self._judge("velocity", fits, change)
        if fits:
            self._known_s = self._time_s
            self._between.velocity(velocity, sigma)

    def attitude(self, time_s: float, angles: Array, rates: Array | None, sigma: float) -> None:
        """An AHRS's roll, pitch, yaw (3,) and, where it tells them, their rates (3,)."""
        self.advance(time_s)
        fits = self.slam.attitude(angles, sigma)
        self._judge("attitude", fits)
        if fits:
            self._between.attitude(angles, sigma)
        self._rates = np.zeros(3) if rates is None else rates

    def _judge(self, what: str, fits: bool, change: Array | None = None) -> None:
        """Count what was left out. A vehicle that starts or stops at once contradicts the filter until it doubts itself."""
        self.doubts.hear(what, self._time_s, fits)
        self._refused_in_a_row[what] = 0 if fits else self._refused_in_a_row[what] + 1
        if self._refused_in_a_row[what] >= self.settings.doubt_after[what]:
            self._refused_in_a_row[what] = 0
            if change is not None:
                for filtered, known_s in ((self.slam, self._known_s), (self._between, max(self._known_s, self._leg_s))):
                    since = self._time_s - max(known_s, self._contradicted_s)
                    filtered.doubt_velocity(_DOUBT_VELOCITY, since, (self._time_s - known_s - since) * change)
            else:
                self.slam.doubt(*_DOUBT[what])
                self._between.doubt(*_DOUBT[what])

    # ---- scans

    def scan(self, time_s: float, points: Array, late: Array | None = None) -> ScanResult:
        """One scan (N, 3) in the sensor's frame, its points seen ``late`` (N,) seconds after ``time_s``."""
        self.advance(time_s)
        parts = take_apart(self._still(points, late), self._rng, self.settings.apart)
        return self.add_parts(parts)

    def add_parts(self, parts: Parts) -> ScanResult:
        """A scan that has been taken apart already, as of now."""
        self.scans += 1
        matches = self.slam.scan(parts.segments, parts.sightings)
        consistent = matches.expected
        if not consistent:
            for rows, sigma in zip((slice(0, 3), slice(6, 9)), self.settings.slam.jolt, strict=True):
                self._between.doubt(rows, sigma)
        self._remember(self._between.leg(), parts, matches)
        if len({*matches.segments, *matches.sightings} - matches.new - {-1}) >= 3:
            self._known_s = self._time_s
        self._strange = 0 if matches.agrees else self._strange + 1
        self.doubts.add(matches)
        for number in matches.dropped:
            self.objects.pop(number, None)
            self.coverage.pop(number, None)
        self._cover(parts, matches)
        recognised = []
        for sighting, number in zip(parts.sightings, matches.sightings, strict=True):
            if number >= 0:
                one = self._recognise(sighting, number)
                if one is not None:
                    recognised.append(one)
        return ScanResult(parts, matches, tuple(recognised), consistent)

    def smooth(self) -> list[Array]:
        """Work the whole way out once more, with all that has been seen: the states (9,) at the scans. Lines and points of the
        map move with it; their covariances stay those of the filter, which are the larger ones."""
        features = self.slam.features
        self._way.lines = {n: f.line for n, f in features.items() if f.line is not None}
        self._way.points = {n: f.point for n, f in features.items() if f.point is not None}
        found = smoothed(self._way, self._begin, self.slam.mount)
        for number, line in found.lines.items():
            features[number].line = line
        for number, point in found.points.items():
            before = features[number].point
            assert before is not None
            features[number].point = point
            if number in self.objects:  # what was seen of an object moves with it, or its handle would stand beside it
                moved = point - before
                views = self.objects[number].views
                self.objects[number].views = [View(view.eye + moved, view.cloud + moved) for view in views]
        return found.states[1:]

    def result(self) -> StructureMap:
        """The map as it stands."""
        return final_map(self.slam, self.coverage, self.objects, self.scans, self.settings.apart.pipes.radius)

    def _remember(self, leg: Leg, parts: Parts, matches: Matches) -> None:
        """What smoothing needs of one scan; the next leg begins here."""
        seen: list[tuple[int, Segment | Spot]] = list(zip(matches.segments, parts.segments, strict=True))
        seen += [(n, Spot(s.position, s.covariance)) for n, s in zip(matches.sightings, parts.sightings, strict=True)]
        self._way.legs.append(leg)
        self._way.states.append(self.slam.vehicle.copy())
        self._way.seen.append([(n, what) for n, what in seen if n >= 0])
        self._between.restart(self.slam.vehicle)
        self._leg_s = self._time_s

    def _still(self, points: Array, late: Array | None) -> Array:
        mount, vehicle = self.slam.mount, self.slam.vehicle
        turning = body_rates(vehicle[3:6], self._rates)
        velocity = vehicle[6:9] + np.cross(turning, mount.offset)
        return undistorted(points, late, mount.rotation.T @ velocity, mount.rotation.T @ turning)

    def _cover(self, parts: Parts, matches: Matches) -> None:
        pose = self.slam.pose()
        for segment, number in zip(parts.segments, matches.segments, strict=True):
            feature = self.slam.features.get(number)
            if feature is None or feature.line is None:
                continue
            shown = np.concatenate([segment.bins, [0.0, segment.length]])
            places = segment.start + shown[:, None] * segment.direction
            along = feature.line.along(pose.position + places @ pose.rotation.T)
            self.coverage.setdefault(number, Coverage()).add(along)

    def _recognise(self, sighting: Sighting, number: int) -> Recognised | None:
        record = self.objects.setdefault(number, ObjectRecord())
        pose = self.slam.pose()
        point = self.slam.features[number].point
        assert point is not None
        pipes = leaving(self.slam, self.coverage, point)
        record.configurations.add(configuration(pipes))
        record.ports = np.log(ports_likelihood(pipes, self.slam.features[number].sightings))
        height = handle_height(sighting.cloud, sighting.position, np.vstack([sighting.pipes, pipes @ pose.rotation]))
        if height is not None:
            record.handles += np.log(self.knowledge.handles[:, height])
        histograms = describe(sighting.cloud, self.settings.descriptor)
        if histograms is None:
            return None
        k = self.knowledge
        seen, _ = nearest_class(histograms, k.views)
        record.evidence += np.log(k.confusion[:, seen])
        view = View(pose.position.copy(), pose.position + sighting.cloud @ pose.rotation.T)
        clouds = self._same_view(record, view, point)
        fused_seen, confusion = seen, k.confusion
        if len(clouds) > 1:
            described = describe(fused([(c - pose.position) @ pose.rotation for c in clouds]), self.settings.descriptor)
            if described is not None:
                fused_seen, confusion = nearest_class(described, k.views)[0], k.fused_confusion
        record.fused += np.log(confusion[:, fused_seen])
        record.views = [*record.views, view][-self.settings.fuse :]
        record.seen_from.append((pose.position - point) / np.linalg.norm(pose.position - point))
        return Recognised(
            number,
            seen,
            int(np.argmax(belief(record.evidence))),
            int(np.argmax(record.semantic())),
            int(np.argmax(record.together())),
            fused_seen,
        )

    def _same_view(self, record: ObjectRecord, view: View, point: Array) -> list[Array]:
        """The clouds of the latest scans from about the same direction, in the world."""
        now = (view.eye - point) / np.linalg.norm(view.eye - point)
        clouds = [view.cloud]
        for other in record.views[-self.settings.fuse + 1 :]:
            before = (other.eye - point) / np.linalg.norm(other.eye - point)
            if before @ now > np.cos(self.settings.same_view):
                clouds.append(other.cloud)
        return clouds
