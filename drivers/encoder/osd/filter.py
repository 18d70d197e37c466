"""Distances read from picture after picture, made consistent with a crawler that cannot leap.

The way through the readings is the cheapest one (dynamic programming over a few hypotheses, Viterbi): every reading offers
candidates (what was read, and what it is if one digit, the sign or the point was misread), taking one costs, taking none costs,
leaping costs. One picture decides live (``add``), all of them afterwards (``smoothed``).
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass
from typing import Literal

from drivers.encoder.osd.reader import OsdText
from drivers.encoder.osd.text import METRES, Layout

Status = Literal["read", "repaired", "rejected", "missing"]

REJECT = 2.5
"""Cost of not believing a second of readings. The other costs are measured against it; a leap is believed after LEAP / REJECT
seconds, and an excursion shorter than twice that (text laid over the counter) is not."""
LEAP = 8.0
LOOKALIKE, SIGN, POINT, OTHER_FIELD, ODD_LAYOUT = 1.6, 1.6, 1.2, 0.2, 0.8  # a second
VOUCHED_S = 1.25
"""Seconds that a reading vouches for repairs beside it; the whole run asks for one on both sides. Text laid over a counter can
look like a misread one too, but not for just a moment."""
REPAIR_M = 0.5
"""How far a repair may be from the distance beside it, metres: of a wider choice, one would always fit."""
WIGGLE = 0.5
"""Share of REJECT that a second at full speed costs: of two ways, the one that goes back and forth less."""
KEPT = 16
"""Hypotheses kept from picture to picture."""

CONFUSED = {
    "0": "8693", "1": "74", "2": "7", "3": "890", "4": "19", "5": "68", "6": "580", "7": "12", "8": "0369", "9": "803",
}  # fmt: skip
"""Digits that are taken for each other in the fonts of burned-in counters."""


@dataclass(frozen=True)
class FilterSettings:
    """``max_speed`` m/s: no crawler drives, and no winch pulls, faster."""

    max_speed: float = 1.5

    def __post_init__(self) -> None:
        if not 0 < self.max_speed < 100:
            raise ValueError(f"The greatest speed of a crawler is a number of metres per second, not {self.max_speed}.")

    def reach(self, seconds: float, quantum: float, most: float = math.inf) -> float:
        """Metres that two readings ``seconds`` apart may differ. Two quanta more than the way, at most ``most``, between them:
        the counter shows the last full step, and both ends are rounded."""
        return min(self.max_speed * seconds, most) + 2 * quantum + 1e-9


@dataclass(frozen=True)
class Filtered:
    """What became of one reading: ``distance`` in metres, None where it is not believed or nothing was read.

    ``segment`` counts the resets before it: distances of different segments have nothing to do with each other.
    """

    time_s: float
    distance: float | None
    status: Status
    segment: int = 0


@dataclass(frozen=True)
class Reset:
    """The counter leapt and stayed: the operator set it, or the recording was cut. Metres before and after."""

    time_s: float
    before: float
    after: float


@dataclass(frozen=True, eq=False)
class _Node:
    """A believed reading at the end of a way, with the one before it."""

    index: int
    time_s: float
    metres: float
    status: Status
    segment: int
    vouched_s: float
    """When the way last took what was read."""
    previous: _Node | None


@dataclass(frozen=True, eq=False)
class _Way:
    cost: float
    node: _Node | None


@dataclass(frozen=True)
class _Candidate:
    """What a text may stand for, what believing it costs a second, and whether it is what was read."""

    metres: float
    price: float
    read: bool


class OsdFilter:
    """Takes the readings in the order of their times.

    Time, not the number of pictures, is evidence: ten pictures of a second weigh as much as one a second.
    """

    def __init__(self, settings: FilterSettings | None = None) -> None:
        self.settings = settings or FilterSettings()
        self._layouts: Counter[Layout] = Counter()
        self._ways = [_Way(0.0, None)]
        self._times: list[float] = []
        self._missing: set[int] = set()

    @property
    def layout(self) -> Layout | None:
        """How the counter is written, by most of the readings so far."""
        return self._layouts.most_common(1)[0][0] if self._layouts else None

    @property
    def quantum(self) -> float | None:
        """The step that the counter shows, metres: 0.1 or 0.01 mostly. None before the first reading."""
        return self.layout.quantum if self.layout else None

    def add(self, time_s: float, text: OsdText) -> Filtered:
        """One reading. What it returns is decided from it and those before, and may be seen otherwise by ``smoothed``.

        A reset is believed about three seconds after it; the readings until then are rejected.
        """
        if self._times and time_s <= self._times[-1]:
            raise ValueError(f"Readings come in the order of their times; {time_s} s came after {self._times[-1]} s.")
        weight = min(1.0, time_s - self._times[-1]) if self._times else 1.0
        index = len(self._times)
        self._times.append(time_s)
        if text.layout is not None:
            self._layouts[text.layout] += 1
        candidates = self._candidates(text, time_s)
        if candidates:
            self._step(index, time_s, weight, candidates)
        else:
            self._missing.add(index)
        return self._told(index, self._best().node)

    def smoothed(self) -> list[Filtered]:
        """All readings so far, each decided from those before and after it."""
        believed: dict[int, _Node] = {}
        node, next_read_s = self._best().node, math.inf
        while node is not None:
            if node.status == "read":
                next_read_s = node.time_s
            if next_read_s - node.time_s <= VOUCHED_S:
                believed[node.index] = node
            node = node.previous
        out: list[Filtered] = []
        segment = 0
        for index in range(len(self._times)):
            segment = believed[index].segment if index in believed else segment
            out.append(self._told(index, believed.get(index), segment))
        return out

    def resets(self) -> list[Reset]:
        """The resets so far, oldest first."""
        found: list[Reset] = []
        node = self._best().node
        while node is not None and node.previous is not None:
            if node.segment != node.previous.segment:
                found.append(Reset(node.time_s, node.previous.metres, node.metres))
            node = node.previous
        return found[::-1]

    def _told(self, index: int, node: _Node | None, segment: int | None = None) -> Filtered:
        time_s = self._times[index]
        if node is not None and node.index == index:
            return Filtered(time_s, node.metres, node.status, node.segment)
        status: Status = "missing" if index in self._missing else "rejected"
        return Filtered(time_s, None, status, segment if segment is not None else node.segment if node else 0)

    def _best(self) -> _Way:
        return min(self._ways, key=lambda way: way.cost)

    def _step(self, index: int, time_s: float, weight: float, candidates: list[_Candidate]) -> None:
        """Continue every way by every candidate, and by none."""
        ways = [_Way(way.cost + REJECT * weight, way.node) for way in self._ways]
        for candidate in candidates:
            options = [(way.cost + self._transition(way.node, time_s, candidate), way.node) for way in self._ways]
            cost, before = min(options, key=lambda option: option[0])
            if cost == math.inf:
                continue
            leapt = before is not None and self._leaps(before, time_s, candidate)
            segment = (before.segment if before else 0) + leapt
            vouched_s = time_s if candidate.read or before is None else before.vouched_s
            status: Status = "read" if candidate.read else "repaired"
            node = _Node(index, time_s, candidate.metres, status, segment, vouched_s, before)
            ways.append(_Way(cost + candidate.price * weight, node))
        self._ways = sorted(ways, key=lambda way: way.cost)[:KEPT]
        floor = self._ways[0].cost
        self._ways = [_Way(way.cost - floor, way.node) for way in self._ways]

    def _leaps(self, before: _Node, time_s: float, candidate: _Candidate) -> bool:
        """Whether no crawler gets from ``before`` to ``candidate``."""
        most = math.inf if candidate.read else REPAIR_M
        reach = self.settings.reach(time_s - before.time_s, self.quantum or 0.1, most)
        return abs(candidate.metres - before.metres) > reach

    def _transition(self, before: _Node | None, time_s: float, candidate: _Candidate) -> float:
        """What it costs to go from ``before`` to ``candidate``; infinite for a repair that nothing vouches for."""
        if before is None:
            return 0.0 if candidate.read else math.inf
        leaps = self._leaps(before, time_s, candidate)
        if not candidate.read and (leaps or time_s - before.vouched_s > VOUCHED_S):
            return math.inf
        beyond = max(0.0, abs(candidate.metres - before.metres) - (self.quantum or 0.1))
        return LEAP if leaps else WIGGLE * REJECT * min(1.0, beyond / self.settings.max_speed)

    def _candidates(self, text: OsdText, time_s: float) -> list[_Candidate]:
        """What ``text`` may stand for, each value once at its lowest price. Misread digits are thought of only where what was
        read does not follow from the best way."""
        layout = self.layout
        if layout is None:
            return []
        offers: dict[float, _Candidate] = {}

        def offer(metres: float, price: float, read: bool) -> None:
            metres = round(metres, 9) + 0.0
            if metres not in offers or price < offers[metres].price:
                offers[metres] = _Candidate(metres, price, read or (metres in offers and offers[metres].read))

        if text.distance is not None and text.layout is not None:
            odd = text.layout.part != layout.part or text.layout.unit != layout.unit
            odd = odd or (layout.whole > 0 and len(text.digits.lstrip("-")) != layout.whole + layout.part)
            offer(text.distance, ODD_LAYOUT if odd else 0.0, read=True)
            for metres in text.others:
                offer(metres, OTHER_FIELD, read=True)
            best = self._best().node
            if best is not None and all(self._leaps(best, time_s, one) for one in offers.values()):
                for digits, price in _misread(text.digits, layout):
                    offer(_metres(digits, layout), price, read=False)
        elif layout.part:
            digits = _lost_point(text.text, layout)
            if digits:
                offer(_metres(digits, layout), POINT, read=False)
        return list(offers.values())


def _misread(digits: str, layout: Layout) -> list[tuple[str, float]]:
    """What ``digits`` is if one of them or the sign was misread, and what that costs.

    The last digit is left alone: nothing tells which other one it would be.
    """
    sign, bare = ("-", digits[1:]) if digits.startswith("-") else ("", digits)
    out = [(("" if sign else "-") + bare, SIGN), (digits, ODD_LAYOUT)]
    for place, digit in enumerate(bare[:-1]):
        out += [(sign + bare[:place] + other + bare[place + 1 :], LOOKALIKE) for other in CONFUSED[digit]]
    return out


def _lost_point(text: str, layout: Layout) -> str:
    """The digits of a text that is the counter but for its point, or nothing."""
    sign = "-" if text.strip().startswith("-") else ""
    bare = text.strip().lstrip("+-").strip().rstrip("mMftFT'. ")
    right = len(bare) == layout.whole + layout.part if layout.whole else len(bare) > layout.part
    return sign + bare if bare.isascii() and bare.isdigit() and right else ""


def _metres(digits: str, layout: Layout) -> float:
    return int(digits) * METRES[layout.unit] * 10.0**-layout.part
