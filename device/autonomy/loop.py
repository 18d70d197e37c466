"""The box while nobody looks: a thin loop that shows the rules of ``autonomy`` what there is and does what they say."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Sequence
from typing import Any

import cv2
import numpy as np

from device.autonomy.machine import REASONS, Action, Aiming, Autonomy, Condition, Crawling, Rules, Seen, wants_after
from device.clock import Clock
from device.diameter.live import LiveEstimates
from device.diameter.survey import DiameterSurvey
from device.errors import DeviceError, NotFound
from device.landmarks.crawler import Crawler
from device.landmarks.survey import LandmarkSurvey
from device.store import Store
from device.store.journal import LastTime, What
from drivers.grabber.base import VideoFrame
from estimators.pipe_view import PipeView, pipe_view

log = logging.getLogger(__name__)

PERIOD_S = 0.4
FRESH_S = 2.0
"""A picture or a reading that is older says nothing of now."""
_AWAKE_S = 3.0
_SWITCH = "log by itself"
_SURE = ("good", "fair")
"""Levels of the live estimate that are a pipe in view."""


class Unattended:
    """Surveys by itself while it is switched on: by the settings, or by the last word on the page.

    ``condition`` tells how the box is, ``lamp_rests`` whether it has put out its own lamp to save power; ``frames`` is the
    length of a measurement; ``turn`` is called with each turn of the loop.
    """

    def __init__(
        self,
        store: Store,
        clock: Clock,
        crawler: Crawler,
        drive: LandmarkSurvey,
        diameter: DiameterSurvey | None,
        live: LiveEstimates,
        condition: Callable[[], Condition],
        *,
        lamp_rests: Callable[[], bool] = lambda: False,
        enabled: bool = False,
        rules: Rules | None = None,
        frames: int = 50,
        period_s: float = PERIOD_S,
        turn: Callable[[], None] = lambda: None,
    ) -> None:
        self._store, self._clock, self._crawler = store, clock, crawler
        self._drive, self._diameter, self._live, self._condition = drive, diameter, live, condition
        self._lamp_rests = lamp_rests
        self._rules, self._frames, self._period_s, self._turn = rules or Rules(), frames, period_s, turn
        self._enabled = bool(store.remembered.get(_SWITCH).get("on", enabled))
        self._machine: Autonomy | None = None
        self._own: int | None = None
        self._news = 0
        self._continues: int | None = None
        self._last_time = LastTime()
        self._viewed: tuple[int, PipeView] | None = None
        self._lock = threading.Lock()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="autonomy", daemon=True)

    def start(self, last_time: LastTime) -> None:
        """Begin to look. ``last_time``: how the box last stopped."""
        self._last_time = last_time
        self._news = self._store.journal.news()
        if last_time.cut is not None and self._is_kept(last_time.cut):
            self._continues = last_time.cut
        self._thread.start()

    def close(self, wait_s: float = 5.0) -> None:
        """Stop looking; a drive under way is left to whoever closes the drives. May be called twice."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join(wait_s)
        if self._own is not None:
            self._write("end", self._own, "box_off", self._now())
            self._own = None

    def switch(self, on: bool) -> None:
        """Log by itself, or not; remembered. A drive that it has begun is ended when it is switched off."""
        self._store.remembered.put(_SWITCH, {"on": on})
        with self._lock:
            self._enabled = on
            if not on and self._machine is not None:
                for action in self._machine.switch_off(self._now()):
                    self._do(action)
                self._machine = None

    def state(self) -> dict[str, Any]:
        """{"on", "state", "survey_id" of its own drive, "holds": sentences why none is begun, "news": how many entries of the
        journal nobody has read}."""
        machine = self._machine
        return {
            "on": self._enabled,
            "state": "off" if machine is None or not self._enabled else machine.state,
            "survey_id": self._own,
            "holds": [] if machine is None else [REASONS[hold] for hold in machine.holds],
            "news": self._news,
        }

    def looked(self, entry: int) -> None:
        """Somebody has read the journal up to this entry."""
        self._store.journal.look(entry)
        self._news = self._store.journal.news()

    def _run(self) -> None:
        while not self._stop.wait(self._period_s):
            try:
                with self._lock:
                    self._look()
            except Exception:  # what fails now may work the next time; nobody is there to start it again
                log.exception("logging by itself stumbled")
            self._turn()

    def _look(self) -> None:
        if not self._enabled:
            return
        if self._machine is None:
            last = self._last_time
            self._machine = Autonomy(self._rules, self._continues is not None, wants_after(last.reason) if not last.cut else "")
            self._last_time = LastTime()
        for action in self._machine.step(Seen(self._now(), self._crawling(), self._aiming(), self._condition())):
            self._do(action)

    def _do(self, action: Action) -> None:
        log.info("by itself: %s. %s", action.what, REASONS[action.reason])
        if action.what == "begin":
            self._begin(action)
        elif action.what in ("end", "drop"):
            survey, self._own = self._own, None
            self._write("end" if action.what == "end" else "drop", survey, action.reason, action.at_s)
            if action.what == "drop":
                self._drive.cancel()
            elif action.reason != "ended":
                self._drive.end(None)
        elif action.what == "measure":
            assert self._diameter is not None  # nothing else tells of an aim
            try:
                survey = self._diameter.start(None, None, self._frames, None)
            except DeviceError as error:
                log.warning("by itself: no measurement, %s", error)
            else:
                self._write("measure", survey, action.reason, action.at_s)
        else:
            self._write(action.what, None, action.reason, action.at_s)

    def _begin(self, action: Action) -> None:
        assert self._machine is not None  # it said so
        continues = self._continues if action.reason == "power_back" else None
        begin_m = None if continues is None else self._store.drives.map(continues)["to_m"]
        try:
            self._own = self._drive.start(None, "downstream", None, begin_m, {"by_itself": True, "continues": continues})
        except DeviceError as error:
            log.warning("by itself: no drive, %s", error)
            self._machine.refused()
            return
        except Exception:
            self._machine.refused()
            raise
        self._continues = None
        self._write("begin", self._own, action.reason, action.at_s)

    def _write(self, what: What, survey_id: int | None, reason: str, at_s: float) -> None:
        try:
            self._store.journal.add(what, survey_id, reason, at_s)
            self._news += 1
        except DeviceError as error:  # a full disk: the surveys matter more
            log.error("the journal could not be written: %s", error)

    def _crawling(self) -> Crawling | None:
        if not self._drive.available:
            return None
        grabber, state = self._crawler.grabber, self._drive.state()
        assert grabber is not None  # a drive is not available without
        grabber.wake(_AWAKE_S)
        view = self._view(grabber.latest, grabber.status().age_s)
        finishing = state["state"] in ("finishing", "closing")
        return Crawling(
            lit=None if view is None else view.lit,
            pipe=None if view is None else view.pipe,
            way_m=self._way(state["chainage_m"]),
            busy=state["state"] != "idle" and not finishing,
            finishing=finishing,
        )

    def _view(self, frame: VideoFrame | None, age_s: float | None) -> PipeView | None:
        if frame is None or age_s is None or age_s > FRESH_S:
            return None
        if self._viewed is not None and self._lamp_rests():
            return self._viewed[1]  # it is dark because nothing moves
        if self._viewed is None or self._viewed[0] != frame.monotonic_ns:
            gray = np.asarray(cv2.cvtColor(frame.image, cv2.COLOR_BGR2GRAY), dtype=np.uint8)
            self._viewed = frame.monotonic_ns, pipe_view(gray)
        return self._viewed[1]

    def _way(self, chainage_m: float | None) -> float | None:
        tether = self._crawler.tether
        if tether is None:
            return chainage_m  # read from the picture, while a drive is under way
        reading, age_s = tether.feed.latest, tether.feed.status().age_s
        return None if reading is None or age_s is None or age_s > FRESH_S else tether.calibration.metres(reading)

    def _aiming(self) -> Aiming | None:
        if self._diameter is None:
            return None
        live = self._live.newest()
        if live is None or live["level"] not in _SURE:
            return Aiming(False, self._diameter.busy)
        newest = next(iter(self._store.surveys.summaries(None, 1, None)), None)
        accepted = newest is not None and newest["kind"] == "diameter" and newest["final_verdict"] == "accept"
        return Aiming(True, self._diameter.busy, accepted)

    def _is_kept(self, survey_id: int) -> bool:
        try:
            self._store.drives.map(survey_id)
        except NotFound:
            return False
        return True

    def _now(self) -> float:
        return self._clock.monotonic_ns() / 1e9


def told(entries: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """The journal as the page reads it, each entry with its sentence."""
    return [{**entry, "text": sentence(entry)} for entry in entries]


_SENTENCES = {
    "on": "The box was switched on.",
    "off": "The box was switched off.",
    "cut": "The power was cut: the box was not switched off as it should be.",
    "begin": "Survey {survey} began. {reason}",
    "end": "Survey {survey} ended. {reason}",
    "drop": "A survey was begun and dropped, the crawler never moved. {reason}",
    "measure": "Survey {survey}: a diameter was measured. {reason}",
    "held": "No survey was begun any more. {reason}",
    "released": "Surveys could begin again; before: {reason}",
}


def sentence(entry: dict[str, Any]) -> str:
    """One entry of the journal in words."""
    survey = "(deleted)" if entry["survey_id"] is None else entry["survey_id"]
    return _SENTENCES[entry["what"]].format(survey=survey, reason=REASONS.get(entry["reason"], "")).strip()
