"""The box of ``borescout serve --virtual``: what pipe it looks into, where it hangs, and the file that can say otherwise."""

from __future__ import annotations

import json
import math
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from drivers.base import DriverError
from drivers.virtual.faults import FAULTS, Fault
from drivers.virtual.noise import StereoNoise, Window
from drivers.virtual.profile import PipeProfile, circular, dented, egg, oval
from drivers.virtual.rig import HandMotion, Pose, sway
from drivers.virtual.world import Deposit, Joint, VirtualSewer

HANDS = {
    "none": HandMotion(0.0, 0.0),
    "steady": HandMotion(0.0015, 0.003, 25.0),
    "shaky": HandMotion(0.008, 0.02, 12.0),
}
SHAPES = ("circular", "egg", "oval", "dented")
POSITIONS = ("top", "middle")
_BOX_M = 0.06
"""Nearest that the camera's eye comes to a wall: half the box."""
_SWAY_HZ = 30.0
_LOWERING_S = 6.0
_MOVE_S = 4.0


class DescriptionBroken(DriverError):
    """The file that describes a virtual sewer cannot be used."""


@dataclass(frozen=True)
class Description:
    """A virtual sewer and the box in it, as the JSON file names it: one object with these fields, all optional.

    ``height_mm`` is an oval's, ``dent_mm`` how far a dented pipe is pressed in at its crown. ``tilt_deg`` turns the box to the
    right. ``position`` "top" hangs below the crown, "middle" on the axis; None moves from one to the other every ``stay_s``
    seconds, as an operator does who is asked for the second position. ``lowering`` begins outside, before the chamber wall.
    ``light`` is 1 with the emitter on, 0.4 in poor light. ``smears`` are dirt on the window as [x, y, radius] in shares of the
    picture's width. ``faults`` are those of ``drivers.virtual.faults``.
    """

    shape: str = "circular"
    diameter_mm: float = 300.0
    height_mm: float = 0.0
    dent_mm: float = 0.0
    length_m: float = 6.0
    water_mm: float = 25.0
    deposit_mm: float = 0.0
    deposit_from_m: float = 0.6
    deposit_to_m: float = 1.4
    joint_every_m: float = 1.0
    position: str | None = None
    stay_s: float = 90.0
    lowering: bool = False
    tilt_deg: float = 2.0
    hand: str = "steady"
    light: float = 1.0
    speckles: float = 60.0
    scale_percent: float = 0.0
    smears: tuple[tuple[float, float, float], ...] = ()
    faults: tuple[Fault, ...] = ()

    def __post_init__(self) -> None:
        for name, allowed in (("shape", SHAPES), ("hand", tuple(HANDS)), ("position", (*POSITIONS, None))):
            if getattr(self, name) not in allowed:
                raise ValueError(f"{name} must be one of {', '.join(str(one) for one in allowed)}")
        for name, least, most in (
            ("diameter_mm", 150, 1100),
            ("height_mm", 0, 1650),
            ("dent_mm", 0, 0.3 * self.diameter_mm),
            ("length_m", 0.3, 100),
            ("water_mm", 0, 0.5 * self.diameter_mm),
            ("deposit_mm", 0, 0.4 * self.diameter_mm),
            ("joint_every_m", 0, 100),
            ("stay_s", 1, 86400),
            ("tilt_deg", -30, 30),
            ("light", 0, 2),
            ("speckles", 0, 5000),
            ("scale_percent", -5, 5),
        ):
            if not least <= getattr(self, name) <= most:
                raise ValueError(f"{name} must be between {least:g} and {most:g}")

    @property
    def profile(self) -> PipeProfile:
        """The cross-section."""
        width = self.diameter_mm / 1000
        if self.shape == "egg":
            return egg(width)
        if self.shape == "oval":
            return oval(width, (self.height_mm or 0.95 * self.diameter_mm) / 1000)
        if self.shape == "dented":
            return dented(width, (self.dent_mm or 0.05 * self.diameter_mm) / 1000, -np.pi / 2)
        return circular(width)

    def sewer(self) -> VirtualSewer:
        """What the cameras look into."""
        chainages = np.arange(0.45, min(self.length_m, 8.0), max(self.joint_every_m, 0.1)) if self.joint_every_m > 0 else ()
        joints = tuple(Joint(float(chainage), 0.02, 0.01) for chainage in chainages)
        bed = Deposit(self.deposit_from_m, self.deposit_to_m, self.deposit_mm / 1000) if self.deposit_mm > 0 else None
        return VirtualSewer(self.profile, self.length_m, self.water_mm / 1000, bed, joints)

    def noise(self) -> StereoNoise:
        """Of the stereo camera."""
        return StereoNoise(light=self.light, speckles=self.speckles)

    def window(self) -> Window:
        """In front of every camera."""
        return Window(self.scale_percent / 100, self.smears)

    def pose(self, position: str) -> Pose:
        """Where the box hangs, clear of walls and water."""
        profile = self.profile
        room = max(min(profile.radii) - _BOX_M, 0.0)
        surface = profile.below() - self.water_mm / 1000 - _BOX_M
        down = min(-0.7 * room if position == "top" else 0.0, max(surface, -room))
        return Pose(0.1 * room, down, 0.12 if position == "middle" else 0.04, math.radians(self.tilt_deg))


