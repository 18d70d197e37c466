"""Where the crawler was at the time of a frame, from a counter that is read at other times and may step by 0.1 m only.

A counter with step q that shows d says that the truth is within d +- q/2. While it shows d nobody knows where in that range,
but the moment it steps the truth is at its boundary. So the path is drawn through the steps (a monotone cubic after Fritsch and
Carlson, which does not overshoot), and between them it is as uncertain as an unknown acceleration leaves it, at most as a value
that may be anywhere in the range (q / sqrt 12). Where a step takes far longer than its neighbours the crawler has halted inside
the range: then it drives to the middle, stands, and drives on.

Units are metres and seconds; times are on any clock that does not jump.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator
from scipy.ndimage import median_filter

Array = NDArray[np.float64]
Rounding = Literal["nearest", "down"]

ACCELERATION = 0.08
"""Standard deviation (m/s^2) of a crawler's acceleration between two steps of its counter."""
HALT_RATIO = 2.5
"""A step that takes so many times what its neighbours' speeds let expect has a halt in it."""
HALT_S = 0.4
"""And so much longer (s) at least."""
FASTEST = 2.0
"""Faster than this (m/s) nothing drives in a pipe: the counter has jumped."""
LEAP = 1.5
"""Nothing in a pipe gains or loses so much speed (m/s) from one reading to the next, see ``bridge``."""
SPEED_SPAN_S = 0.3
"""The speed of the moment is taken over at least this long (s)."""
STANDING_SPEED = 0.005
"""Slower than this (m/s) counts as standing."""
HORIZON_S = 2.0
"""A reading older than this (s) is not extrapolated any further."""
KEPT_RUNS = 256
_PACE_STD = 0.2
"""A speed measured over the last step holds for the next one to this share,"""
_STEADY_RATIO = 1.7
"""where the one before was the same to this ratio."""
_START_STD = 0.1
"""What a crawler whose speed is not known may drive (m/s, standard deviation)."""
_FINE_STD = 0.001
"""What a counter whose step is not stated leaves open (m)."""


@dataclass(frozen=True)
class Position:
    """``chainage`` (m) with its standard deviation ``std``, ``speed`` (m/s, signed), and whether the crawler stands. ``common``
    (m) is the standard deviation of what every chainage of the drive is off by, see ``rounding_std``."""

    chainage: float
    std: float
    speed: float
    standing: bool
    common: float = 0.0


def rounding_std(quantum: float) -> float:
    """What it leaves open (m, standard deviation) that a counter of step ``quantum`` does not say whether it shows the nearest
    value, as is taken for granted, or the last one passed: then all that it tells is half a step further on."""
    return quantum / math.sqrt(8)


@dataclass(frozen=True)
class _Run:
    """The counter showed ``value`` from the reading at ``first`` to that at ``last`` (s)."""

    first: float
    last: float
    value: float


@dataclass(frozen=True)
class _Path:
    """The steps of a series, at ``when`` (n,) and ``where`` (n,) with ``std`` (n,), and the way through them."""

    when: Array
    where: Array
    std: Array
    way: PchipInterpolator
    begin: float

    def at(self, times: Array, quantum: float) -> tuple[Array, Array]:
        """Positions and standard deviations at ``times`` (n,) within the series."""
        step = np.searchsorted(self.when, times)
        since = times - np.concatenate([[-np.inf], self.when])[step]
        until = np.concatenate([self.when, [np.inf]])[step] - times
        # between two known points an acceleration a bends the path by a s (T - s) / 2
        with np.errstate(invalid="ignore"):
            bend = np.minimum(ACCELERATION * since * until / 2, quantum / math.sqrt(12))
        known = np.interp(times, self.when, self.std) if len(self.when) else np.zeros(len(times))
        return np.asarray(self.way(times), dtype=np.float64), np.hypot(known, bend)


