"""Joints of a pipe from the rings of many pictures, and f R from the tether.

A joint at X seen from x has the ring radius rho = f R / (X - x): 1 / rho is linear in x, with one slope for all joints. What is
no joint (the edge of the dark, a stain, a lamp's reflection) keeps its radius while the camera goes on, or has it once. The
one F = f R under which most rings of different pictures fall on common places is the pipe's; refined with the places by robust
least squares.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from estimators.rings.find import Ring

Array = NDArray[np.float64]
Index = NDArray[np.int64]
_RECENT, _FEW = 300, 5
"""Rings that tell the pixels' aspect, the last ones, and how many of them well seen it takes."""
_ALONE = 1.25
"""A ring that is smaller than all others of its joint by this factor is alone."""
_STRETCHES, _SHAKES = 12, 24
"""Of the bootstrap that tells how sure F is."""


@dataclass(frozen=True)
class JointConfig:
    """How rings become joints. Lengths in the unit of the positions."""

    position_std: float = 0.05
    """Error of a position: the counter's step, and the time between counter and picture."""
    relative_std: float = 0.006
    """Error of a ring's radius that its own std does not know."""
    common_std: float = 0.015
    """Relative error that the radii of all rings of a run share (which edge of a joint shows, the lens): F's sigma has it, as
    no number of sightings tells it."""
    gate: float = 3.0
    fewest: int = 3
    """Sightings of an accepted joint, from different positions."""
    lever: float = 1.25
    """Ratio of the largest to the smallest radius of an accepted joint: what does not grow is none."""
    seen_share: float = 0.4
    """Least share of the positions, between the first and the last of its sightings, at which an accepted joint is seen."""
    leaving: float = 0.7
    """Share of the radius at which joints of a run are usually seen last, up to which every one should have been seen."""
    miss: float = 0.7
    """What a position that it should have been seen from takes away from its evidence, in sightings."""
    evidence: float = 2.5
    """Least evidence of an accepted joint: positions it was seen from, less ``miss`` for each it was not, times the log of how
    much it grew."""
    apart: float = 1 / 250
    """Joints are at least this times F apart, which is a little over a diameter: no pipe is shorter. Of nearer ones the one
    with more evidence stays; the others are its edges, stains around it, or echoes."""
    smallest: float = 10.0
    largest: float = 10000.0
    """Range of F searched (px times unit)."""
    farthest: float = 0.6
    """Largest standard deviation of a place that has a say in the search for F."""


@dataclass(frozen=True)
class JointSighting:
    """One ring as a sighting of a joint: ``place`` is where it puts the joint, with ``std``."""

    frame: int
    position: float
    ring: Ring
    place: float
    std: float


@dataclass(frozen=True)
class JointPlace:
    """One joint: ``chainage`` with ``std``, and what it was seen by."""

    chainage: float
    std: float
    sightings: tuple[JointSighting, ...]

    @property
    def spread(self) -> float:
        """Median distance of what the sightings say from ``chainage``."""
        return float(np.median([abs(sighting.place - self.chainage) for sighting in self.sightings]))


@dataclass(frozen=True)
class FocalRadius:
    """F = sqrt(fx fy) R (px times unit of the positions) with its standard deviation ``sigma``; ``known`` from elsewhere."""

    value: float
    sigma: float
    known: bool = False


@dataclass(frozen=True)
class JointMap:
    """What the rings of a run say: joints in the order of chainage, F or None where the rings do not tell it."""

    joints: tuple[JointPlace, ...]
    focal_radius: FocalRadius | None


