"""The lamp of the box: driven by the page's slider or by the pictures, put out on standstill, tried again when it fails."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from typing import Any

from device.errors import Invalid, StorageFull
from device.feeds.feed import Feed
from device.lamp.control import LampControl, LampRules, exposure
from device.landmarks.tether import Tether
from device.store.drives import Remembered
from drivers.base import DriverError
from drivers.grabber.base import VideoFrame
from drivers.lamp.base import Lamp

log = logging.getLogger(__name__)

PERIOD_S = 0.2
RETRY_S = 5.0
MOVED_M = 0.01
_NAME = "lamp"


class LampKeeper:
    """One thread that keeps ``lamp`` as bright as it should be. ``grabber`` and ``tether`` tell of exposure and of way."""

    def __init__(
        self,
        lamp: Lamp,
        remembered: Remembered,
        grabber: Feed[VideoFrame] | None,
        tether: Tether | None,
        *,
        rules: LampRules | None = None,
        on_change: Callable[[], None] = lambda: None,
    ) -> None:
        self._lamp, self._remembered, self._grabber, self._tether = lamp, remembered, grabber, tether
        self._on_change = on_change
        kept = remembered.get(_NAME)
        level = kept.get("level")
        known = isinstance(level, int | float) and 0 <= level <= 1
        self._control = LampControl(rules, level if known else None, bool(kept.get("automatic", True)))
        self._lock = threading.Lock()
        self._stop = threading.Event()
        self._wake = threading.Event()
        self._shining: float | None = None
        self._message = "The lamp is being switched on."
        self._seen_ns = 0
        self._metres: float | None = None
        self._thread = threading.Thread(target=self._run, name="lamp", daemon=True)

    def start(self) -> None:
        """Switch it on. Returns at once."""
        self._thread.start()

    def close(self, wait_s: float = 2.0) -> None:
        """Put it out and let go of it. May be called twice."""
        self._stop.set()
        self._wake.set()
        if self._thread.is_alive():
            self._thread.join(wait_s)
        self._lamp.close()

    def state(self) -> dict[str, Any]:
        """{"name", "automatic", "level" as set or chosen, "shining" at this moment (None: it fails), "resting", "message"}."""
        control = self._control
        return {
            "name": self._lamp.name,
            "automatic": control.automatic,
            "level": round(control.level, 3),
            "shining": None if self._shining is None else round(self._shining, 3),
            "resting": control.resting,
            "message": self._message,
        }

    def set(self, level: float | None = None, automatic: bool | None = None) -> dict[str, Any]:
        """What the page says: a level turns the automatic off unless it says otherwise. The state. Raises Invalid."""
        if level is None and automatic is None:
            raise Invalid("Say how bright the lamp should be, or that it is automatic.")
        if level is not None and not 0 <= level <= 1:
            raise Invalid("The lamp shines between 0 and 1.")
        with self._lock:
            control = self._control
            control.automatic = bool(automatic) if automatic is not None else False
            if level is not None:
                control.level = level
            elif control.automatic and control.level < control.rules.lowest:
                control.level = control.rules.begin
            control.stir(time.monotonic())
            chosen = {"level": control.level, "automatic": control.automatic}
        self._wake.set()
        try:
            self._remembered.put(_NAME, chosen)
        except StorageFull as error:  # the lamp obeys all the same; after a restart it is as it was before
            log.warning("the lamp's setting is not kept: %s", error)
        return self.state()

    def look(self) -> None:
        """Somebody looks at the picture: let there be light."""
        with self._lock:
            self._control.stir(time.monotonic())

    def _run(self) -> None:
        opened = False
        while not self._stop.is_set():
            try:
                if not opened:
                    self._lamp.open()
                    opened = True
                self._turn()
                self._say("")
                self._wake.wait(PERIOD_S)
            except DriverError as error:
                opened = False
                self._shining = None
                self._say(str(error))
                self._stop.wait(RETRY_S)
            self._wake.clear()

    def _turn(self) -> None:
        now_s = time.monotonic()
        seen = self._exposure()
        with self._lock:
            if self._moved():
                self._control.stir(now_s)
            level = self._control.step(now_s, seen, may_rest=self._tether is not None)
        if level != self._shining:
            self._lamp.set(level)
            went_out = self._shining not in (None, 0.0) and level == 0.0
            self._shining = level
            if went_out:
                log.info("%s: out, nothing moves", self._lamp.name)
            self._on_change()

    def _exposure(self) -> float | None:
        frame = None if self._grabber is None else self._grabber.latest
        if frame is None or frame.monotonic_ns <= self._seen_ns or not self._shining:
            return None
        self._seen_ns = frame.monotonic_ns
        return exposure(frame.image)

    def _moved(self) -> bool:
        if self._tether is None:
            return False
        metres = self._tether.state()["metres"]
        if metres is None or (self._metres is not None and abs(metres - self._metres) < MOVED_M):
            return False
        self._metres = metres
        return True

    def _say(self, message: str) -> None:
        if message == self._message:
            return
        log.log(logging.WARNING if message else logging.INFO, "%s: %s", self._lamp.name, message or "shines")
        self._message = message
        self._on_change()
