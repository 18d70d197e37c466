"""What went wrong during a drive, as events: each with its moment and place, for the page and for the record."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from device.feeds.feed import FeedStatus
from device.prompts import PROMPTS

LASTING_S = 1.0
"""A prompt that stays so long is an event."""
QUIET_S = 10.0
"""A prompt that comes back sooner than this is the same event."""
_NAMES = {"grabber": "The CCTV picture", "encoder": "The tether encoder"}


class FaultWatch:
    """Compares each moment with the one before. ``now`` first, then what there is to compare."""

    def __init__(self) -> None:
        self._time_s = 0.0
        self._chainage: float | None = None
        self._down: dict[str, float] = {}
        self._back: dict[str, float] = {}
        self._flapping: set[str] = set()
        self._since: dict[str, float] = {}
        self._last: dict[str, float] = {}
        self._recorded: set[str] = set()
        self._jumps = 0
        self._all: list[dict[str, Any]] = []
        self._told = self._kept = 0

    def now(self, time_s: float, chainage: float | None) -> None:
        """Seconds since the drive began and where the crawler is (m), None where nobody knows."""
        self._time_s, self._chainage = time_s, chainage

    def feed(self, what: str, status: FeedStatus) -> None:
        """How the source called ``what`` is doing. One that fails again as soon as it is back is one event, not many."""
        steady = self._time_s - self._back.get(what, -QUIET_S) >= QUIET_S
        if status.state == "up":
            if steady:
                self._flapping.discard(what)
            since = self._down.pop(what, None)
            if since is not None:
                self._back[what] = self._time_s
                if what not in self._flapping:
                    self._add(f"{what}_back", f"{_NAMES[what]} is back after {self._time_s - since:.1f} s.")
        elif what not in self._down:
            self._down[what] = self._time_s
            if not steady and what not in self._flapping:
                self._flapping.add(what)
                self._add(f"{what}_lost", f"{_NAMES[what]} fails again and again: {status.message or 'nothing comes.'}")
            elif steady and (status.state != "starting" or status.frames):
                self._add(f"{what}_lost", f"{_NAMES[what]} failed: {status.message or 'nothing comes.'}")

    def jumps(self, jumps: Sequence[tuple[float, float]]) -> None:
        """All jumps (s, m) of the counter so far."""
        for _, metres in jumps[self._jumps :]:
            self._add("encoder_jump", f"The counter jumped by {metres:+.2f} m; the way goes on from where it was.")
        self._jumps = max(self._jumps, len(jumps))

    def counter_set(self, before: float, after: float) -> None:
        """The counter of a recording went from ``before`` to ``after`` (m) at this moment."""
        self._add(
            "encoder_jump",
            f"The counter was set from {before:.2f} m to {after:.2f} m; only the longest stretch between is mapped.",
        )

    def codes(self, codes: Sequence[str]) -> None:
        """The prompts of this moment."""
        for code in codes:
            if self._time_s - self._last.get(code, -QUIET_S) >= QUIET_S:
                self._since[code] = self._time_s
                self._recorded.discard(code)
            self._last[code] = self._time_s
            if code not in self._recorded and self._time_s - self._since[code] >= LASTING_S and not code.endswith("_lost"):
                self._recorded.add(code)
                self._add(code, PROMPTS[code].reason)

    def untold(self) -> list[dict[str, Any]]:
        """Events since the last call."""
        fresh, self._told = self._all[self._told :], len(self._all)
        return fresh

    def unkept(self) -> list[dict[str, Any]]:
        """Events that are not durable yet."""
        return self._all[self._kept :]

    def were_kept(self, count: int) -> None:
        """So many more are durable."""
        self._kept += count

    def _add(self, what: str, text: str) -> None:
        chainage = None if self._chainage is None else round(self._chainage, 3)
        self._all.append({"time_s": round(self._time_s, 2), "chainage_m": chainage, "what": what, "text": text})