class RingMap:
    """Gathers rings frame by frame; ``solve`` may be asked at any time.

    ``known`` is F where it is known: then one sighting places a joint, and F is not sought.
    """

    def __init__(self, known: FocalRadius | None = None, config: JointConfig | None = None) -> None:
        self._known = known
        self._config = config or JointConfig()
        self._seen: list[tuple[int, float, Ring]] = []
        self._visited: list[float] = []

    def __len__(self) -> int:
        return len(self._seen)

    def add(self, frame: int, position: float, rings: Sequence[Ring]) -> None:
        """The rings of one picture taken at ``position``; none is news too."""
        self._visited.append(position)
        self._seen += [(frame, position, ring) for ring in rings]

    @property
    def aspect(self) -> float:
        """fx / fy as the rings show it that were seen best of late; 1 while they are few."""
        told = [
            ring.across / ring.upright
            for _, _, ring in self._seen[-_RECENT:]
            if ring.support > 0.7 and ring.std < 0.01 * ring.radius
        ]
        return float(np.median(told)) if len(told) >= _FEW else 1.0

    def solve(self, last: bool = False) -> JointMap:
        """Joints and F from all rings so far. ``last``: no more will come, and time may be spent on how sure F is."""
        if len(self._seen) < self._config.fewest:
            return JointMap((), self._known)
        seen = _Seen.of(self._seen, self._visited, self._config)
        focal = search_focal_radius(seen, self._config) if self._known is None else self._known.value
        if focal is None:
            return JointMap((), None)
        places = _clusters(seen, focal, self._config)
        focal, sigma, places, owner = _refine(seen, focal, places, self._config, fixed=self._known is not None)
        joints = _joints(seen, self._seen, focal, places, owner, self._config)
        if self._known is not None:
            return JointMap(joints, self._known)
        if last:
            sigma = max(sigma, _shaken_sigma(seen, focal, places, len(joints), self._config, np.random.default_rng(0)))
        sigma = float(np.hypot(sigma, self._config.common_std * focal))
        return JointMap(joints, FocalRadius(focal, sigma) if joints else None)


@dataclass(frozen=True)
class _Seen:
    """All rings as arrays (n,): frame, position, 1 / radius and its standard deviation, weight; and ``visited``, where pictures
    were taken."""

    frame: Index
    position: Array
    inverse: Array
    inverse_std: Array
    weight: Array
    visited: Array

    @staticmethod
    def of(seen: Sequence[tuple[int, float, Ring]], visited: Sequence[float], config: JointConfig) -> _Seen:
        radius = np.array([ring.radius for _, _, ring in seen])
        std = np.hypot([ring.std for _, _, ring in seen], config.relative_std * radius)
        return _Seen(
            np.array([frame for frame, _, _ in seen], np.int64),
            np.array([position for _, position, _ in seen]),
            1 / radius,
            std / radius**2,
            np.array([ring.quality for _, _, ring in seen]),
            np.array(visited),
        )

    def take(self, chosen: Index) -> _Seen:
        """Those of ``chosen`` alone."""
        inverse, std, weight = (values[chosen] for values in (self.inverse, self.inverse_std, self.weight))
        return _Seen(self.frame[chosen], self.position[chosen], inverse, std, weight, self.visited)

    def places(self, focal: float) -> Array:
        """Where each ring puts its joint."""
        return self.position + focal * self.inverse

    def std(self, focal: float, config: JointConfig) -> Array:
        """Standard deviation of ``places``."""
        return np.hypot(config.position_std, focal * self.inverse_std)


