"""The box's eye on itself: reads how it is every few seconds, tells when that matters, and wakes a hotspot that went silent."""

from __future__ import annotations

import logging
import shutil
import threading
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from device.bus import Bus
from device.clock import Clock
from device.feeds.feed import Feed
from device.health.machine import MachineReader
from device.health.readings import Health, HotspotState, SensorHealth, concerns
from device.memory import give_back
from device.prompts import PROMPTS

log = logging.getLogger(__name__)

PERIOD_S = 5.0
GIVE_BACK_S = 30.0
"""How often memory that lies free is given back."""
HOTSPOT_PACE_S = (10.0, 60.0, 300.0)
"""How long the hotspot has to be silent before it is started anew, and again each time that did not help."""


class HotspotWatch:
    """When the hotspot is to be started anew. Knows no clock: ``step`` is told the time."""

    def __init__(self, pace_s: tuple[float, ...] = HOTSPOT_PACE_S) -> None:
        self._pace_s = pace_s
        self._silent_since: float | None = None
        self._tries = 0

    def step(self, now_s: float, state: HotspotState) -> bool:
        """Whether to start it now. A box whose settings name a hotspot wants it: "off" is as silent as stuck."""
        if state in ("up", "unknown"):
            self._silent_since, self._tries = None, 0
            return False
        if self._silent_since is None:
            self._silent_since = now_s
        if now_s - self._silent_since < self._pace_s[min(self._tries, len(self._pace_s) - 1)]:
            return False
        self._silent_since = now_s
        self._tries += 1
        return True


class HealthWatch:
    """Knows the newest ``Health``; publishes "health" when a reading is there and "prompt" when something begins to matter.

    ``sensors`` are looked at with every call of ``now``, the computer every ``period_s`` in threads of their own: helper
    programs may hang, and neither the page nor the surveys wait for them. ``keep`` takes each reading into the survey's log.
    """

    def __init__(
        self,
        reader: MachineReader,
        folder: Path,
        clock: Clock,
        bus: Bus,
        sensors: Iterable[tuple[str, Feed[Any]]],
        *,
        period_s: float = PERIOD_S,
        hotspot_pace_s: tuple[float, ...] = HOTSPOT_PACE_S,
        turn: Callable[[], None] = lambda: None,
        keep: Callable[[dict[str, Any]], None] = lambda health: None,
    ) -> None:
        self._reader, self._folder, self._clock, self._bus = reader, folder, clock, bus
        self._sensors = tuple(sensors)
        self._period_s = period_s
        self._hotspot = HotspotWatch(hotspot_pace_s)
        self._restoring: threading.Thread | None = None
        self._restored = 0
        self._turn = turn
        self._keep = keep
        self._stop = threading.Event()
        self._machine = reader.quick()
        self._codes: frozenset[str] = frozenset()
        self._ordered: tuple[str, ...] = ()
        self._thread = threading.Thread(target=self._run, name="health", daemon=True)

    def start(self) -> None:
        """Begin to look. Returns at once."""
        self._thread.start()

    def close(self, wait_s: float = 4.0) -> None:
        """Stop. May be called twice."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join(wait_s)

    def now(self) -> Health:
        """How the box is; what the computer says is some seconds old."""
        free_mb, total_mb = _disk(self._folder)
        return Health(
            disk_free_mb=free_mb,
            disk_total_mb=total_mb,
            clock=self._clock.source,
            machine=self._machine,
            sensors=tuple(_sensor(role, feed) for role, feed in self._sensors),
            hotspot_restored=self._restored,
        )

    def prompts(self) -> list[dict[str, str]]:
        """What the operator should know just now, the weightiest first."""
        return [PROMPTS[code].to_json() for code in self._ordered]

    def to_json(self) -> dict[str, Any]:
        """``now`` and ``prompts`` for the page."""
        return {**self.now().to_json(), "prompts": self.prompts()}

    def _run(self) -> None:
        give_back_due = time.monotonic() + GIVE_BACK_S
        while True:
            if time.monotonic() >= give_back_due:
                give_back_due = time.monotonic() + GIVE_BACK_S
                give_back()
            try:
                self.look()
            except Exception:  # the box measures on, whatever a reading did
                log.exception("the health of the box could not be read")
            self._turn()
            if self._stop.wait(self._period_s):
                return

    def look(self) -> None:
        """One reading, told to whoever listens."""
        self._machine = self._reader.read()
        health = self.now()
        self._ordered = concerns(health, self._codes)
        codes = frozenset(self._ordered)
        for code in self._ordered:
            if code not in self._codes:
                log.warning("%s %s", PROMPTS[code].reason, PROMPTS[code].remedy)
                self._bus.publish("prompt", {"survey_id": None, **PROMPTS[code].to_json()})
        for code in sorted(self._codes - codes):
            log.info("over: %s", PROMPTS[code].reason)
        self._codes = codes
        told = {**health.to_json(), "prompts": self.prompts()}
        self._bus.publish("health", told)
        self._keep(told)
        if self._hotspot.step(time.monotonic(), health.machine.hotspot):
            self._restore_hotspot()

    def _restore_hotspot(self) -> None:
        if self._restoring is not None and self._restoring.is_alive():
            return
        self._restored += 1
        log.error("the hotspot is silent: starting it anew, for the %d. time", self._restored)
        self._restoring = threading.Thread(target=self._reader.restore_hotspot, name="hotspot", daemon=True)
        self._restoring.start()


def _disk(folder: Path) -> tuple[int, int]:
    """Free and all megabytes; nothing free where the card was pulled out."""
    try:
        usage = shutil.disk_usage(folder)
    except OSError:
        return 0, 0
    return usage.free // 1_000_000, usage.total // 1_000_000


def _sensor(role: str, feed: Feed[Any]) -> SensorHealth:
    status = feed.status()
    age_s = None if status.age_s is None else round(status.age_s, 2)
    return SensorHealth(
        role, feed.name, status.state, age_s, round(status.fps, 1), status.drops, status.bad_frames, status.reconnects
    )
