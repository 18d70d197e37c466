"""How the crawler goes through the virtual sewer: its way, the camera on it, the tether behind it, and the truth of it all.

Everything is a function of the time since the start of the drive, so that camera, encoder and truth agree whoever asks, in
whatever order. The crawler runs along the pipe's axis: the focus of expansion is the axis as the tilted camera sees it. How
the camera sways is a function of the way gone, so that the picture stands when the crawler does.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from drivers.virtual.camera import CctvCamera
from drivers.virtual.furnish import furnished_sewer
from drivers.virtual.landmarks import LandmarkTruth
from drivers.virtual.look import Look, random_look
from drivers.virtual.profile import circular
from drivers.virtual.rig import Pose
from drivers.virtual.world import Joint, VirtualSewer

Array = NDArray[np.float64]
ACCELERATION = 0.25
"""Of the crawler when it starts and stops (m/s2)."""
_PULL_S = 1.5
"""How long a pull at the tether of a standing crawler takes."""


@dataclass(frozen=True)
class Go:
    """Drive to chainage ``to`` (m) at ``speed`` (m/s), forwards or back."""

    to: float
    speed: float = 0.2


@dataclass(frozen=True)
class Halt:
    """Stand for ``seconds``."""

    seconds: float


@dataclass(frozen=True)
class Slip:
    """From ``at_s`` on the counter misses the next ``metres`` of way; where they are negative, the tether is pulled past the
    counter by as much while the crawler may stand."""

    at_s: float
    metres: float = 0.3


@dataclass(frozen=True)
class Jump:
    """At ``at_s`` the counter falls back by ``metres``."""

    at_s: float
    metres: float


@dataclass(frozen=True)
class Tether:
    """What is wrong with the counter: ``scale`` 1.02 counts 2 % too much, ``quantum`` (m) is its step, 0 for none."""

    scale: float = 1.0
    slips: tuple[Slip, ...] = ()
    jumps: tuple[Jump, ...] = ()
    quantum: float = 0.1


@dataclass(frozen=True)
class Wander:
    """How the camera sits on the crawler.

    ``centre_px`` is the mean distance of the focus of expansion from the middle of the picture over a drive (CCTV paper,
    Table I: 32.74 px); ``jitter_px`` how much of that comes and goes within a metre. ``roll`` (rad) and ``offset`` (share of
    the pipe's radius) are standard deviations, ``down`` is the mean offset downwards, a share too.
    """

    centre_px: float = 32.74
    jitter_px: float = 0.6
    roll: float = 0.015
    offset: float = 0.05
    down: float = 0.08


@dataclass(frozen=True)
class View:
    """Where the camera is, in the terms of ``estimators.landmarks.projection.View``: ``position`` along the pipe (m),
    ``centre`` the focus of expansion (px), ``axis`` the pipe's axis as seen from the camera, right and down (m)."""

    position: float
    centre: tuple[float, float]
    axis: tuple[float, float]


@dataclass(frozen=True)
class Truth:
    """What is so, whatever the sensors say."""

    drive: Drive = field(repr=False)

    @property
    def landmarks(self) -> tuple[LandmarkTruth, ...]:
        """In the order of chainage."""
        return self.drive.sewer.landmarks

    @property
    def joints(self) -> tuple[float, ...]:
        """Their chainages (m)."""
        return tuple(joint.chainage for joint in self.drive.sewer.joints)

    def chainage(self, t: float) -> float:
        """Of the camera (m)."""
        return float(self.drive.position(t))

    def speed(self, t: float) -> float:
        """Along the pipe (m/s), negative backwards."""
        return float(self.drive.velocity(t))

    def focus_of_expansion(self, t: float) -> tuple[float, float]:
        """(u, v) of the pipe's axis at infinity, which is where the crawler goes."""
        return self.drive.camera.vanishing_point(self.drive.pose(t))

    def view(self, t: float) -> View:
        """Where the camera is."""
        pose = self.drive.pose(t)
        return View(pose.chainage, self.focus_of_expansion(t), (-pose.right, -pose.down))


class Drive:
    """One inspection: ``legs`` driven from chainage ``start`` (m) in ``sewer``; every call takes seconds since its start."""

    def __init__(
        self,
        sewer: VirtualSewer,
        legs: Sequence[Go | Halt],
        start: float = 0.0,
        camera: CctvCamera | None = None,
        wander: Wander | None = None,
        tether: Tether | None = None,
        seed: int = 1,
        look: Look | None = None,
    ) -> None:
        self.sewer, self.start, self.seed, self.look = sewer, start, seed, look or Look()
        self.camera, self.wander, self.tether = camera or CctvCamera(), wander or Wander(), tether or Tether()
        self._knots = _knots(legs, start)
        self.length_s = float(self._knots.time[-1])
        self.way_m = float(self._knots.way[-1])
        self._sway = _Sway(max(self.way_m, 1.0), sewer.radius, self.camera, self.wander, np.random.default_rng([seed, 31]))

    @property
    def truth(self) -> Truth:
        """What is so."""
        return Truth(self)

    @property
    def quantum(self) -> float:
        """Step (m) of what ``encoder`` shows, 0 for none."""
        return self.tether.quantum

    def position(self, t: float | Array) -> Array:
        """Chainage of the camera (m) at ``t``, any shape."""
        return self._knots.position(np.asarray(t, float))

    def velocity(self, t: float | Array) -> Array:
        """Along the pipe (m/s) at ``t``, any shape."""
        return self._knots.velocity(np.asarray(t, float))

    def way(self, t: float | Array) -> Array:
        """Metres gone, forwards and back, until ``t``, any shape."""
        return self._knots.gone(np.asarray(t, float))

    def pose(self, t: float) -> Pose:
        """Of the camera in the pipe frame."""
        right, down, yaw, pitch, roll = self._sway.at(float(self.way(t)))
        return Pose(right, down, float(self.position(t)), yaw, pitch, roll)

    def encoder(self, t: float) -> float:
        """Metres that the tether's counter shows: the truth with scale error, slips, jumps and steps."""
        counted = float(self.position(t)) * self.tether.scale
        for slip in self.tether.slips:
            counted -= self._missed(slip, t)
        counted -= sum(jump.metres for jump in self.tether.jumps if t >= jump.at_s)
        quantum = self.tether.quantum
        return math.floor(counted / quantum + 1e-9) * quantum if quantum > 0 else counted

    def _missed(self, slip: Slip, t: float) -> float:
        if t <= slip.at_s:
            return 0.0
        if slip.metres < 0:
            return slip.metres * min((t - slip.at_s) / _PULL_S, 1.0)
        begin, end = float(self.way(slip.at_s)), float(self.way(t))
        share = min(end - begin, slip.metres)
        # what was missed is the way between two places on it, forwards or back
        return float(self._knots.place(begin + share) - self._knots.place(begin)) * self.tether.scale


@dataclass(frozen=True)
class _Knots:
    """Where the acceleration changes: arrays (n,) of ``time``, chainage ``x``, velocity ``v``, acceleration ``a`` from there,
    and ``way`` gone."""

    time: Array
    x: Array
    v: Array
    a: Array
    way: Array

    def position(self, t: Array) -> Array:
        i, dt = self._within(t)
        return np.asarray(self.x[i] + self.v[i] * dt + self.a[i] / 2 * dt * dt)

    def velocity(self, t: Array) -> Array:
        i, dt = self._within(t)
        return np.asarray(self.v[i] + self.a[i] * dt)

    def gone(self, t: Array) -> Array:
        i, dt = self._within(t)
        return np.asarray(self.way[i] + np.abs(self.v[i] * dt + self.a[i] / 2 * dt * dt))

    def place(self, way: float) -> float:
        """Chainage after so much way."""
        return float(np.interp(way, *self._turns))

    @cached_property
    def _turns(self) -> tuple[Array, Array]:
        """Way and chainage where the crawler may turn; between two knots the one is as long as the other."""
        return self.way, self.x

    def _within(self, t: Array) -> tuple[NDArray[np.intp], Array]:
        t = np.clip(t, 0.0, self.time[-1])
        i = np.clip(np.searchsorted(self.time, t, side="right") - 1, 0, len(self.time) - 1)
        return i, t - self.time[i]


def _knots(legs: Sequence[Go | Halt], start: float) -> _Knots:
    """Every leg speeds up, drives and brakes, or stands."""
    time, x, way = 0.0, start, 0.0
    rows: list[tuple[float, float, float, float, float]] = []
    for leg in legs:
        if isinstance(leg, Halt):
            rows.append((time, x, 0.0, 0.0, way))
            time += leg.seconds
            continue
        if not leg.speed > 0:
            raise ValueError(f"a crawler drives faster than 0 m/s, not at {leg.speed}")
        distance, sign = abs(leg.to - x), math.copysign(1.0, leg.to - x)
        peak = min(leg.speed, math.sqrt(ACCELERATION * distance))
        if peak <= 0:
            continue
        ramp_s, ramp_m = peak / ACCELERATION, peak * peak / ACCELERATION / 2
        cruise_s = (distance - 2 * ramp_m) / peak
        rows.append((time, x, 0.0, sign * ACCELERATION, way))
        rows.append((time + ramp_s, x + sign * ramp_m, sign * peak, 0.0, way + ramp_m))
        brake = distance - ramp_m
        rows.append((time + ramp_s + cruise_s, x + sign * brake, sign * peak, -sign * ACCELERATION, way + brake))
        time, x, way = time + 2 * ramp_s + cruise_s, leg.to, way + distance
    rows.append((time, x, 0.0, 0.0, way))
    return _Knots(*np.array(rows).T)


class _Sway:
    """Smooth curves over the way gone that come back to where they began, so that a drive can loop without a jolt."""

    def __init__(self, way: float, radius: float, camera: CctvCamera, wander: Wander, rng: np.random.Generator) -> None:
        self._way = way
        side, down = (_Curve(way, (20.0, 60.0), 2, rng) for _ in range(2))
        roll = _Curve(way, (4.0, 20.0), 3, rng)
        slow = [_Curve(way, (5.0, 25.0), 4, rng) for _ in range(2)]
        quick = [_Curve(way, (0.5, 1.2), 3, rng) for _ in range(2)]
        mount = rng.normal(0.0, 1.0, 2)
        samples = np.linspace(0, way, 2000, endpoint=False)
        drift = np.stack([0.9 * float(m) + curve(samples) for m, curve in zip(mount, slow, strict=True)])
        jitter = np.stack([wander.jitter_px * curve(samples) for curve in quick])
        share = _scale_to(wander.centre_px, drift, jitter)
        self._offset = (side, down, wander.offset * radius, wander.down * radius)
        self._roll = (roll, wander.roll)
        self._angles = [
            (curve, fast, share * 0.9 * float(m), share, wander.jitter_px, focal)
            for curve, fast, m, focal in zip(slow, quick, mount, (camera.fx, camera.fy), strict=True)
        ]

    def at(self, way: float) -> tuple[float, float, float, float, float]:
        """right, down (m), yaw, pitch, roll (rad)."""
        side, down, spread, low = self._offset
        # a camera that looks to the right sees the axis at its left
        yaw, pitch = (
            -math.atan((mean + share * float(slow(way)) + quick_px * float(fast(way))) / focal)
            for slow, fast, mean, share, quick_px, focal in self._angles
        )
        roll, amount = self._roll
        return spread * float(side(way)), low + spread * float(down(way)), yaw, pitch, amount * float(roll(way))


def _scale_to(wanted: float, drift: Array, jitter: Array) -> float:
    """Factor on ``drift`` (2, n) so that |drift + jitter| is ``wanted`` on average."""
    factor = 0.0 if wanted <= 0 else wanted / float(np.mean(np.hypot(*drift)))
    for _ in range(20 if factor else 0):
        factor *= wanted / float(np.mean(np.hypot(*(factor * drift + jitter))))
    return factor


class _Curve:
    """A sum of waves of random phase, of standard deviation 1, with lengths about ``lengths`` (m) that go into ``way``."""

    def __init__(self, way: float, lengths: tuple[float, float], waves: int, rng: np.random.Generator) -> None:
        wanted = np.exp(rng.uniform(math.log(lengths[0]), math.log(lengths[1]), waves))
        self._number = 2 * np.pi / way * np.maximum(np.round(way / wanted), 1.0)
        self._phase = rng.uniform(0, 2 * np.pi, waves)
        weight = rng.uniform(0.5, 1.0, waves)
        self._weight = weight / np.sqrt((weight**2).sum() / 2)

    def __call__(self, way: float | Array) -> Array:
        return np.asarray(np.sin(np.multiply.outer(way, self._number) + self._phase) @ self._weight)


def straight_drive(seed: int, length: float = 25.0, diameter: float = 0.3, centre_px: float = Wander().centre_px) -> Drive:
    """Through a pipe of ``diameter`` and ``length`` (m) with nothing in it but its joints, with a halt on the way, and a piece
    back: what focus of expansion, flow and rings are tried on. ``centre_px`` as in ``Wander``."""
    rng = np.random.default_rng([seed, 32])
    spacing, first = float(rng.uniform(1.0, 2.5)), float(rng.uniform(0.6, 1.6))
    joints = tuple(Joint(float(z), 0.02) for z in np.arange(first, length, spacing))
    last = length - 2.0
    speed = float(rng.uniform(0.1, 0.3))
    legs = (
        Go(0.4 * last, speed),
        Halt(float(rng.uniform(2, 5))),
        Go(last, float(rng.uniform(0.1, 0.3))),
        Halt(2.0),
        Go(0.8 * last, speed),
    )
    return Drive(VirtualSewer(circular(diameter), length, joints=joints), legs, 0.0, wander=Wander(centre_px), seed=seed)


def demo_drive(seed: int = 1) -> Drive:
    """Down a pipe of 25 m in which all kinds of landmarks lie, and back: what ``--virtual`` shows. It can loop."""
    rng = np.random.default_rng([seed, 33])
    sewer = furnished_sewer(rng, 25.0, 0.3)
    legs = (Halt(2.0), Go(9.0, 0.25), Halt(3.0), Go(22.5, 0.3), Halt(3.0), Go(0.0, 0.3))
    return Drive(sewer, legs, look=replace(random_look(rng), text=True), seed=seed)