def search_focal_radius(seen: _Seen, config: JointConfig, most: int = 700) -> float | None:
    """The F under which pairs of rings from different positions agree best, counted as likelihood against chance; None where no
    F does better than chance."""
    if len(seen.position) > most:  # the strongest and nearest tell most
        best = np.argsort(-seen.weight * np.sqrt(1 / seen.inverse))[:most]
        seen = seen.take(best)
    first, second = np.triu_indices(len(seen.position), 1)
    travel = seen.position[second] - seen.position[first]
    growth = seen.inverse[first] - seen.inverse[second]
    # a pair speaks where the camera moved and the ring grew with it; F = travel / growth
    telling = (np.abs(travel) > 3 * config.position_std) & (travel * growth > 0)
    telling &= np.abs(np.log(seen.inverse[first] / seen.inverse[second])) > 0.1
    if np.count_nonzero(telling) < 3:
        return None
    i, j = first[telling], second[telling]
    travel, growth = np.abs(travel[telling]), np.abs(growth[telling])
    log_focal = np.log(travel / growth)
    spread = np.hypot(np.sqrt(2) * config.position_std / travel, np.hypot(seen.inverse_std[i], seen.inverse_std[j]) / growth)
    good = (spread < 0.15) & (log_focal > np.log(config.smallest)) & (log_focal < np.log(config.largest))
    if np.count_nonzero(good) < 3:
        return None
    # far pairs are many and their rings need not be one joint: what is near in place counts
    reach = np.minimum(travel, 10.0)
    weight = (seen.weight[i] * seen.weight[j] / (1 + reach))[good]
    log_focal, spread = log_focal[good], np.maximum(spread[good], 0.01)
    grid = np.arange(np.log(config.smallest), np.log(config.largest), 0.01)
    density = np.zeros(len(grid))
    for value, width, share in zip(log_focal, spread, weight, strict=True):
        low, high = np.searchsorted(grid, [value - 3 * width, value + 3 * width])
        density[low:high] += share / width * np.exp(-0.5 * ((grid[low:high] - value) / width) ** 2)
    candidates = np.argsort(-density)[:400]
    picked: list[int] = []
    for k in candidates:
        if all(abs(k - other) > 5 for other in picked):
            picked.append(int(k))
        if len(picked) == 12:
            break
    scored = [(_agreement(seen, float(np.exp(grid[k])), config), float(np.exp(grid[k]))) for k in picked]
    score, focal = max(scored)
    return focal if score > 0 else None


def _agreement(seen: _Seen, focal: float, config: JointConfig) -> float:
    """How much better places cluster under ``focal`` than by chance: log-likelihood gain, summed over clusters' rings, of rings
    that grew."""
    std = seen.std(focal, config)
    use = std < config.farthest
    if np.count_nonzero(use) < config.fewest:
        return 0.0
    place, std, weight = seen.places(focal)[use], std[use], seen.weight[use]
    position, frame = seen.position[use], seen.frame[use]
    order = np.argsort(place)
    place, std, weight, position = (values[order] for values in (place, std, weight, position))
    frame = frame[order]
    span = max(float(np.ptp(place)), 1.0)
    density = len(place) / span
    gain = 0.0
    for k in range(len(place)):
        near = np.abs(place - place[k]) < 3 * np.hypot(std, std[k])
        # one ring a frame, from other positions than its own
        near &= np.abs(position - position[k]) > 3 * config.position_std
        if not near.any():
            continue
        width = np.hypot(std[near], std[k])
        likelihood = np.exp(-0.5 * ((place[near] - place[k]) / width) ** 2) / (np.sqrt(2 * np.pi) * width)
        frames = max(len(np.unique(frame[near])), 1)
        per_frame = float((likelihood * weight[near]).sum()) / np.count_nonzero(near) * frames
        gain += weight[k] * max(np.log((per_frame + 1e-9) / max(density, 1e-9)), 0.0)
    return gain


def _clusters(seen: _Seen, focal: float, config: JointConfig) -> Array:
    """Places where rings gather, by mean shift from every ring."""
    place, std = seen.places(focal), seen.std(focal, config)
    found: list[float] = []
    for start in np.argsort(std):
        x = place[start]
        if any(abs(x - other) < 2 * std[start] for other in found) or std[start] > config.farthest:
            continue
        for _ in range(10):
            pull = seen.weight / std**2 * np.exp(-0.5 * ((place - x) / np.hypot(1.5 * std, 1.0 * config.position_std)) ** 2)
            x = float((pull * place).sum() / max(pull.sum(), 1e-12))
        if all(abs(x - other) > 4 * config.position_std for other in found):
            found.append(x)
    return np.sort(np.array(found))