def step_of(values: Array) -> float:
    """The step (m) of a counter, from a series of what it showed: the smallest change. 0 where it never changed."""
    changes = np.abs(np.diff(values))
    changes = changes[changes > 1e-9]
    return float(changes.min()) if len(changes) else 0.0


def destep(times: Array, values: Array, quantum: float | None = None, rounding: Rounding = "nearest") -> tuple[Array, Array]:
    """The positions (n,) and their standard deviations (n,) at the readings of a whole series.

    ``times`` (n,) grow, ``values`` (n,) are what the counter showed, ``quantum`` its step, by default the smallest change seen.
    ``rounding`` says whether the counter shows the nearest value or the last one passed. Where the counter jumps, further than
    FASTEST allows, the path is broken and goes on from the new value. Raises ValueError for times that do not grow.
    """
    times, values = np.asarray(times, dtype=np.float64), np.asarray(values, dtype=np.float64)
    if times.shape != values.shape or times.ndim != 1:
        raise ValueError(f"times {times.shape} and values {values.shape} are not two rows of one length")
    if not (np.all(np.diff(times) > 0) and np.all(np.isfinite(values))):
        raise ValueError("the times must grow and the values be numbers")
    if quantum is None:
        quantum = step_of(values)
    positions, std = np.empty(len(times)), np.empty(len(times))
    breaks = np.flatnonzero(_jumped(np.diff(times), np.diff(values), quantum)) + 1
    for piece in np.split(np.arange(len(times)), breaks):
        if not len(piece):
            continue
        path = _path(_runs(times[piece], values[piece]), quantum)
        positions[piece], std[piece] = path.at(times[piece], quantum)
    positions = np.clip(positions, values - quantum / 2, values + quantum / 2)
    return positions + _offset(quantum, rounding), std


@dataclass(frozen=True)
class Jump:
    """The counter leapt between reading ``index - 1`` and ``index`` of a series, by ``metres``; how far it drove meanwhile is
    known to ``std`` (m)."""

    index: int
    metres: float
    std: float


def bridge(times: Array, values: Array, quantum: float) -> tuple[Array, tuple[Jump, ...]]:
    """What a counter would have shown in a whole series had it never been set: ``values`` (n,) at growing ``times`` (n,)
    without their jumps, so that the way goes on as before and after, and the jumps. ``quantum`` is its step (m), 0 for none.

    A jump is what the speeds around it do not explain, whatever the time between two readings.
    """
    if len(times) < 3:
        return values, ()
    waited, moved = np.diff(times), np.diff(values)
    pace = _paces(times, values)
    leapt = np.abs(moved - pace * waited) > LEAP * waited + 2.5 * quantum
    driven = pace * waited
    if quantum > 0:
        driven = np.round(driven / quantum) * quantum
    taken_out = np.where(leapt, moved - driven, 0.0)
    std = np.hypot(quantum / math.sqrt(6), _PACE_STD * np.abs(pace) * waited)
    jumps = tuple(Jump(int(k) + 1, float(taken_out[k]), float(std[k])) for k in np.flatnonzero(leapt))
    return values - np.concatenate([[0.0], np.cumsum(taken_out)]), jumps


