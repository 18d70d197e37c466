"""What a structure survey makes of its readings and scans, in their order: the same live and in a replay."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from device.structure.database import shipped_knowledge
from device.structure.in_order import Event
from device.structure.rig import ChamberRig
from device.structure.run import feed
from device.structure.told import consistent, told
from drivers.navigation.readings import Attitude, Depth, Velocity
from drivers.navigation.scans import Scan
from estimators.structure.apart import for_radius
from estimators.structure.graph import StructureMap
from estimators.structure.mapper import MapperSettings, StructureMapper
from estimators.structure.slam import SlamSettings
from estimators.structure.vehicle import SensorMount

BLIND_S = 1.0
"""Without an attitude for so long nobody knows where the scanner looks: its scans are left out."""
ADRIFT_M = 0.15
"""Standard deviation of the position beyond which the operator is told."""
LEAST_SCANS = 10
"""Fewer are no survey: what has been seen once or twice may be anything."""


@dataclass(frozen=True)
class CourseSetup:
    """What is known before: the scanner's mount, the pipes' radius (m), whether they are level or upright only, whether
    depths will come, and the seed of the search for pipes."""

    mount: tuple[tuple[float, ...], ...]
    offset: tuple[float, ...]
    radius_m: float
    upright: bool
    depths: bool
    seed: int = 0

    @classmethod
    def of(cls, rig: ChamberRig, seed: int) -> CourseSetup:
        """For a live survey."""
        mount = tuple(tuple(float(x) for x in row) for row in rig.mount.rotation)
        offset = tuple(float(x) for x in rig.mount.offset)
        return cls(mount, offset, rig.radius_m, rig.upright, "pressure" in rig.navigation, seed)

    @classmethod
    def read(cls, stated: dict[str, Any]) -> CourseSetup:
        """From a recording."""
        mount = tuple(tuple(row) for row in stated["mount"])
        return cls(**{**stated, "mount": mount, "offset": tuple(stated["offset"])})

    def to_json(self) -> dict[str, Any]:
        """As ``read`` takes it back."""
        return asdict(self)


class Course:
    """Takes events in order. Where it begins is north 0, east 0; depth and attitude are those of the first readings."""

    def __init__(self, setup: CourseSetup) -> None:
        self._setup = setup
        self._angles: NDArray[np.float64] | None = None
        self._depth: float | None = None if setup.depths else 0.0
        self._attitude_s = self._velocity_s = float("-inf")
        self._begun_s = 0.0
        self.mapper: StructureMapper | None = None
        self.times: list[float] = []
        self.states: list[NDArray[np.float64]] = []
        self.left_out = 0
        """Scans without an attitude."""

    def take(self, event: Event) -> bool:
        """One reading or scan; True where a scan was mapped."""
        if isinstance(event, Attitude):
            self._attitude_s = event.time_s
        if self.mapper is None:
            self._begin(event)
        if self.mapper is None:
            return False
        if not isinstance(event, Scan):
            if isinstance(event, Velocity) and event.valid:
                self._velocity_s = event.time_s
            feed(self.mapper, event)
            return False
        if event.time_s - self._attitude_s > BLIND_S:
            self.left_out += 1
            return False
        self.mapper.scan(event.time_s, event.points, event.late_s)
        self.times.append(event.time_s - self._begun_s)
        self.states.append(self.mapper.slam.vehicle.copy())
        return True

    @property
    def sigma_m(self) -> float | None:
        """Standard deviation of the position, its worst direction; None before the first readings."""
        if self.mapper is None:
            return None
        return float(np.sqrt(np.linalg.eigvalsh(self.mapper.slam.covariance[:3, :3])[-1]))

    def codes(self) -> list[str]:
        """What the operator should know of the map just now, the weightiest first."""
        if self.mapper is None:
            return []
        codes = []
        if not consistent(self.mapper):
            codes.append("map_contradicted")
        if (self.sigma_m or 0.0) > ADRIFT_M:
            codes.append("adrift")
        return codes

    def found(self) -> tuple[StructureMap | None, dict[str, Any] | None]:
        """The map as it stands and all that is told of it; None before the first scan."""
        if self.mapper is None or not self.times:
            return None, None
        found = self.mapper.result()
        return found, {**told(self.mapper, found, self.times, self.states), "scans_left_out": self.left_out}

    def smooth(self) -> None:
        """No more will come: the whole way and the map once more, from all that was seen."""
        if self.mapper is not None and self.times:
            self.states = self.mapper.smooth()

    def _begin(self, event: Event) -> None:
        if isinstance(event, Attitude) and self._angles is None:
            self._angles = np.array(event.angles)
        elif isinstance(event, Depth) and self._depth is None:
            self._depth = event.depth
        if self._angles is None or self._depth is None:
            return
        setup = self._setup
        settings = MapperSettings(apart=for_radius(setup.radius_m), slam=replace(SlamSettings(), upright=setup.upright))
        self._begun_s = event.time_s
        self.mapper = StructureMapper(
            event.time_s,
            np.array([0.0, 0.0, self._depth]),
            self._angles,
            SensorMount(np.array(setup.mount), np.array(setup.offset)),
            shipped_knowledge(),
            np.random.default_rng([setup.seed, 4]),
            settings,
        )


def verdict(found: dict[str, Any] | None) -> tuple[str, list[str]]:
    """ "accept" or "retry", with the codes of the reasons."""
    if found is None or found["scans"] < LEAST_SCANS:
        return "retry", ["few_scans"]
    if not found["consistent"]:
        return "retry", ["map_contradicted"]
    return ("accept", []) if found["pipes"] else ("retry", ["no_structure"])