def _refine(seen: _Seen, focal: float, places: Array, config: JointConfig, fixed: bool) -> tuple[float, float, Array, Index]:
    """F and places (m,) by robust least squares: (F, sigma, places, owner), ``owner`` (n,) the place of each ring, or -1.

    A frame gives a joint one ring at most, the one that fits best.
    """
    owner = np.full(len(seen.position), -1, np.int64)
    sigma = 0.0
    for round_ in range(12):
        if len(places) == 0:
            break
        owner = _owners(seen, focal, places, config, loosened=max(1.0, 2.0 - 0.2 * round_))
        member = owner >= 0
        if round_ >= 3:
            evidence = _evidences(seen, focal, places, owner, config)
            kept = _apart(places, evidence, config.apart * focal)
            if not kept.all():
                places = places[kept]
                continue
        if np.count_nonzero(member) < config.fewest:
            break
        std = seen.std(focal, config)[member]
        columns = len(places)
        design = np.zeros((np.count_nonzero(member), columns + 1))
        design[np.arange(len(design)), owner[member]] = 1.0
        design[:, columns] = 0.0 if fixed else -seen.inverse[member]
        # place_k - F / rho = position
        left = (seen.position[member] + focal * seen.inverse[member] - places[owner[member]]) / std
        robust = seen.weight[member] / (1 + (left / 1.5) ** 2) / std**2
        target = seen.position[member] + (focal * seen.inverse[member] if fixed else 0.0)
        normal = (design * robust[:, None]).T @ design + 1e-9 * np.eye(columns + 1)
        solution = np.linalg.solve(normal, (design * robust[:, None]).T @ target)
        places = np.asarray(solution[:columns], np.float64)
        if not fixed:
            focal = float(np.clip(solution[columns], config.smallest, config.largest))
            after = (design @ solution - target) ** 2 * robust
            scale = max(
                float(after.sum()) / max(len(after) - columns - 1, 1) / max(float(np.mean(seen.weight[member])), 1e-9), 1.0
            )
            sigma = float(np.sqrt(scale * np.linalg.inv(normal)[columns, columns]))
    return focal, sigma, places, owner


def _shaken_sigma(
    seen: _Seen, focal: float, places: Array, joints: int, config: JointConfig, rng: np.random.Generator
) -> float:
    """Standard deviation of ``focal`` by a bootstrap over stretches of the way: rings of one joint err alike, and which rings
    are taken for its sightings is part of what may be wrong. 0 where a run is too short for it.

    A few ``joints`` tell their own spread badly: it is as much larger as Student's t asks for, so that two of it hold 95 %.
    """
    low = float(seen.position.min())
    width = max(float(np.ptp(seen.position)) / _STRETCHES, 1e-9)

    def stretch(positions: Array) -> Index:
        return np.clip((positions - low) / width, 0, _STRETCHES - 1).astype(np.int64)

    of_rings, of_visits = stretch(seen.position), stretch(seen.visited)
    told = []
    for _ in range(_SHAKES):
        count = rng.multinomial(_STRETCHES, np.full(_STRETCHES, 1 / _STRETCHES))
        drawn = seen.take(np.flatnonzero(count[of_rings]))
        drawn = replace(drawn, weight=drawn.weight * count[stretch(drawn.position)], visited=seen.visited[count[of_visits] > 0])
        value, sigma, _, _ = _refine(drawn, focal, places, config, fixed=False)
        if sigma > 0:
            told.append(value)
    if len(told) < _SHAKES // 2 or joints < 2:
        return 0.0
    spread = float(np.sqrt(np.mean((np.array(told) - focal) ** 2)))
    return spread * float(np.sqrt(joints / (joints - 1)) * stdtrit(joints - 1, 0.977) / 2)


def _owners(seen: _Seen, focal: float, places: Array, config: JointConfig, loosened: float) -> Index:
    """The nearest place of each ring within the gate, or -1; of the rings of one frame the best for each place."""
    distance = np.abs(seen.places(focal)[:, None] - places[None, :]) / seen.std(focal, config)[:, None]
    owner = np.argmin(distance, axis=1)
    best = distance[np.arange(len(owner)), owner]
    owner = np.where(best < config.gate * loosened, owner, -1)
    merit = np.where(owner >= 0, seen.weight * np.exp(-0.5 * (best / loosened) ** 2), 0)
    for k in np.unique(owner[owner >= 0]):
        mine = np.flatnonzero(owner == k)
        for frame in np.unique(seen.frame[mine]):
            same = mine[seen.frame[mine] == frame]
            owner[same[same != same[np.argmax(merit[same])]]] = -1
    return np.asarray(owner, np.int64)


