"""One run through a virtual chamber: navigation and scans in order of time through the mapper."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from drivers.navigation.readings import Attitude, Depth, NavReading
from drivers.navigation.recorded import LogHeader
from drivers.navigation.scans import Scan, mount_at
from drivers.virtual.chamber.navigation import navigation_log
from drivers.virtual.chamber.path import VehiclePath
from drivers.virtual.chamber.scanner import VirtualScanner
from drivers.virtual.chamber.structure import Structure
from estimators.structure.mapper import Knowledge, MapperSettings, ScanResult, StructureMapper
from estimators.structure.slam import StructureFilter
from estimators.structure.vehicle import SensorMount

Array = NDArray[np.float64]


@dataclass
class Track:
    """At each scan: time, the vehicle's state (9,) and its covariance (9, 9), by the filter and by dead reckoning."""

    times: list[float] = field(default_factory=list)
    states: list[Array] = field(default_factory=list)
    covariances: list[Array] = field(default_factory=list)
    reckoned: list[Array] = field(default_factory=list)
    reckoned_covariances: list[Array] = field(default_factory=list)


@dataclass
class Run:
    """The mapper at its end, what each scan came to, the track, and the seconds that each scan took to be worked out."""

    mapper: StructureMapper
    results: list[ScanResult]
    track: Track
    seconds: list[float]


Event = NavReading | Scan


def feed(mapper: StructureMapper, reading: NavReading) -> None:
    """One reading into the mapper."""
    if isinstance(reading, Depth):
        mapper.depth(reading.time_s, reading.depth, reading.sigma)
    elif isinstance(reading, Attitude):
        rates = None if reading.rates is None else np.array(reading.rates)
        mapper.attitude(reading.time_s, np.array(reading.angles), rates, reading.sigma)
    elif reading.valid:
        mapper.velocity(reading.time_s, np.array(reading.velocity), reading.sigma)


class Reckoner:
    """The same navigation without any feature: what the map has to beat."""

    def __init__(self, time_s: float, slam: StructureFilter) -> None:
        self.filter = StructureFilter(slam.vehicle[:3].copy(), slam.vehicle[3:6].copy(), slam.mount, slam.settings)
        self._time_s = time_s
        self._rates = np.zeros(3)

    def feed(self, reading: NavReading) -> None:
        """One reading."""
        self.filter.predict(reading.time_s - self._time_s, self._rates)
        self._time_s = reading.time_s
        if isinstance(reading, Depth):
            self.filter.depth(reading.depth, reading.sigma)
        elif isinstance(reading, Attitude):
            self.filter.attitude(np.array(reading.angles), reading.sigma)
            self._rates = np.zeros(3) if reading.rates is None else np.array(reading.rates)
        elif reading.valid:
            self.filter.velocity(np.array(reading.velocity), reading.sigma)


def run_events(mapper: StructureMapper, events: Iterator[Event], on_scan: Callable[[Run], None] | None = None) -> Run:
    """Everything that comes, in order of time, through the mapper."""
    run = Run(mapper, [], Track(), [])
    reckoner: Reckoner | None = None
    for event in events:
        if reckoner is None:
            reckoner = Reckoner(event.time_s, mapper.slam)
        if not isinstance(event, Scan):
            reckoner.feed(event)
            feed(mapper, event)
            continue
        begun = time.process_time()
        run.results.append(mapper.scan(event.time_s, event.points, event.late_s))
        run.seconds.append(time.process_time() - begun)
        run.track.times.append(event.time_s)
        run.track.states.append(mapper.slam.vehicle.copy())
        run.track.covariances.append(mapper.slam.covariance[:9, :9].copy())
        run.track.reckoned.append(reckoner.filter.vehicle.copy())
        run.track.reckoned_covariances.append(reckoner.filter.covariance[:9, :9].copy())
        if on_scan is not None:
            on_scan(run)
    return run


class VirtualChamber:
    """The twins of one structure: the true way, the scanner, the navigation. Everything random comes from ``seed``."""

    def __init__(self, structure: Structure, seed: int) -> None:
        self.structure = structure
        self._seed = seed
        self.path = VehiclePath(structure.description.path, np.random.default_rng([seed, 1]))
        self.scanner = VirtualScanner(structure, self.path)

    def mapper(self, knowledge: Knowledge, settings: MapperSettings | None = None) -> StructureMapper:
        """A mapper that knows where the vehicle begins, and nothing else."""
        pose = self.path.pose(0.0)
        slam = replace((settings or MapperSettings()).slam, rate_hz=self.structure.description.navigation.ahrs_hz)
        mount = SensorMount(self.scanner.mount.rotation, self.scanner.mount.offset)
        rng = np.random.default_rng([self._seed, 4])
        return StructureMapper(
            0.0, pose.position, pose.attitude, mount, knowledge, rng, replace(settings or MapperSettings(), slam=slam)
        )

    def events(self, scans: int | None = None) -> Iterator[Event]:
        """Readings and scans in order of time; the first ``scans`` scans only, where given."""
        navigation = navigation_log(self.path, self.structure.description.navigation, np.random.default_rng([self._seed, 2]))
        noise = np.random.default_rng([self._seed, 3])
        times = self.scanner.times()[:scans]
        position = 0
        for time_s in times:
            while position < len(navigation) and navigation[position].time_s <= time_s:
                yield navigation[position]
                position += 1
            yield self.scanner.scan(float(time_s), noise)


def recorded_mapper(
    header: LogHeader, readings: list[NavReading], knowledge: Knowledge, settings: MapperSettings | None = None
) -> StructureMapper:
    """A mapper for a recording: it begins at the log's start, as deep and turned as the first readings say."""
    attitude = next(reading for reading in readings if isinstance(reading, Attitude))
    depth = next((reading.depth for reading in readings if isinstance(reading, Depth)), 0.0)
    mount = mount_at(header.tilt, np.array(header.offset))
    return StructureMapper(
        readings[0].time_s,
        np.array([*header.start, depth]),
        np.array(attitude.angles),
        SensorMount(mount.rotation, mount.offset),
        knowledge,
        np.random.default_rng(0),
        settings,
    )
