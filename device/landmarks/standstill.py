"""Whether the crawler stands, from what its counter says: pure, times come in."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

KEPT_S = 30.0


@dataclass
class Standstill:
    """Feed it ``add(time_s, way_m)`` a few times a second. Smaller moves than ``least_m`` are none: a counter that stands on an
    edge flickers by its step, a tether stretches."""

    least_m: float = 0.15
    _anchor: tuple[float, float] | None = None
    _recent: deque[tuple[float, float]] = field(default_factory=deque)

    def add(self, time_s: float, way_m: float) -> None:
        """What the counter says at ``time_s``, in metres from anywhere."""
        if self._anchor is None:
            self._anchor = (time_s, way_m)
        self._recent.append((time_s, way_m))
        while self._recent[0][0] < time_s - KEPT_S:
            self._recent.popleft()
        if abs(way_m - self._anchor[1]) >= self.least_m:
            self._anchor = (time_s, way_m)

    @property
    def since_s(self) -> float | None:
        """Since when it has not moved; None before the first reading."""
        return None if self._anchor is None else self._anchor[0]

    def standing_s(self, time_s: float) -> float:
        """How long it has stood; 0 before the first reading."""
        return 0.0 if self._anchor is None else max(0.0, time_s - self._anchor[0])

    def moved_m(self, within_s: float) -> float:
        """How far apart the places are that it has been at within the last ``within_s`` seconds (30 at most)."""
        if not self._recent:
            return 0.0
        newest = self._recent[-1][0]
        ways = [way for moment, way in self._recent if moment >= newest - within_s]
        return max(ways) - min(ways)

    def forget(self) -> None:
        """The counter was changed: what it said before counts no more."""
        self._anchor = None
        self._recent.clear()
