"""Where the crawler was at any moment of a recording: from all its distances at once, those after a moment too."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from estimators.odometry import FASTEST, STANDING_SPEED, Position, destep, rounding_std, step_of

Array = NDArray[np.float64]

GAP_S = 5.0
"""Between two distances further apart in time than this nobody knows where the crawler was."""
_SPEED_OVER_S = 0.5


@dataclass(frozen=True)
class RecordedWay:
    """``times`` (n,) grow; ``positions`` (n,) with ``std`` (n,), in metres; ``piece`` (n,) numbers the stretches between jumps
    of the counter, which have nothing to do with each other; ``common`` (m) as in ``Position``. ``jumps``: when (s) the counter
    was set, what it showed before, and after (m)."""

    times: Array
    positions: Array
    std: Array
    piece: NDArray[np.int64]
    common: float = 0.0
    jumps: tuple[tuple[float, float, float], ...] = ()

    def at(self, time_s: float) -> Position | None:
        """The position at a moment; None outside the recording, in a gap, and while the counter jumps."""
        k = int(np.searchsorted(self.times, time_s, side="right"))
        if k == len(self.times) and k and time_s <= self.times[-1] + 1e-6:
            k -= 1
        if k == 0 and len(self.times) and time_s >= self.times[0] - _SPEED_OVER_S:
            return self._position(float(self.positions[0]), float(self.std[0]), self._speed(float(self.times[0])))
        if not 0 < k < len(self.times):
            return None
        if self.piece[k] != self.piece[k - 1] or self.times[k] - self.times[k - 1] > GAP_S:
            return None
        share = (time_s - self.times[k - 1]) / (self.times[k] - self.times[k - 1])
        where = (1 - share) * self.positions[k - 1] + share * self.positions[k]
        std = (1 - share) * self.std[k - 1] + share * self.std[k]
        return self._position(float(where), float(std), self._speed(time_s))

    def longest(self) -> RecordedWay:
        """The stretch with the longest way alone."""
        ways = {int(n): float(np.abs(np.diff(self.positions[self.piece == n])).sum()) for n in np.unique(self.piece)}
        best = self.piece == max(ways, key=lambda n: ways[n])
        return RecordedWay(self.times[best], self.positions[best], self.std[best], self.piece[best], self.common, self.jumps)

    @property
    def pieces(self) -> int:
        """How many stretches there are."""
        return len(np.unique(self.piece))

    @cached_property
    def _over_s(self) -> float:
        """Half the span (s) over which the speed of a moment is taken."""
        return max(_SPEED_OVER_S, 2 * float(np.median(np.diff(self.times)))) if len(self.times) > 1 else _SPEED_OVER_S

    def _speed(self, time_s: float) -> float:
        low, high = np.clip([time_s - self._over_s, time_s + self._over_s], self.times[0], self.times[-1])
        if high <= low:
            return 0.0
        before, after = np.interp([low, high], self.times, self.positions)
        return float((after - before) / (high - low))

    def _position(self, where: float, std: float, speed: float) -> Position:
        return Position(where, std, speed, abs(speed) < STANDING_SPEED, self.common)


def recorded_way(
    times: Sequence[float], distances: Sequence[float], quantum: float | None = None, pieces: Sequence[int] | None = None
) -> RecordedWay:
    """The way through distances (m) at growing ``times`` (s).

    ``quantum`` is the counter's step, by default the smallest change; ``pieces`` number the stretches, by default they part
    where the counter jumps. Raises ValueError for times that do not grow.
    """
    when, shown = np.asarray(times, dtype=np.float64), np.asarray(distances, dtype=np.float64)
    step = step_of(shown) if quantum is None else quantum
    if pieces is None:
        leapt = np.abs(np.diff(shown)) > FASTEST * np.diff(when) + 2.5 * step
        piece = np.concatenate([[0], np.cumsum(leapt)]) if len(shown) else np.zeros(0)
    else:
        piece = np.asarray(pieces)
    positions, std = np.empty(len(when)), np.empty(len(when))
    for n in np.unique(piece):
        these = piece == n
        positions[these], std[these] = destep(when[these], shown[these], step)
    begins = (np.flatnonzero(np.diff(piece)) + 1).tolist()
    jumps = tuple((float(when[k]), float(shown[k - 1]), float(shown[k])) for k in begins)
    return RecordedWay(when, positions, std, piece.astype(np.int64), rounding_std(step), jumps)