def _paces(times: Array, values: Array) -> Array:
    """The usual speed (n - 1,) around each interval of a series, signed: the median over some seconds, which no jump bends."""
    lag = min(max(1, round(1.0 / float(np.median(np.diff(times))))), len(times) - 1)
    speeds = (values[lag:] - values[:-lag]) / (times[lag:] - times[:-lag])
    usual = median_filter(speeds, size=6 * lag + 1, mode="mirror")
    middle = np.clip(np.arange(len(times) - 1) - lag // 2, 0, len(usual) - 1)
    return np.asarray(usual[middle], np.float64)


class Odometer:
    """The same, while the readings come in.

    ``quantum`` is the counter's step (m), 0 where it is not known but fine: then 1 mm is taken for what it leaves open. With
    ``bridge`` a jump of the counter is taken out, so that the chainage goes on where it was; without, the chainage jumps with
    the counter. Either way it is noted in ``jumps``.
    """

    def __init__(self, quantum: float, rounding: Rounding = "nearest", bridge: bool = True) -> None:
        if not (math.isfinite(quantum) and quantum >= 0):
            raise ValueError(f"the step of the counter must be a number of metres from 0 on, got {quantum}")
        self.jumps: list[tuple[float, float]] = []
        """Time (s) of the first reading after each jump, and how far it went (m)."""
        self._quantum = quantum
        self._offset = _offset(quantum, rounding)
        self._bridge = bridge
        self._taken_out = 0.0
        self._drift2 = 0.0
        self._runs: deque[_Run] = deque(maxlen=KEPT_RUNS)
        self._path: _Path | None = None

    @property
    def ready(self) -> bool:
        """Whether there has been a reading."""
        return bool(self._runs)

    def add(self, time_s: float, position_m: float) -> None:
        """One reading. Readings that are not newer than the last one are passed over."""
        if not (math.isfinite(time_s) and math.isfinite(position_m)):
            raise ValueError(f"a reading must be two numbers, got {time_s} and {position_m}")
        value = position_m - self._taken_out
        if self._runs:
            last = self._runs[-1]
            if time_s <= last.last:
                return
            waited, moved = time_s - last.last, value - last.value
            if bool(_jumped(np.array([waited]), np.array([moved]), self._quantum)[0]):
                self.jumps.append((time_s, moved))
                if self._bridge:
                    # what was driven meanwhile is not known, nor where within its step the counter began anew
                    self._drift2 += (self._pace(self._way())[0] * waited) ** 2 + self._quantum**2 / 6
                    self._taken_out += moved
                    value = last.value
                else:
                    self._runs.clear()
        if self._runs and abs(value - self._runs[-1].value) < 1e-9:
            self._runs[-1] = _Run(self._runs[-1].first, time_s, self._runs[-1].value)
        else:
            self._runs.append(_Run(time_s, time_s, value))
            self._path = None

    def at(self, time_s: float) -> Position:
        """Where the crawler was, or is, at ``time_s``. Raises ValueError before the first reading."""
        if not self._runs:
            raise ValueError("there has been no reading yet")
        path = self._way()
        if len(path.when) and time_s <= path.when[-1]:
            when = np.array([max(time_s, path.begin)])
            where, std = path.at(when, self._quantum)
            speed = float(path.way(when[0], 1))
            return self._position(float(where[0]), float(std[0]), speed, abs(speed) < STANDING_SPEED)
        return self._ahead(path, time_s)

    def _way(self) -> _Path:
        """The way through the steps so far. Only a new step changes it, up to that step."""
        if self._path is None:
            self._path = _path(list(self._runs), self._quantum)
        return self._path

    def _ahead(self, path: _Path, time_s: float) -> Position:
        """Beyond the last step: the speed carries on, but the next step has not come yet at the last reading."""
        last, quantum = self._runs[-1], self._quantum
        anywhere = quantum / math.sqrt(12)
        late = max(0.0, time_s - last.last)
        if not len(path.when):
            return self._position(last.value, math.hypot(anywhere, _START_STD * late), 0.0, True)
        pace, sure = self._pace(path)
        towards = 1.0 if last.value > path.where[-1] else -1.0
        since = last.last - float(path.when[-1])
        if quantum > 0:
            entry = last.value - towards * quantum / 2
            gone = towards * (float(path.where[-1]) - entry) + pace * since
            share = gone / quantum if pace > 0 else math.inf
            where = entry + towards * quantum * float(np.interp(share, *_SHARE))
            std = quantum * float(np.interp(share, *_SHARE_STD)) if sure else max(pace, _START_STD) * since
            std = min(math.hypot(float(path.std[-1]), std), anywhere)
        else:
            share, where, std = since / HALT_S * HALT_RATIO, last.value, float(path.std[-1])
        halted = share >= HALT_RATIO and since > HALT_S
        if halted:
            return self._position(where, math.hypot(std, _START_STD * late), 0.0, True)
        fading = float(np.interp(share, [1.5, HALT_RATIO], [1.0, 0.0])) if since > HALT_S else 1.0
        speed = pace * fading
        ahead = min(late, HORIZON_S)
        unsure = _PACE_STD * pace * ahead + pace * (late - ahead) if sure else max(pace, _START_STD) * late
        std = math.hypot(math.hypot(std, unsure), ACCELERATION * late**2 / 2)
        return self._position(where + towards * speed * ahead, std, towards * speed, speed < STANDING_SPEED)

    def _pace(self, path: _Path) -> tuple[float, bool]:
        """The speed (m/s, >= 0) over the last steps, and whether it may be trusted: it was about the same the step before."""
        when, where = path.when, path.where
        found: list[float] = []
        k = len(when) - 1
        while k > 0 and len(found) < 2:
            j = k - 1
            while j > 0 and when[k] - when[j] < SPEED_SPAN_S:
                j -= 1
            found.append(float((where[k] - where[j]) / (when[k] - when[j])))
            k = j
        if len(found) < 2:
            return (abs(found[0]) if found else 0.0), False
        now, before = abs(found[0]), abs(found[1])
        # a step with a halt or a turn in it says nothing of the speed after it
        pace = before if now * HALT_RATIO < before else now
        return pace, found[0] * found[1] > 0 and max(now, before) < _STEADY_RATIO * min(now, before)

    def _position(self, chainage: float, std: float, speed: float, standing: bool) -> Position:
        unknown = 0.0 if self._quantum > 0 else _FINE_STD
        variance = std**2 + self._drift2 + unknown**2
        return Position(chainage + self._offset, math.sqrt(variance), speed, standing, rounding_std(self._quantum))


# Beyond the last step: how far the speed says that the range has been passed, against where in it the crawler is most likely,
# and how well that is known. A step that is overdue means a slower crawler first and one that stands at last, anywhere.
_SHARE = ([0.0, 0.85, 1.2, HALT_RATIO], [0.0, 0.85, 0.85, 0.5])
_SHARE_STD = ([0.0, 0.5, 1.0, HALT_RATIO], [0.02, 0.12, 0.2, 1 / math.sqrt(12)])


def _offset(quantum: float, rounding: Rounding) -> float:
    return quantum / 2 if rounding == "down" else 0.0


def _jumped(waited: Array, moved: Array, quantum: float) -> NDArray[np.bool_]:
    # two steps may come at once where the counter itself is slow
    return np.asarray(np.abs(moved) > FASTEST * waited + 2.5 * quantum)


def _runs(times: Array, values: Array) -> list[_Run]:
    starts = np.concatenate([[0], np.flatnonzero(np.abs(np.diff(values)) > 1e-9) + 1])
    ends = np.concatenate([starts[1:] - 1, [len(values) - 1]])
    return [_Run(float(times[a]), float(times[b]), float(values[a])) for a, b in zip(starts, ends, strict=True)]


def _path(runs: list[_Run], quantum: float) -> _Path:
    """The way through the steps between ``runs``."""
    first = np.array([run.first for run in runs])
    last = np.array([run.last for run in runs])
    value = np.array([run.value for run in runs])
    window = first[1:] - last[:-1]
    when, where = (first[1:] + last[:-1]) / 2, (value[1:] + value[:-1]) / 2
    towards = np.sign(np.diff(value))
    took = np.diff(when)
    pace = np.full(len(runs), np.nan)  # the speed while the counter showed each value
    same = towards[1:] == towards[:-1]
    pace[1:-1] = np.where(same, np.abs(np.diff(where)) / took, np.nan)
    std = _step_std(window, np.abs(np.diff(value)), pace, quantum)
    knots = [(float(t), float(x)) for t, x in zip(when, where, strict=True)]
    knots += _rests(first, last, value, when, where, pace)
    knots.sort()
    t, x = np.array([knot[0] for knot in knots]), np.array([knot[1] for knot in knots])
    kept = np.concatenate([[True], np.diff(t) > 1e-6])
    return _Path(when, where, std, PchipInterpolator(t[kept], x[kept]), runs[0].first)


def _step_std(window: Array, moved: Array, pace: Array, quantum: float) -> Array:
    """How well the place of each step is known: it came at some moment between two readings."""
    if not len(window):
        return window
    with np.errstate(invalid="ignore"):
        near = np.fmax(pace[:-1], pace[1:])
    near = np.where(np.isnan(near), moved / np.maximum(window, SPEED_SPAN_S), near)
    one = np.minimum(near * window, quantum) / math.sqrt(12)
    many = quantum / math.sqrt(24)
    return np.hypot(np.where(moved > 1.5 * quantum, many, one), ACCELERATION * window**2 / 8)


def _rests(first: Array, last: Array, value: Array, when: Array, where: Array, pace: Array) -> list[tuple[float, float]]:
    """Knots (time, position) beside the steps: where the crawler begins, ends, halts and turns round."""
    if not len(when):
        return [(float(first[0]), float(value[0])), (max(float(last[-1]), float(first[0]) + 1.0), float(value[0]))]
    knots = _end(float(first[0]), float(when[0]), float(where[0]), float(value[0]), _known(pace[1:2], pace[2:3]))
    knots += _end(float(last[-1]), float(when[-1]), float(where[-1]), float(value[-1]), _known(pace[-2:-1], pace[-3:-2]))
    begin, end, middle = when[:-1], when[1:], value[1:-1]
    if not len(begin):
        return knots
    before = np.where(np.isnan(pace[:-2]), pace[2:], pace[:-2])
    after = np.where(np.isnan(pace[2:]), pace[:-2], pace[2:])
    with np.errstate(divide="ignore", invalid="ignore"):
        out, back = np.abs(middle - where[:-1]) / before, np.abs(where[1:] - middle) / after
        turned = np.isnan(pace[1:-1])
        expected = out + back
        halted = (end - begin > HALT_RATIO * expected) & (end - begin > expected + HALT_S)
    for k in np.flatnonzero(turned | halted):
        start, stop = float(where[k]), float(middle[k])
        if math.isnan(expected[k]):
            knots.append((float(begin[k] + end[k]) / 2, stop))
        elif turned[k] and end[k] - begin[k] < 2 * expected[k]:
            # braking evenly from v to -v over T it comes v T / 4 beyond the step
            reach = min(1.0, float(end[k] - begin[k]) / (2 * float(expected[k]))) if expected[k] > 0 else 0.0
            knots.append((float(begin[k] + end[k]) / 2, start + (stop - start) * reach))
        else:
            knots += [(float(begin[k] + out[k]), stop), (float(end[k] - back[k]), stop)]
    return knots


def _end(limit: float, step: float, edge: float, middle: float, speed: float) -> list[tuple[float, float]]:
    """Knots between the first or last step, at ``step`` and ``edge``, and the end of the series at ``limit``."""
    if limit == step:
        return []
    if not speed > 0:
        return [(limit, middle)]
    half = abs(middle - edge) / speed
    if abs(limit - step) > half:
        return [(step + math.copysign(half, limit - step), middle), (limit, middle)]
    return [(limit, edge + (middle - edge) * abs(limit - step) / half)] if half > 0 else []


def _known(*paces: Array) -> float:
    """The first speed that is known, 0 where none is."""
    return next((float(pace[0]) for pace in paces if len(pace) and not math.isnan(pace[0])), 0.0)
