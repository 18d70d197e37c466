"""What lies in a long virtual pipe, and where: connections, deposits, displaced joints, fractures, roots.

Places are in the pipe frame of ``world.py``: chainage along the pipe (m), image angle atan2(y, x) (rad; pi/2 is the invert).
Every kind says its own truth as a ``LandmarkTruth``, and those that stand out of the wall say how far.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

LABELS = ("connection", "deposit", "displaced joint", "fracture", "roots")
"""The classes of the CCTV paper's Table II."""


@dataclass(frozen=True)
class LandmarkTruth:
    """One landmark as it is: ``chainage`` to ``chainage_to`` (m) along the pipe and ``angle`` to ``angle_to`` (rad) around it,
    clockwise as seen along the inspection; both ends are the same for a thing without extent. ``id`` counts along the pipe."""

    id: int
    label: str
    chainage: float
    chainage_to: float
    angle: float
    angle_to: float

    @property
    def centre(self) -> tuple[float, float]:
        """Chainage (m) and image angle (rad) of its middle."""
        return (self.chainage + self.chainage_to) / 2, (self.angle + self.angle_to) / 2


@dataclass(frozen=True)
class Connection:
    """A lateral of interior ``diameter`` (m) whose axis meets the wall at ``chainage`` and ``angle``."""

    chainage: float
    angle: float
    diameter: float = 0.15
    label: str = field(default="connection", init=False)

    def reach(self, radius: float) -> tuple[float, float, float, float]:
        """Chainage from, to, angle from, to of what it covers in a pipe of ``radius``."""
        half = self.diameter / 2
        wide = math.asin(min(half / radius, 1.0))
        return self.chainage - half, self.chainage + half, self.angle - wide, self.angle + wide

    def truth(self, radius: float) -> tuple[float, float, float, float]:
        """Its place as an operator states it: one point, the middle."""
        return self.chainage, self.chainage, self.angle, self.angle


@dataclass(frozen=True)
class Patch:
    """A deposit from ``start`` to ``end`` (m), ``spread`` (rad) to either side of ``angle``, ``height`` (m) thick at most;
    wall that is lost has a negative one."""

    start: float
    end: float
    angle: float = math.pi / 2
    spread: float = 0.5
    height: float = 0.02
    label: str = field(default="deposit", init=False)

    def reach(self, radius: float) -> tuple[float, float, float, float]:
        """Chainage from, to, angle from, to of what it covers."""
        return self.start, self.end, self.angle - self.spread, self.angle + self.spread

    truth = reach


@dataclass(frozen=True)
class DisplacedJoint:
    """At ``chainage`` the next pipe stands in by ``step`` (m) at ``angle``, and out at the other side."""

    chainage: float
    angle: float
    step: float = 0.015
    label: str = field(default="displaced joint", init=False)

    def reach(self, radius: float) -> tuple[float, float, float, float]:
        """Chainage from, to, angle from, to of the crescent that is seen of it."""
        return self.chainage, self.chainage, self.angle - math.pi / 4, self.angle + math.pi / 4

    truth = reach


@dataclass(frozen=True)
class Fracture:
    """A crack from ``start`` to ``end`` (m) that wanders from ``angle`` to ``angle_to`` (rad)."""

    start: float
    end: float
    angle: float
    angle_to: float
    label: str = field(default="fracture", init=False)

    def reach(self, radius: float) -> tuple[float, float, float, float]:
        """Chainage from, to, angle from, to of what it covers."""
        return self.start, self.end, min(self.angle, self.angle_to), max(self.angle, self.angle_to)

    truth = reach


@dataclass(frozen=True)
class Roots:
    """Fibres that grow in at the joint at ``chainage``, ``spread`` (rad) to either side of ``angle``, ``length`` (m) long."""

    chainage: float
    angle: float
    spread: float = 0.4
    length: float = 0.08
    fibres: int = 40
    label: str = field(default="roots", init=False)

    def reach(self, radius: float) -> tuple[float, float, float, float]:
        """Chainage from, to, angle from, to of where they come in."""
        return self.chainage, self.chainage, self.angle - self.spread, self.angle + self.spread

    truth = reach


Thing = Connection | Patch | DisplacedJoint | Fracture | Roots


def truths(things: tuple[Thing, ...], radius: float) -> tuple[LandmarkTruth, ...]:
    """The truth of all ``things`` of a pipe of ``radius`` (m), numbered along the pipe."""
    ordered = sorted(things, key=lambda thing: thing.truth(radius)[0])
    return tuple(LandmarkTruth(number, thing.label, *thing.truth(radius)) for number, thing in enumerate(ordered))
