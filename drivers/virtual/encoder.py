"""The twin of the tether encoder: what the counter of a drive through the virtual sewer shows, live or as a recording."""

from __future__ import annotations

import math
import time
from typing import Protocol

from drivers.base import EndOfRecording, SensorLost
from drivers.encoder.base import Encoder, Reading
from drivers.virtual.crawler import STALL_EACH_S, STALL_S, DriveClock, Plug
from drivers.virtual.faults import FaultScript

HZ = 20.0
JUMP_M = 1.0
_FINEST_M = 1e-6
"""Step of a counter without steps."""


class Wheel(Protocol):
    """What counts: a ``Drive``."""

    length_s: float

    def encoder(self, t: float) -> float: ...

    @property
    def quantum(self) -> float: ...


class _Counter:
    """The wheel with what faults make of its count. ``per_metre`` counts make a metre; None counts in metres."""

    def __init__(self, wheel: Wheel, per_metre: float | None) -> None:
        self._wheel, self._per_metre = wheel, per_metre
        self._lost_m = 0.0
        self._last_m: float | None = None
        self._shown_m = 0.0
        self._jumped = False

    def reading(self, t: float, active: frozenset[str], taken: int, media_s: float | None) -> Reading:
        metres = self._wheel.encoder(t)
        if "slip" in active and self._last_m is not None:
            self._lost_m += metres - self._last_m
        if "jump back" in active and not self._jumped:
            self._lost_m += JUMP_M
        self._jumped = "jump back" in active
        self._last_m = metres
        if "freeze" not in active:
            self._shown_m = metres - self._lost_m
        step_m = self._wheel.quantum or _FINEST_M
        if self._per_metre is None:
            return Reading(self._shown_m, taken, "m", step_m, media_s)
        counts = float(round(self._shown_m * self._per_metre))
        return Reading(counts, taken, "counts", max(1.0, step_m * self._per_metre), media_s)


class VirtualEncoder(Encoder):
    """Live: what the counter of the crawler of ``clock`` shows, ``hz`` times a second, in metres or, with ``per_metre``, in
    counts. The counter runs on while it is unplugged, as the wheel turns. Faults are those of TETHER_FAULTS."""

    name = "virtual tether"

    def __init__(
        self,
        wheel: Wheel,
        clock: DriveClock,
        faults: FaultScript | None = None,
        per_metre: float | None = None,
        hz: float = HZ,
    ) -> None:
        self.faults = faults or FaultScript()
        self._clock, self._hz = clock, hz
        self._plug = Plug(self.name, self.faults)
        self._counter = _Counter(wheel, per_metre)
        self._due = self._stalled_at = 0.0

    def _open(self) -> None:
        self._plug.open()
        self._due = self._stalled_at = time.monotonic()

    def _read(self, timeout_s: float) -> Reading:
        deadline = time.monotonic() + timeout_s
        while True:
            active = self._plug.wait(self._due, max(0.0, deadline - time.monotonic()), "no reading")
            self._due = max(self._due + 1 / self._hz, time.monotonic())
            if "garbage" not in active:
                break
            self.rejected += 1
        t = self._clock.now_s()
        if "stall" in active and time.monotonic() - self._stalled_at > STALL_EACH_S:
            time.sleep(STALL_S)
            self._stalled_at = time.monotonic()
        return self._counter.reading(t, active, time.monotonic_ns(), None)

    def close(self) -> None:
        self._plug.close()


class VirtualCount(Encoder):
    """The readings of the whole drive as a recording; opened again it begins again. Faults befall it by its own time; what a
    live encoder would not have sent is missing from it."""

    name = "virtual tether recording"

    def __init__(self, wheel: Wheel, faults: FaultScript | None = None, per_metre: float | None = None, hz: float = HZ) -> None:
        self._wheel, self._given, self._per_metre, self._hz = wheel, faults, per_metre, hz
        self.faults = faults or FaultScript()
        self._counter = _Counter(wheel, per_metre)
        self._media_s = 0.0
        self._next: int | None = None

    def _open(self) -> None:
        self._next, self._media_s, self._counter = 0, 0.0, _Counter(self._wheel, self._per_metre)
        self.faults = (self._given or FaultScript()).anew(lambda: self._media_s)
        self.faults.begin()

    def _read(self, timeout_s: float) -> Reading:
        if self._next is None:
            raise SensorLost(f"The {self.name} is not open.")
        while self._next < math.floor(self._wheel.length_s * self._hz):
            turned_s = came_s = self._next / self._hz
            self._media_s = turned_s
            active = self.faults.active()
            self._next += 1
            if "stall" in active and self._next % round(STALL_EACH_S * self._hz) == 0:
                came_s = turned_s + STALL_S
                self._next += math.ceil(STALL_S * self._hz)
            self.rejected += "garbage" in active
            reading = self._counter.reading(turned_s, active, time.monotonic_ns(), came_s)
            if active.isdisjoint(("disconnect", "never comes", "hang", "garbage")):
                return reading
        raise EndOfRecording("The virtual drive is at its end.")

    def close(self) -> None:
        self._next = None
