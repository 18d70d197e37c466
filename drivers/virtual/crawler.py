"""One crawler, seen by its camera and counted by its tether: the clock and the plug that both twins have in common."""

from __future__ import annotations

import threading
import time

from drivers.base import FrameTimeout, SensorLost, SensorMissing
from drivers.virtual.faults import FaultScript

STALL_S = 0.1
"""How late something comes that was stalled."""
STALL_EACH_S = 1.0
_CHECK_S = 0.02


class DriveClock:
    """The moment of a drive of ``length_s``, in seconds since it began: 0 until ``begin``, standing while it is held, and at
    the end standing there or, with ``loop``, at the beginning again. ``rate`` 2 drives twice as fast. Any thread may ask."""

    def __init__(self, length_s: float, rate: float = 1.0, loop: bool = False) -> None:
        self._length_s, self._rate, self._loop = length_s, rate, loop
        self._lock = threading.Lock()
        self._gone_s = 0.0
        self._since: float | None = None

    def begin(self) -> None:
        """From the start node, now."""
        with self._lock:
            self._gone_s, self._since = 0.0, time.monotonic()

    def hold(self, held: bool) -> None:
        """Stand, or go on."""
        with self._lock:
            if held:
                self._gone_s, self._since = self._elapsed(), None
            elif self._since is None:
                self._since = time.monotonic()

    def now_s(self) -> float:
        """The moment of the drive."""
        with self._lock:
            gone = self._elapsed()
        return gone % self._length_s if self._loop else min(gone, self._length_s)

    def _elapsed(self) -> float:
        return self._gone_s + (0.0 if self._since is None else (time.monotonic() - self._since) * self._rate)


class Plug:
    """How a live twin is opened, waits, and is closed, unplugged, silent or hung."""

    def __init__(self, name: str, faults: FaultScript) -> None:
        self._name, self._faults = name, faults
        self._lock = threading.Lock()
        self._closed: threading.Event | None = None
        self._pulled = 0

    def open(self) -> None:
        """Raises SensorMissing where the cable is not in."""
        self.close()
        self._faults.begin()
        if "disconnect" in self._faults.active():
            raise SensorMissing(f"There is no {self._name}: it is not plugged in.")
        self._faults.restarted()
        with self._lock:
            self._closed, self._pulled = threading.Event(), self._faults.times_unplugged()

    def close(self) -> None:
        """Wakes whoever waits. May be called twice."""
        with self._lock:
            if self._closed is not None:
                self._closed.set()
            self._closed = None

    def wait(self, until: float, timeout_s: float, silence: str) -> frozenset[str]:
        """Until the moment ``until`` of time.monotonic; gives the faults under way then. Raises SensorLost where it is closed
        or unplugged, FrameTimeout with ``silence`` where nothing comes within ``timeout_s``."""
        deadline = time.monotonic() + timeout_s
        with self._lock:
            closed = self._closed
        while True:
            active = self._faults.active()
            if closed is None or closed.is_set():
                raise SensorLost(f"The {self._name} is not open.")
            if self._faults.times_unplugged() != self._pulled or "disconnect" in active:
                raise SensorLost(f"The {self._name} was unplugged.")
            now = time.monotonic()
            silent = not active.isdisjoint(("never comes", "hang"))
            if now >= until and not silent:
                return active
            if now >= deadline and "hang" not in active:
                raise FrameTimeout(f"The {self._name} sent {silence} for {timeout_s:.3g} s.")
            closed.wait(_CHECK_S if silent else max(0.0, min(until, deadline, now + 10 * _CHECK_S) - now))
