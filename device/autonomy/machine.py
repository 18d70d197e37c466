"""When the box begins and ends surveys by itself: the rules, as a state machine without clock, thread or file.

Several times a second it is told what is ``Seen`` and answers with what to do. Every decision carries the moment that it is
about: that a halt was the end of a survey is known only after a while, but the survey ended when the crawler stopped.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field, replace
from typing import Literal

from device.landmarks.standstill import Standstill

_MOVED_WITHIN_S = 10.0
_VIEWS_S = 1.5
_FASTEST, _JUMP_M = 1.0, 0.5
"""A counter that goes further than a crawler can (m/s, and m for its steps) has jumped."""

State = Literal["off", "waiting", "surveying", "aside", "held"]
Wants = Literal["", "motion", "new view"]
"""What has to come before another drive is begun: nothing, that the crawler moves, that it leaves what it is in."""


@dataclass(frozen=True)
class Rules:
    """Seconds and metres; what each is for stands in REASONS and in the README."""

    seen_s: float = 2.0
    moved_m: float = 0.3
    blind_m: float = 5.0
    """So much way begins a survey though no pipe is made out in the picture."""
    still_s: float = 90.0
    dark_s: float = 10.0
    node_s: float = 3.0
    node_m: float = 0.3
    pan_s: float = 120.0
    """So long without a pipe in view ends a survey though the crawler stands: shorter, it looks aside."""
    back_m: float = 2.0
    lost_s: float = 60.0
    voltage_s: float = 30.0
    gone_s: float = 5.0
    again_s: float = 15.0
    tries: int = 3


REASONS = {
    "pipe_seen": "A pipe came into view.",
    "moved": "The crawler moved.",
    "power_cut": "The power was cut.",
    "power_back": "The power came back in the middle of a survey; this one goes on where it was.",
    "standstill": "The crawler stood still.",
    "darkness": "It went dark.",
    "node": "The crawler came out into a manhole.",
    "turned_back": "The end was reached: the crawler turned back.",
    "signal_lost": "The picture or the counter was lost.",
    "disk": "The disk was nearly full.",
    "heat": "The box was too hot.",
    "voltage": "The supply's voltage was low.",
    "ended": "It was ended at the page, or failed.",
    "switched_off": "Logging by itself was switched off.",
    "box_off": "The box was switched off.",
}
"""Why a survey began or ended, or why none is begun."""


_WANTS: dict[str, Wants] = {"standstill": "motion", "turned_back": "new view", "ended": "new view"}


def wants_after(reason: str) -> Wants:
    """What has to come before another drive is begun once one ended for ``reason``."""
    return _WANTS.get(reason, "")


@dataclass(frozen=True)
class Crawling:
    """The crawler at one moment. ``pipe`` and ``lit`` of its picture, None without one; ``way_m`` what the counter says from
    anywhere, None while it is silent; ``busy`` while a drive is under way, whoever began it; ``finishing`` while the last one
    is smoothed and no other can begin."""

    lit: bool | None
    pipe: bool | None
    way_m: float | None
    busy: bool
    finishing: bool = False


@dataclass(frozen=True)
class Aiming:
    """The depth camera at one moment. ``pipe``: the live estimate has one; ``accepted``: whether the last measurement was."""

    pipe: bool
    busy: bool
    accepted: bool = False


@dataclass(frozen=True)
class Condition:
    """The box at one moment."""

    disk_low: bool = False
    too_hot: bool = False
    voltage_low: bool = False


@dataclass(frozen=True)
class Seen:
    """Everything at ``time_s`` (any clock that never jumps); None for a sensor that the box does not have."""

    time_s: float
    crawling: Crawling | None = None
    aiming: Aiming | None = None
    condition: Condition = field(default_factory=Condition)


@dataclass(frozen=True)
class Action:
    """``begin`` or ``end`` a drive, ``drop`` one in which the crawler never moved, ``measure`` a diameter; ``held`` and
    ``released`` only tell that surveys are held back or no longer are.

    ``at_s`` is the moment that it is about, ``reason`` a key of REASONS.
    """

    what: Literal["begin", "end", "drop", "measure", "held", "released"]
    at_s: float
    reason: str


class Autonomy:
    """``resumes``: the box came back from a power cut that befell a drive it had begun by itself. ``wants``: what the last
    drive before the box was switched off left to be waited for, see ``wants_after``."""

    def __init__(self, rules: Rules | None = None, resumes: bool = False, wants: Wants = "") -> None:
        self.rules = rules or Rules()
        self._drive = _Driving(self.rules, resumes, wants)
        self._aim = _Measuring(self.rules)
        self._holds: dict[str, float] = {}
        self._low_since: float | None = None
        self._good_since: float | None = None

    @property
    def state(self) -> State:
        """What it is about just now; "aside" while somebody drives by hand."""
        if self._holds:
            return "held"
        return self._drive.state

    @property
    def holds(self) -> tuple[str, ...]:
        """Why no survey is begun: keys of REASONS."""
        return tuple(self._holds)

    def step(self, seen: Seen) -> list[Action]:
        """What to do now."""
        actions = self._hold(seen)
        held = next(iter(self._holds), None)
        if seen.crawling is not None:
            actions += self._drive.step(seen.time_s, seen.crawling, held)
        if seen.aiming is not None and held is None:
            actions += self._aim.step(seen.time_s, seen.aiming)
        return actions

    def refused(self) -> None:
        """The drive that was to begin could not: it is tried again."""
        self._drive.refused()

    def switch_off(self, time_s: float) -> list[Action]:
        """Nobody wants it any more."""
        return [Action("end", time_s, "switched_off")] if self._drive.state == "surveying" else []

    def _hold(self, seen: Seen) -> list[Action]:
        condition, now = seen.condition, seen.time_s
        if condition.voltage_low:
            self._low_since = now if self._low_since is None else self._low_since
            self._good_since = None
        else:
            self._good_since = now if self._good_since is None else self._good_since
            self._low_since = None
        voltage = self._low_since is not None and now - self._low_since >= self.rules.voltage_s
        if "voltage" in self._holds:  # and until it has been good for as long
            voltage = self._good_since is None or now - self._good_since < self.rules.voltage_s
        wanted = {"disk": condition.disk_low, "heat": condition.too_hot, "voltage": voltage}
        actions = []
        for reason, is_so in wanted.items():
            if is_so and reason not in self._holds:
                self._holds[reason] = now
                actions.append(Action("held", now, reason))
            elif not is_so and reason in self._holds:
                del self._holds[reason]
                actions.append(Action("released", now, reason))
        return actions


class _Driving:
    """Drives of the crawler."""

    def __init__(self, rules: Rules, resumes: bool, wants: Wants) -> None:
        self._rules = rules
        self.state: Literal["waiting", "surveying", "aside"] = "waiting"
        self._way = _Way()
        self._views = _Views()
        self._still = Standstill()
        self._resumes, self._resumed = resumes, False
        self._pipe_since: float | None = None
        self._lost_view_s: float | None = None
        """Since when there is light but no pipe, and what the counter said then."""
        self._lost_view_m: float | None = None
        self._dark_since: float | None = None
        self._silent_since: float | None = None
        self._wants = wants
        self._saw_pipe = False
        self._furthest_m: float | None = None
        self._furthest_s = 0.0
        self._begun_s = 0.0
        self._forward = 0.0
        self._reached: tuple[float, float] | None = None
        """The least and the most that the counter said in this drive."""

    def step(self, now: float, seen: Crawling, held: str | None) -> list[Action]:
        seen = replace(seen, way_m=self._way.add(now, seen.way_m), pipe=self._views.add(now, seen.pipe))
        self._look(now, seen)
        if self.state == "surveying":
            if not seen.busy:
                return self._stopped(now)
            return self._end_if(now, seen, held)
        if seen.busy:
            self.state = "aside"  # somebody drives by hand
            return []
        if self.state == "aside":
            self.state, self._wants = "waiting", "new view"
        if held is not None or seen.finishing:
            self._pipe_since = None  # what is seen meanwhile begins nothing later
            return []
        return self._begin_if(now, seen)

    def _look(self, now: float, seen: Crawling) -> None:
        silent = seen.lit is None or seen.way_m is None
        self._silent_since = None if not silent else now if self._silent_since is None else self._silent_since
        if seen.way_m is not None:
            self._still.add(now, seen.way_m)
        if seen.lit is None:
            return
        self._dark_since = None if seen.lit else self._dark_since if self._dark_since is not None else now
        if seen.pipe:
            self._pipe_since = now if self._pipe_since is None else self._pipe_since
            self._lost_view_s = self._lost_view_m = None
            return
        self._pipe_since = None
        if not seen.lit:
            self._lost_view_s = self._lost_view_m = None  # darkness is another matter
        elif self._lost_view_s is None:
            self._lost_view_s, self._lost_view_m = now, seen.way_m

    def _begin_if(self, now: float, seen: Crawling) -> list[Action]:
        rules = self._rules
        if self._view_is_gone(now, seen):
            self._resumes = False
            self._wants = ""
        moved = self._still.moved_m(_MOVED_WITHIN_S)
        if self._wants == "motion" and moved >= rules.moved_m:
            self._wants = ""
            self._pipe_since = None if self._pipe_since is None else now
        if self._wants or not seen.lit:
            return []
        if self._pipe_since is not None and now - self._pipe_since >= rules.seen_s:
            return self._begin(now, "power_back" if self._resumes else "pipe_seen", seen)
        if self._went_blind(seen, rules.blind_m):
            return self._begin(now, "moved", seen)
        return []

    def refused(self) -> None:
        self.state, self._resumes = "waiting", self._resumed
        self._pipe_since = None

    def _view_is_gone(self, now: float, seen: Crawling) -> bool:
        """Whether the crawler has left whatever it was in."""
        if self._dark_since is not None and now - self._dark_since >= self._rules.dark_s:
            return True
        return (
            self._lost_view_s is not None
            and now - self._lost_view_s >= self._rules.node_s
            and self._went_blind(seen, self._rules.node_m)
        )

    def _went_blind(self, seen: Crawling, metres: float) -> bool:
        """Whether it drove on while no pipe was in view: one that only looks aside stands."""
        if self._lost_view_m is None or seen.way_m is None:
            return False
        return abs(seen.way_m - self._lost_view_m) >= metres

    def _begin(self, now: float, reason: str, seen: Crawling) -> list[Action]:
        self.state, self._begun_s = "surveying", now
        self._resumed, self._resumes = self._resumes, False
        self._saw_pipe = bool(seen.pipe)
        self._still.forget()  # the counter may be set anew as a drive begins
        self._furthest_m = self._reached = None
        self._forward = 0.0
        return [Action("begin", now, reason)]

    def _end_if(self, now: float, seen: Crawling, held: str | None) -> list[Action]:
        rules = self._rules
        self._saw_pipe = self._saw_pipe or bool(seen.pipe)
        if seen.way_m is not None:
            low, high = self._reached or (seen.way_m, seen.way_m)
            self._reached = min(low, seen.way_m), max(high, seen.way_m)
        if held is not None:
            return self._end(now, held)
        if self._dark_since is not None and now - self._dark_since >= rules.dark_s:
            return self._end(self._dark_since, "darkness")
        if self._saw_pipe and self._lost_view_s is not None:
            gone_s = now - self._lost_view_s
            if gone_s >= rules.pan_s or (gone_s >= rules.node_s and self._went_blind(seen, rules.node_m)):
                return self._end(self._lost_view_s, "node")
        if self._turned(now, seen):
            return self._end(self._furthest_s, "turned_back")
        since = self._still.since_s
        if since is not None and self._silent_since is None and now - since >= rules.still_s:
            return self._end(since, "standstill")
        if self._silent_since is not None and now - self._silent_since >= rules.lost_s:
            return self._end(self._silent_since, "signal_lost")
        return []

    def _turned(self, now: float, seen: Crawling) -> bool:
        """Whether it has gone back so far that it has turned for good. Which way is ahead shows on the way."""
        if seen.way_m is None:
            return False
        if self._furthest_m is None:
            self._furthest_m, self._furthest_s = seen.way_m, now
            return False
        beyond = seen.way_m - self._furthest_m
        if self._forward == 0.0 and abs(beyond) >= self._rules.moved_m:
            self._forward = 1.0 if beyond > 0 else -1.0
        if self._forward == 0.0:
            return False
        if self._forward * beyond > 0:
            self._furthest_m, self._furthest_s = seen.way_m, now
        return -self._forward * beyond >= self._rules.back_m

    def _end(self, at_s: float, reason: str) -> list[Action]:
        self.state, self._wants = "waiting", wants_after(reason)
        self._still.forget()  # the next drive wants motion of its own
        self._pipe_since = None
        low, high = self._reached or (0.0, 0.0)
        if high - low < self._rules.moved_m and reason != "ended":
            self._wants = "motion"
            return [Action("drop", at_s, reason)]
        return [Action("end", max(at_s, self._begun_s), reason)]

    def _stopped(self, now: float) -> list[Action]:
        """It was ended at the page, or failed: the same pipe is not begun again."""
        return self._end(now, "ended")


class _Views:
    """What most pictures of the last moments say: one of them may be taken for what it is not."""

    def __init__(self) -> None:
        self._recent: deque[tuple[float, bool]] = deque()
        self._said: bool | None = None

    def add(self, now: float, pipe: bool | None) -> bool | None:
        """What this picture says; what they say. None without a picture."""
        if pipe is None:
            self._recent.clear()
            self._said = None
            return None
        self._recent.append((now, pipe))
        while self._recent[0][0] < now - _VIEWS_S:
            self._recent.popleft()
        pro = sum(one for _, one in self._recent)
        if self._said is None or 2 * pro != len(self._recent):
            self._said = 2 * pro > len(self._recent)
        return self._said


class _Way:
    """The counter without its jumps: it may be zeroed, or fall back by itself, and the crawler has not moved for that."""

    def __init__(self) -> None:
        self._last: tuple[float, float] | None = None
        self._taken_out = 0.0

    def add(self, now: float, way_m: float | None) -> float | None:
        """What the counter says at ``now``; where the crawler is by it."""
        if way_m is None:
            return None
        if self._last is not None:
            waited, moved = now - self._last[0], way_m - self._last[1]
            if abs(moved) > _FASTEST * waited + _JUMP_M:
                self._taken_out += moved
        self._last = (now, way_m)
        return way_m - self._taken_out


class _Measuring:
    """Measurements of the depth camera: one that is accepted for each time that a pipe comes into view, or a few tries."""

    def __init__(self, rules: Rules) -> None:
        self._rules = rules
        self._pipe_since: float | None = None
        self._gone_since: float | None = None
        self._tried = 0
        self._last_s = 0.0

    def step(self, now: float, seen: Aiming) -> list[Action]:
        if seen.busy:
            self._last_s = now
            return []
        if not seen.pipe:
            self._pipe_since = None
            self._gone_since = now if self._gone_since is None else self._gone_since
            if now - self._gone_since >= self._rules.gone_s:
                self._tried = 0
            return []
        self._gone_since = None
        self._pipe_since = now if self._pipe_since is None else self._pipe_since
        if now - self._pipe_since < self._rules.seen_s or self._tried >= self._rules.tries:
            return []
        if self._tried and (seen.accepted or now - self._last_s < self._rules.again_s):
            return []
        self._tried += 1
        self._last_s = now
        return [Action("measure", now, "pipe_seen")]