def _evidences(seen: _Seen, focal: float, places: Array, owner: Index, config: JointConfig) -> Array:
    """Evidence (m,) of each place."""
    return np.array([evidence for evidence, _ in _told(seen, focal, places, owner, config)])


def _told(seen: _Seen, focal: float, places: Array, owner: Index, config: JointConfig) -> list[tuple[float, NDArray[np.bool_]]]:
    """Of each place (m) its evidence, and which of its rings (n,) it has that from."""
    nearest = [float(seen.inverse[owner == k].min()) for k in range(len(places)) if (owner == k).any()]
    usual = float(np.median(nearest)) / config.leaving if nearest else 0.0
    told = []
    for k in range(len(places)):
        mine = owner == k
        # a ring from far behind all others may lie there by chance, and is no reason to ask where the joint was meanwhile
        inverse = np.sort(seen.inverse[mine])
        ends = [*inverse[:-1][inverse[1:] > _ALONE * inverse[:-1]], np.inf]
        parts = [mine & (seen.inverse <= end) for end in ends]
        told.append(
            max(((_evidence(seen, focal, places[k], part, usual, config), part) for part in parts), key=lambda one: one[0])
        )
    return told


def _evidence(seen: _Seen, focal: float, place: float, mine: NDArray[np.bool_], usual: float, config: JointConfig) -> float:
    """Positions from which a joint at ``place`` was seen, less those from which it should have been, times the log of how much
    it grew; 0 for what is no joint.

    ``usual`` is 1 / radius at which joints of this run leave the picture: what vanishes long before was an edge of the dark.
    """
    if np.count_nonzero(mine) < config.fewest:
        return 0.0
    step = 3 * config.position_std
    places = _steps(seen.position[mine], step)
    low, high = seen.inverse[mine].min(), seen.inverse[mine].max()
    growth = float(np.log(high / low))
    inverse = (place - seen.visited) / focal
    could = _steps(seen.visited[(inverse > 0.98 * min(low, max(low / 2, usual))) & (inverse < 1.02 * high)], step)
    if places < config.fewest or growth < np.log(config.lever) or places < config.seen_share * could:
        return 0.0
    return max(places - config.miss * max(could - places, 0), 0.0) * growth


def _apart(places: Array, evidence: Array, least: float) -> NDArray[np.bool_]:
    """Which places (m,) stay: those with the most evidence within ``least``."""
    kept = np.zeros(len(places), bool)
    for k in np.argsort(-evidence):
        kept[k] = evidence[k] > 0 and not (kept & (np.abs(places - places[k]) < least)).any()
    return kept


def _steps(positions: Array, step: float) -> int:
    """How many different positions, counted in steps."""
    return len(np.unique(np.round(positions / step)))


def _joints(
    seen: _Seen, rings: Sequence[tuple[int, float, Ring]], focal: float, places: Array, owner: Index, config: JointConfig
) -> tuple[JointPlace, ...]:
    """The accepted joints."""
    found = []
    place, std = seen.places(focal), seen.std(focal, config)
    for k, (evidence, part) in enumerate(_told(seen, focal, places, owner, config)):
        mine = np.flatnonzero(part)
        if evidence < config.evidence:
            continue
        sightings = tuple(JointSighting(*rings[n], float(place[n]), float(std[n])) for n in mine.tolist())
        # the errors of neighbouring pictures are alike, and so is the counter's
        error = float(np.sqrt(config.position_std**2 / 2 + 1 / (1 / std[mine] ** 2).sum()))
        found.append(JointPlace(float(places[k]), error, sightings))
    return tuple(sorted(found, key=lambda joint: joint.chainage))
