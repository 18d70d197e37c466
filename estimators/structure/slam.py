"""The filter: vehicle, lines and points in one Gaussian (paper, Sec. 4): prediction, sensor updates, features seen and new."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimators.structure.features import Line, Seen, new_line, new_point, observe_line, observe_point
from estimators.structure.jcbb import Candidate, associate, gate
from estimators.structure.types import Array, Segment, Sighting
from estimators.structure.vehicle import SIZE, SensorMount, SensorPose, advanced, rotation_of, sensor_pose, wrapped


@dataclass(frozen=True)
class SlamSettings:
    """Process noise (1 sigma): ``acceleration`` (m/s2) and ``turning`` (rad/s) as white noise of ``rate_hz``; ``blind`` (rad/s)
    while nothing tells how the vehicle turns. ``start``: of the first position (m), which is the map's origin by definition, so
    hardly any; ``start_depth``: of its depth. ``near_line`` and ``near_point``: what does not fit but is so near (m) to a known
    feature is not new; two objects nearer than ``double`` (m) are one. ``jolt`` (m, m/s): by how much position and velocity are
    doubted when a scan does not fit from where the vehicle should be."""

    acceleration: float = 0.05
    turning: float = 0.005
    blind: float = 0.2
    rate_hz: float = 20.0
    start: float = 0.0005
    start_depth: float = 0.02
    start_velocity: float = 0.2
    near_line: float = 0.10
    near_angle: float = 0.25
    near_point: float = 0.14
    double: float = 0.09
    jolt: tuple[float, float] = (0.15, 0.1)
    gap: float = 0.5
    upright: bool = False
    upright_angle: float = 0.12


@dataclass
class Feature:
    """``line`` or ``point`` at ``at`` in the state; ``sightings`` counts the scans that showed it, ``contradicted`` those that
    showed something beside it and not it. ``low``, ``high``: ends along a line."""

    number: int
    at: int
    line: Line | None
    point: Array | None
    sightings: int = 1
    contradicted: int = 0
    low: float = 0.0
    high: float = 0.0

    @property
    def size(self) -> int:
        """Numbers in the state: 4 of a line, 3 of a point."""
        return 4 if self.line is not None else 3


@dataclass(frozen=True)
class Matches:
    """Number of the feature that each segment and each sighting shows; -1 where none. ``new``: those that began with this scan.
    ``fitting``: how many had a known feature near; ``matched`` of them fitted it together with the others, where navigation had
    the vehicle. ``moved``: how far (m) from there the vehicle is where the scan only ``agrees`` with the map from elsewhere;
    one that agrees from nowhere is left out. ``dropped``: features that turned out to be a mistake; ``beside``: how many
    observations fitted none of the known features that they were near.
    """

    segments: tuple[int, ...]
    sightings: tuple[int, ...]
    new: frozenset[int]
    fitting: int
    matched: int
    agrees: bool = True
    moved: float = 0.0
    dropped: frozenset[int] = frozenset()
    beside: int = 0

    @property
    def expected(self) -> bool:
        """Whether the scan looks as it should from where navigation had the vehicle."""
        return _agree(self.matched, self.fitting, _MOST)


_MOST = 0.5
"""Of what has known features near so much fits them, or the scan does not fit."""
_AGAIN = 0.6
"""From another place more has to fit, for there any scan fits something."""
_FEW = 3
"""So few observations near known features tell nothing of a scan."""
_CONFIRMED = 3
"""So many scans in a row must look as they should before anything new is taken in after one that did not: what is seen from a
place that is in doubt would become a second layer of the map."""
_DROP_AFTER = 3
"""A feature that was contradicted so often, and more often than it was seen, is dropped."""


def _agree(matched: int, fitting: int, share: float) -> bool:
    return fitting < _FEW or matched >= share * fitting


@dataclass(frozen=True)
class _Joint:
    """The chosen pairs of observation and feature, their rows stacked."""

    chosen: list[Candidate]
    jacobian: Array
    innovation: Array
    noise: Array


class StructureFilter:
    """EKF SLAM. ``position`` (3,) is where the vehicle begins, ``angles`` (3,) how it stands."""

    def __init__(self, position: Array, angles: Array, mount: SensorMount, settings: SlamSettings | None = None) -> None:
        self.settings = settings or SlamSettings()
        self.mount = mount
        self.vehicle = np.concatenate([position, angles, np.zeros(3)])
        s = self.settings
        self.covariance = np.diag(np.repeat([s.start, 0.05, s.start_velocity], 3) ** 2)
        self.covariance[2, 2] = s.start_depth**2
        self.features: dict[int, Feature] = {}
        self._next = 1
        self._to_confirm = 0

    # ---- navigation

    def predict(self, dt: float, rates: Array | None) -> None:
        """Eqs. 20 to 22: ``dt`` seconds on, turning by ``rates`` (3,) of roll, pitch and yaw, or by nobody knows what."""
        if dt <= 0:
            return
        s = self.settings
        turning = s.blind if rates is None else s.turning
        self.vehicle, by_state, by_noise = advanced(self.vehicle, np.zeros(3) if rates is None else rates, dt)
        # white noise of a fixed rate, so that steps of any length add up to the same
        noise = np.repeat([s.acceleration, turning], 3) ** 2 / (s.rate_hz * dt)
        p = self.covariance
        p[:SIZE, :] = by_state @ p[:SIZE, :]
        p[:, :SIZE] = p[:, :SIZE] @ by_state.T
        p[:SIZE, :SIZE] += (by_noise * noise) @ by_noise.T

    def depth(self, depth: float, sigma: float) -> bool:
        """Eqs. 24 and 25. False where it does not fit and was left out."""
        return self._direct(np.array([2]), np.array([depth]) - self.vehicle[2:3], sigma)

    def attitude(self, angles: Array, sigma: float) -> bool:
        """Eqs. 26 and 27."""
        return self._direct(np.arange(3, 6), wrapped(angles - self.vehicle[3:6]), sigma)

    def velocity(self, velocity: Array, sigma: float) -> bool:
        """Eqs. 28 and 29."""
        return self._direct(np.arange(6, 9), velocity - self.vehicle[6:9], sigma)

    def _direct(self, rows: np.ndarray, innovation: Array, sigma: float) -> bool:
        p = self.covariance
        s = p[np.ix_(rows, rows)] + np.eye(len(rows)) * sigma**2
        if float(innovation @ np.linalg.solve(s, innovation)) > gate(len(rows), 0.99999):
            return False
        gain = np.linalg.solve(s, p[rows, :]).T
        self._add(gain @ innovation)
        self.covariance = p - gain @ p[rows, :]
        return True

    def doubt(self, rows: slice, sigma: float) -> None:
        """Be less sure of a part of the vehicle's state: what contradicts it again and again may be right."""
        self.covariance[rows, rows] += np.eye(rows.stop - rows.start) * sigma**2

    def doubt_velocity(self, sigma: float, since_s: float, unheard: Array) -> None:
        """The same of the velocity, which has been another one for ``since_s``: the position has gone wrong with it.

        The next velocity that is taken moves the position too, as if the change had come at once or grown evenly. ``unheard``
        (3,): the way (m, along the body) if it came as early as in an outage before; nothing tells when, so that this way moves
        nothing and is added to the doubt.
        """
        by_change = np.zeros((SIZE, 3))
        by_change[:3] = 0.75 * since_s * rotation_of(self.vehicle[3:6])
        by_change[6:9] = np.eye(3)
        self.covariance[:SIZE, :SIZE] += by_change @ by_change.T * sigma**2
        self.covariance[:3, :3] += np.eye(3) * (sigma * since_s) ** 2 / 12
        missed = rotation_of(self.vehicle[3:6]) @ unheard
        self.covariance[:3, :3] += np.outer(missed, missed) / 3

    # ---- features

    def pose(self) -> SensorPose:
        """Where the sensor is."""
        return sensor_pose(self.vehicle, self.mount)

    def scan(self, segments: tuple[Segment, ...], sightings: tuple[Sighting, ...]) -> Matches:
        """Associate, update, and take in what is new (Sec. 4.5 and 4.6)."""
        pose = self.pose()
        pairs: list[tuple[int, Feature, Seen]] = []
        observations: list[Segment | Sighting] = [*segments, *sightings]
        for number, observation in enumerate(observations):
            for feature in self.features.values():
                seen = self._expected(feature, pose, observation)
                if seen is not None:
                    pairs.append((number, feature, seen))
        fitting = len({number for number, _, _ in pairs})
        joint = self._associated(pairs)
        matched, moved = len(joint.chosen), 0.0
        if _agree(matched, fitting, _MOST):
            if fitting >= _FEW:
                self._to_confirm = max(self._to_confirm - 1, 0)
        else:
            self._to_confirm = _CONFIRMED
            # the vehicle went another way than navigation says, or the scan is wrong: where would most of it fit?
            self.doubt(slice(0, 3), self.settings.jolt[0])
            self.doubt(slice(6, 9), self.settings.jolt[1])
            joint = self._associated(pairs)
            if not _agree(len(joint.chosen), fitting, _AGAIN):
                nothing = (-1,) * len(observations)
                return Matches(nothing[: len(segments)], nothing[len(segments) :], frozenset(), fitting, matched, agrees=False)
        if joint.chosen:
            before = self.vehicle[:3].copy()
            self._update(joint)
            moved = 0.0 if _agree(matched, fitting, _MOST) else float(np.linalg.norm(self.vehicle[:3] - before))
        match = {c.seen: c.feature for c in joint.chosen}
        new, contradicted = self._take_in(segments, sightings, match)
        self._stretch(segments, match)
        count = len(segments)
        for number in set(match.values()) - new:
            self.features[number].sightings += 1
        dropped = self._without_contradicted(contradicted - set(match.values())) | self._without_doubles()
        match = {seen: number for seen, number in match.items() if number not in dropped}
        return Matches(
            tuple(match.get(k, -1) for k in range(count)),
            tuple(match.get(count + k, -1) for k in range(len(sightings))),
            frozenset(new - dropped),
            fitting,
            matched,
            moved=moved,
            beside=fitting - len(joint.chosen),
            dropped=dropped,
        )

    def _expected(self, feature: Feature, pose: SensorPose, observation: Segment | Sighting) -> Seen | None:
        """How ``feature`` should look if ``observation`` shows it; None where they are nowhere near each other."""
        if isinstance(observation, Segment):
            if feature.line is None or not self._near_line(feature, pose, observation, 3.0):
                return None
            return observe_line(feature.line, pose, observation)
        if feature.point is None:
            return None
        seen = observe_point(feature.point, pose, observation.position, observation.covariance)
        return seen if np.linalg.norm(seen.innovation) < 0.6 else None

    def _near_line(self, feature: Feature, pose: SensorPose, segment: Segment, slack: float) -> bool:
        assert feature.line is not None
        line = feature.line
        ends = pose.position + np.array([segment.start, segment.end]) @ pose.rotation.T
        direction = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
        if abs(direction @ line.direction) < np.cos(min(self.settings.near_angle * slack, 0.6)):
            return False
        along = np.sort(line.along(ends))
        if max(along[0], feature.low) - min(along[1], feature.high) > self.settings.gap:
            return False
        middle = ends.mean(axis=0)
        off = middle - line.point
        off -= (off @ line.direction) * line.direction
        return bool(np.linalg.norm(off) < self.settings.near_line * slack)

    def _associated(self, pairs: list[tuple[int, Feature, Seen]]) -> _Joint:
        size = len(self.covariance)
        count = sum(len(seen.innovation) for _, _, seen in pairs)
        jacobian, innovation, noise = np.zeros((count, size)), np.zeros(count), np.zeros((count, count))
        candidates = []
        row = 0
        for number, feature, seen in pairs:
            rows = slice(row, row + len(seen.innovation))
            jacobian[rows, :SIZE] = seen.by_vehicle
            jacobian[rows, feature.at : feature.at + feature.size] = seen.by_feature
            innovation[rows] = seen.innovation
            noise[rows, rows] = seen.noise
            candidates.append(Candidate(number, feature.number, rows))
            row = rows.stop
        if not candidates:
            return _Joint([], jacobian, innovation, noise)
        joint = jacobian @ self.covariance @ jacobian.T + noise
        chosen = associate(candidates, innovation, joint)
        kept = np.concatenate([np.arange(0), *(np.arange(c.rows.start, c.rows.stop) for c in chosen)])
        return _Joint(chosen, jacobian[kept], innovation[kept], noise[np.ix_(kept, kept)])

    def _update(self, joint: _Joint) -> None:
        p = self.covariance
        cross = p @ joint.jacobian.T
        s = joint.jacobian @ cross + joint.noise
        gain = np.linalg.solve(s, cross.T).T
        self._add(gain @ joint.innovation)
        p = p - gain @ cross.T
        self.covariance = (p + p.T) / 2

    def _add(self, error: Array) -> None:
        self.vehicle = self.vehicle + error[:SIZE]
        self.vehicle[3:6] = wrapped(self.vehicle[3:6])
        for feature in self.features.values():
            part = error[feature.at : feature.at + feature.size]
            if feature.line is not None:
                feature.line = feature.line.moved(part)
            elif feature.point is not None:
                feature.point = feature.point + part

    def _take_in(
        self, segments: tuple[Segment, ...], sightings: tuple[Sighting, ...], match: dict[int, int]
    ) -> tuple[set[int], set[int]]:
        """Eqs. 38 to 43 and 45 for what showed nothing known; ``match`` is told of it. Also the features beside which something
        was that did not fit them, and therefore is not new."""
        pose = self.pose()
        new: set[int] = set()
        beside: set[int] = set()
        for number, segment in enumerate(segments):
            if number in match:
                continue
            near = {f.number for f in self.features.values() if f.line is not None and self._near_line(f, pose, segment, 1.0)}
            beside |= near
            if near or self._to_confirm:
                continue
            line, by_vehicle = new_line(pose, segment)
            if self.settings.upright and not self._is_upright(line):
                continue
            feature = self._append(line, None, by_vehicle, segment.covariance)
            feature.low, feature.high = -segment.length / 2, segment.length / 2
            match[number] = feature.number
            new.add(feature.number)
        for number, sighting in enumerate(sightings):
            if len(segments) + number in match:
                continue
            position, by_vehicle = new_point(pose, sighting.position)
            nearest, distance = self.nearest_point(position)
            if distance < self.settings.near_point:
                beside.add(nearest)
                continue
            if self._to_confirm:
                continue
            noise = pose.rotation @ sighting.covariance @ pose.rotation.T
            feature = self._append(None, position, by_vehicle, noise)
            match[len(segments) + number] = feature.number
            new.add(feature.number)
        return new, beside

    def _without_contradicted(self, beside: set[int]) -> frozenset[int]:
        """Count what was beside features and not them; drop those of them that were a mistake when they were taken in, for they
        keep what is really there out of the map. The numbers of what was dropped."""
        dropped = set()
        for number in beside:
            feature = self.features[number]
            feature.contradicted += 1
            if feature.contradicted >= _DROP_AFTER and feature.contradicted > feature.sightings:
                self.drop(number)
                dropped.add(number)
        return frozenset(dropped)

    def _without_doubles(self) -> frozenset[int]:
        """Drop the object seen less often of two that have come nearer to each other than objects can be: the numbers."""
        points = {f.number: f.point for f in self.features.values() if f.point is not None}
        if len(points) < 2:
            return frozenset()
        numbers, places = np.array(list(points)), np.array(list(points.values()))
        apart = np.linalg.norm(places[:, None] - places[None], axis=2)
        dropped = set()
        for i, j in zip(*np.nonzero(np.triu(apart < self.settings.double, 1)), strict=True):
            less = min(int(numbers[i]), int(numbers[j]), key=lambda number: (self.features[number].sightings, -number))
            dropped.add(less)
        for number in dropped:
            self.drop(number)
        return frozenset(dropped)

    def _is_upright(self, line: Line) -> bool:
        """Whether a line is horizontal or vertical, as the paper's prior has it (Sec. 4.5.2)."""
        down = abs(float(line.direction[2]))
        return bool(down < np.sin(self.settings.upright_angle) or down > np.cos(self.settings.upright_angle))

    def nearest_point(self, position: Array) -> tuple[int, float]:
        """Number of the nearest object and its distance; (-1, inf) where there is none."""
        best, least = -1, np.inf
        for feature in self.features.values():
            if feature.point is not None:
                distance = float(np.linalg.norm(feature.point - position))
                if distance < least:
                    best, least = feature.number, distance
        return best, least

    def _append(self, line: Line | None, point: Array | None, by_vehicle: Array, noise: Array) -> Feature:
        p = self.covariance
        size, more = len(p), len(by_vehicle)
        grown = np.zeros((size + more, size + more))
        grown[:size, :size] = p
        grown[size:, :size] = by_vehicle @ p[:SIZE, :]
        grown[:size, size:] = grown[size:, :size].T
        grown[size:, size:] = by_vehicle @ p[:SIZE, :SIZE] @ by_vehicle.T + noise
        self.covariance = grown
        feature = Feature(self._next, size, line, point)
        self.features[self._next] = feature
        self._next += 1
        return feature

    def drop(self, number: int) -> None:
        """Forget a feature."""
        gone = self.features.pop(number)
        keep = np.ones(len(self.covariance), dtype=bool)
        keep[gone.at : gone.at + gone.size] = False
        self.covariance = self.covariance[np.ix_(keep, keep)]
        for feature in self.features.values():
            if feature.at > gone.at:
                feature.at -= gone.size

    def _stretch(self, segments: tuple[Segment, ...], match: dict[int, int]) -> None:
        """The ends of the segments, brought onto their lines (Sec. 4.5): how far each line is known to go."""
        pose = self.pose()
        for number, segment in enumerate(segments):
            feature = self.features.get(match.get(number, -1))
            if feature is None or feature.line is None:
                continue
            along = feature.line.along(pose.position + np.array([segment.start, segment.end]) @ pose.rotation.T)
            feature.low, feature.high = min(feature.low, *along), max(feature.high, *along)

    def volume(self, number: int) -> float:
        """Logarithm of the product of the eigenvalues of a feature's covariance (Sec. 5.2, Figs. 11 and 12)."""
        feature = self.features[number]
        part = self.covariance[feature.at : feature.at + feature.size, feature.at : feature.at + feature.size]
        return float(np.log(np.maximum(np.linalg.eigvalsh(part), 1e-300)).sum())
