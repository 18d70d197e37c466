"""What can go wrong with a sensor, on a timetable or at a test's command."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass

FAULTS = {
    "freeze": "the same picture again and again",
    "disconnect": "the cable is pulled, until a reconnect",
    "reconnect": "the cable is plugged in again",
    "late": "every tenth picture comes 1.5 s late",
    "slow": "two pictures a second",
    "wrong size": "half of every picture is missing",
    "all zero": "no depth anywhere, as with a covered window",
    "partial blackout": "no depth in the left two thirds",
    "garbage": "random bytes for depth",
    "never comes": "it starts and sends nothing",
    "hang": "the library does not return",
}
"""The faults that a depth camera's twin knows, in words."""
CCTV_FAULTS = {
    "freeze": "the same picture again and again",
    "disconnect": "the stream dies, until a reconnect",
    "reconnect": "the stream is there again",
    "dark": "the lamp is out",
    "garbage": "random bytes for a picture",
    "stall": "once a second a picture comes 100 ms late",
    "wrong size": "half of every picture is missing",
    "never comes": "it is plugged in and sends nothing",
    "hang": "the driver's call does not return",
}
"""The faults that the CCTV grabber's twin knows, in words."""
TETHER_FAULTS = {
    "freeze": "the counter stands, whatever the crawler does",
    "disconnect": "the plug is pulled, until a reconnect",
    "reconnect": "the plug is in again",
    "slip": "the tether slips through: way that is not counted",
    "jump back": "the counter falls back by a metre, once",
    "garbage": "bytes that are no reading",
    "stall": "once a second a reading comes 100 ms late",
    "never comes": "it is plugged in and sends nothing",
    "hang": "the driver's call does not return",
}
"""The faults that the tether encoder's twin knows, in words."""
STEREO_FAULTS = {
    "freeze": "the same pair again and again",
    "disconnect": "the cable is pulled, until a reconnect",
    "reconnect": "the cable is plugged in again",
    "dark": "the lamp is out",
    "garbage": "random bytes for pictures",
    "wrong size": "half of the right picture is missing",
    "never comes": "it is plugged in and sends nothing",
}
"""The faults that a stereo camera's twin knows, in words."""
_KNOWN = {**FAULTS, **CCTV_FAULTS, **TETHER_FAULTS, **STEREO_FAULTS}
CURES = ("none", "restart", "reset")
"""What ends a fault before its time: nothing, starting the streams again, or a reset of the hardware."""
FOREVER = float("inf")


@dataclass(frozen=True)
class Fault:
    """``name`` of one of the tables above, from ``at_s`` after the sensor was first started, for ``for_s`` seconds or until
    its ``cure``."""

    name: str
    at_s: float = 0.0
    for_s: float = FOREVER
    cure: str = "none"

    def __post_init__(self) -> None:
        if self.name not in _KNOWN:
            raise ValueError(f"there is no fault {self.name!r}, known are {', '.join(_KNOWN)}")
        if self.cure not in CURES:
            raise ValueError(f"a fault is cured by {', '.join(CURES)}, not by {self.cure!r}")
        if not self.at_s >= 0 or not self.for_s > 0:
            raise ValueError(f"the fault {self.name!r} needs a start from 0 s on and a length above 0 s")


class FaultScript:
    """The faults of one sensor. Any thread may ask, trigger and end; a script whose sensor was never started waits."""

    def __init__(self, faults: Iterable[Fault] = (), clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._lock = threading.Lock()
        self._began: float | None = None
        self._timetable = sorted(faults, key=lambda fault: fault.at_s)
        self._to_come = list(self._timetable)
        self._under_way: list[Fault] = []
        self._unplugged = 0

    def anew(self, clock: Callable[[], float]) -> FaultScript:
        """The same timetable from its beginning, by another ``clock``."""
        return FaultScript(self._timetable, clock)

    def begin(self) -> None:
        """The sensor is started: the first time sets the script's clock going."""
        with self._lock:
            self._began = self._clock() if self._began is None else self._began

    def trigger(self, name: str, for_s: float = FOREVER, cure: str = "none") -> None:
        """Let a fault begin now. Raises ValueError for one that is not known."""
        with self._lock:
            self._begin_fault(Fault(name, self._elapsed(), for_s, cure))

    def end(self, name: str | None = None) -> None:
        """End a fault, or all that are under way."""
        self._keep(lambda fault: name is not None and fault.name != name)

    def restarted(self) -> None:
        """The streams were started anew."""
        self._keep(lambda fault: fault.cure != "restart")

    def was_reset(self) -> None:
        """The hardware was reset."""
        self._keep(lambda fault: fault.cure == "none")

    def active(self) -> frozenset[str]:
        """Names of the faults under way."""
        with self._lock:
            self._go_on()
            return frozenset(fault.name for fault in self._under_way)

    def times_unplugged(self) -> int:
        """How often the cable has been pulled: streams that began before the last time are dead."""
        with self._lock:
            self._go_on()
            return self._unplugged

    def _elapsed(self) -> float:
        return 0.0 if self._began is None else self._clock() - self._began

    def _keep(self, wanted: Callable[[Fault], bool]) -> None:
        with self._lock:
            self._go_on()
            self._under_way = [fault for fault in self._under_way if wanted(fault)]

    def _go_on(self) -> None:
        """Begin what is due, in its order, and end what is over."""
        now = self._elapsed()
        while self._began is not None and self._to_come and self._to_come[0].at_s <= now:
            self._begin_fault(self._to_come.pop(0))
        self._under_way = [fault for fault in self._under_way if now < fault.at_s + fault.for_s]

    def _begin_fault(self, fault: Fault) -> None:
        if fault.name == "reconnect":
            self._under_way = [other for other in self._under_way if other.name != "disconnect"]
            return
        self._unplugged += fault.name == "disconnect"
        self._under_way.append(fault)