def read_description(file: Path) -> Description:
    """A Description from a JSON file. Raises DescriptionBroken with one sentence."""
    try:
        found = json.loads(file.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise DescriptionBroken(f"There is no file {file}.") from None
    except (OSError, UnicodeDecodeError) as error:
        raise DescriptionBroken(f"The file {file} cannot be read: {error}.") from error
    except (ValueError, RecursionError) as error:
        raise DescriptionBroken(f"The file {file} is not JSON: {error}.") from error
    if not isinstance(found, dict):
        raise DescriptionBroken(f"The file {file} holds no JSON object.")
    try:
        return _description(found)
    except (ValueError, TypeError) as error:
        raise DescriptionBroken(f"The file {file} describes no virtual sewer: {error}.") from error


def _description(found: Mapping[str, Any]) -> Description:
    known = {field.name: field.default for field in fields(Description)}
    values: dict[str, Any] = {}
    for name, value in found.items():
        if name not in known:
            raise ValueError(f"there is no field {name}, known are {', '.join(known)}")
        default = known[name]
        if name == "faults":
            value = tuple(_fault(one) for one in _listed(name, value))
        elif name == "smears":
            value = tuple(_smear(one) for one in _listed(name, value))
        elif isinstance(default, float):
            value = _number(name, value)
        elif not isinstance(value, bool if isinstance(default, bool) else str) and not (name == "position" and value is None):
            raise ValueError(f"{name} must be {'true or false' if isinstance(default, bool) else 'text'}")
        values[name] = value
    return Description(**values)


def _fault(found: Any) -> Fault:
    if not isinstance(found, dict) or not isinstance(found.get("name"), str):
        raise ValueError("a fault is an object with a name")
    unknown = set(found) - {"name", "at_s", "for_s", "cure"}
    if unknown:
        raise ValueError(f"a fault has no field {sorted(unknown)[0]}")
    if found["name"] not in FAULTS:
        raise ValueError(f"there is no fault {found['name']!r}, known are {', '.join(FAULTS)}")
    times = {key: _number(key, found[key]) for key in ("at_s", "for_s") if key in found}
    return Fault(found["name"], **times, cure=str(found.get("cure", "none")))


def _smear(found: Any) -> tuple[float, float, float]:
    x, y, radius = (_number("a smear", value) for value in _listed("a smear", found, 3))
    if not (0 <= x <= 1 and 0 <= y <= 1 and 0 < radius <= 0.5):
        raise ValueError("a smear is [x, y, radius] in shares of the picture's width, the radius at most 0.5")
    return x, y, radius


def _listed(name: str, value: Any, length: int | None = None) -> list[Any]:
    if not isinstance(value, list) or length not in (None, len(value)):
        raise ValueError(f"{name} must be a list" + (f" of {length} numbers" if length else ""))
    return value


def _number(name: str, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < 1e9:
        raise ValueError(f"{name} must be a number")
    return float(value)


class DemoRig:
    """Where the box is at every moment. Any thread may ask; all cameras of one box share one rig.

    It hangs at the description's position, or moves between both; ``move`` takes it to one and leaves it there. A hand holds
    the rod, so it never hangs quite still.
    """

    def __init__(self, description: Description, seed: int = 1, clock: Callable[[], float] = time.monotonic) -> None:
        self._description = description
        self._clock = clock
        self._lock = threading.Lock()
        self._poses = {position: description.pose(position) for position in POSITIONS}
        self._sway: Iterator[Pose] = sway(Pose(), HANDS[description.hand], np.random.default_rng([seed, 5]))
        self._swayed = (next(self._sway), next(self._sway))
        self._ticks = 0
        self._began: float | None = None
        self._asked: tuple[str, str, float] | None = None

    def begin(self) -> None:
        """The first camera is started: the box is let down."""
        with self._lock:
            self._began = self._clock() if self._began is None else self._began

    def move(self, position: str) -> None:
        """Take the box to "top" or "middle" and leave it there. Raises ValueError for another place."""
        if position not in POSITIONS:
            raise ValueError(f"the box goes to {' or '.join(POSITIONS)}, not to {position}")
        with self._lock:
            elapsed = self._elapsed()
            self._asked = (self._place(elapsed)[1], position, elapsed)

    def pose(self) -> Pose:
        """Now."""
        with self._lock:
            elapsed = self._elapsed()
            before, after, share = self._place(elapsed)
            rest = _between(self._poses[before], self._poses[after], share)
            if self._description.lowering and elapsed < 2 * _LOWERING_S:
                rest = self._on_the_way_in(rest, elapsed)
            return _plus(rest, self._hand(elapsed))

    def _elapsed(self) -> float:
        return 0.0 if self._began is None else self._clock() - self._began

    def _place(self, elapsed: float) -> tuple[str, str, float]:
        """(from, to, share of the way)."""
        if self._asked is not None:
            before, after, since = self._asked
            return before, after, min((elapsed - since) / _MOVE_S, 1.0)
        if self._description.position is not None:
            return self._description.position, self._description.position, 1.0
        stay = self._description.stay_s
        stays, since_move = divmod(elapsed, stay + _MOVE_S)
        here, there = (POSITIONS[(int(stays) + k) % 2] for k in (0, 1))
        return here, there, max(since_move - stay, 0.0) / _MOVE_S

    def _on_the_way_in(self, rest: Pose, elapsed: float) -> Pose:
        """From above the mouth, swinging before the chamber wall, down to it, and in."""
        above = replace(rest, down=-0.9 - max(self._description.profile.radii), chainage=-0.35, yaw=rest.yaw + 0.1)
        before = replace(rest, chainage=-0.35)
        swing = 0.08 * math.exp(-elapsed / 5) * math.sin(2 * math.pi * elapsed / 2.2)
        if elapsed < _LOWERING_S:
            pose = _between(above, before, elapsed / _LOWERING_S)
        else:
            pose = _between(before, rest, elapsed / _LOWERING_S - 1)
        return replace(pose, right=pose.right + swing, roll=pose.roll + swing)

    def _hand(self, elapsed: float) -> Pose:
        # a rig nobody looked at for a while has no need to catch up on every twitch
        ticks = int(elapsed * _SWAY_HZ)
        for _ in range(min(ticks - self._ticks, 60)):
            self._swayed = (self._swayed[1], next(self._sway))
        self._ticks = max(self._ticks, ticks)
        return _between(*self._swayed, elapsed * _SWAY_HZ - ticks)


def _between(a: Pose, b: Pose, share: float) -> Pose:
    """From ``a`` to ``b``, gently at both ends."""
    eased = share * share * (3 - 2 * share)
    return Pose(*(getattr(a, f.name) * (1 - eased) + getattr(b, f.name) * eased for f in fields(Pose)))


def _plus(a: Pose, b: Pose) -> Pose:
    return Pose(*(getattr(a, f.name) + getattr(b, f.name) for f in fields(Pose)))
