"""Readings and scans of several sensors, put into the order of their times before they are mapped."""

from __future__ import annotations

import heapq
import itertools

from drivers.navigation.readings import NavReading
from drivers.navigation.scans import Scan

Event = NavReading | Scan

PATIENCE_S = 4.0
"""Readings wait for so long for a scan of their time."""
MOST_PATIENCE_S = 40.0


class InOrder:
    """A scan tells of a moment that is past when it comes, so readings wait for it.

    A scan frees what was read before it; where none comes, readings are freed after ``patience_s``. A scanner, or a box, that
    is slower than that is waited for longer from then on.
    """

    def __init__(self, patience_s: float = PATIENCE_S) -> None:
        self._patience_s = patience_s
        self._readings: list[tuple[float, int, NavReading]] = []
        self._count = itertools.count()
        self._gone_s = float("-inf")
        self.late = 0
        """Scans and readings that came after what is younger had been freed, and were left out."""

    def add(self, reading: NavReading) -> None:
        """A reading that has come."""
        if reading.time_s < self._gone_s:
            self.late += 1
            return
        heapq.heappush(self._readings, (reading.time_s, next(self._count), reading))

    def until(self, scan: Scan, now_s: float) -> list[Event]:
        """What ``scan``, which is there now, frees, and the scan itself last; nothing where it comes too late."""
        self._patience_s = min(max(self._patience_s, 1.5 * (now_s - scan.time_s)), MOST_PATIENCE_S)
        if scan.time_s < self._gone_s:
            self.late += 1
            return []
        return [*self._free(scan.time_s), scan]

    def waited(self, now_s: float) -> list[Event]:
        """What has waited for long enough."""
        return self._free(now_s - self._patience_s)

    def _free(self, until_s: float) -> list[Event]:
        found: list[Event] = []
        while self._readings and self._readings[0][0] <= until_s:
            found.append(heapq.heappop(self._readings)[2])
        if found or until_s > self._gone_s:
            self._gone_s = max(self._gone_s, until_s)
        return found
