"""The anomaly survey while somebody aims: a glance at the newest pair in the worker, about once a second.

The worker costs memory and the camera power: both are there while somebody looks, and for a while after.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from concurrent.futures import CancelledError, Future
from typing import Any

from device.anomaly.rig import StereoEye
from device.anomaly.work import work
from device.errors import Closed, DeviceError
from device.prompts import PROMPTS
from device.workers import Workers

log = logging.getLogger(__name__)

AWAKE_S = 12.0
"""How long one look keeps the camera running."""
IDLE_S = 180.0
"""How long the worker waits for another look before it ends."""
STALE_S = 6.0
LIMIT_S = 60.0
_REST_S = 0.5
_POOR = frozenset({"pair_dark", "pair_bright", "pair_no_match", "pair_no_wall", "pair_near", "pair_too_smooth", "pair_blurred"})


class PairWorker:
    """One process for pairs, begun when it is needed and ended when it no longer is."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._workers: Workers[Any] | None = None
        self._used = 0.0
        self._closed = False

    def give(self, *arguments: Any) -> Future[Any]:
        """As ``Workers.give`` of ``anomaly_work.work``. Raises Closed."""
        with self._lock:
            if self._closed:
                raise Closed("The device is shutting down.")
            if self._workers is None:
                self._workers = Workers(1, work, limit_s=LIMIT_S)
            self._used = time.monotonic()
            return self._workers.give(*arguments)

    def rest(self) -> None:
        """End the process where nobody has needed it for long."""
        with self._lock:
            idle = self._workers is not None and time.monotonic() - self._used > IDLE_S
        if idle:
            self._end(closed=False)

    def close(self) -> None:
        """May be called twice."""
        self._end(closed=True)

    def _end(self, closed: bool) -> None:
        with self._lock:
            self._closed = self._closed or closed
            workers, self._workers = self._workers, None
        if workers is not None:
            workers.close()


class AnomalyLive:
    """Calls ``on_look`` with each new live state. ``wake`` says that somebody looks."""

    def __init__(self, eye: StereoEye, worker: PairWorker, on_look: Callable[[], None]) -> None:
        self._eye = eye
        self._worker = worker
        self._on_look = on_look
        self._stop = threading.Event()
        self._awake_until = 0.0
        self._paused = False
        self._newest: tuple[float, dict[str, Any]] | None = None
        self.on_turn: Callable[[], None] = lambda: None
        """Called with each turn of the loop."""
        self._thread = threading.Thread(target=self._run, name="anomaly live", daemon=True)

    def start(self) -> None:
        """Begin to wait for somebody who looks."""
        self._thread.start()

    def close(self, wait_s: float = 2.0) -> None:
        """Stop. May be called twice."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join(wait_s)

    def wake(self) -> None:
        """Somebody looks."""
        self._awake_until = time.monotonic() + AWAKE_S
        self._eye.feed.wake(AWAKE_S)

    def pause(self, paused: bool) -> None:
        """While a scan has the worker nothing is looked at."""
        self._paused = paused

    def newest(self) -> dict[str, Any] | None:
        """The newest live state with its "age_s", "level" and "prompt"; None while there is none."""
        newest = self._newest
        if newest is None:
            return None
        age_s = time.monotonic() - newest[0]
        return None if age_s > STALE_S else {**newest[1], "age_s": round(age_s, 2)}

    def _run(self) -> None:
        looked = None
        while not self._stop.wait(_REST_S):
            self.on_turn()
            self._worker.rest()
            frame = self._eye.feed.latest
            asleep = time.monotonic() > self._awake_until
            if asleep or self._paused or frame is None or frame is looked:
                continue
            looked = frame
            try:
                self._look(frame)
            except Closed:
                return
            except DeviceError as error:
                log.warning("no live state of the stereo camera: %s", error)
            except Exception:  # the aiming aid may fail on a pair; the box must go on
                log.exception("the live state of the stereo camera failed")

    def _look(self, frame: Any) -> None:
        moment = time.monotonic()
        future = self._worker.give(False, frame.left, frame.right, self._eye.source.rig(frame))
        while not future.done():
            self.on_turn()
            if self._stop.wait(0.05):
                future.cancel()
                return
        try:
            seen = future.result()
        except CancelledError:
            return
        code = seen["code"]
        level = "good" if code is None else "poor" if code in _POOR else "fair"
        prompt = None if code is None else PROMPTS[code].to_json()
        self._newest = moment, {**seen, "level": level, "prompt": prompt, "frame": frame.number}
        self._on_look()
