"""What every survey shares: one measurement at a time, in its own thread, with progress, cancel and always a clean end."""

from __future__ import annotations

import logging
import threading
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any

from device.bus import Bus
from device.errors import Busy, DeviceError, Invalid
from device.notify import Turns
from device.store import Store

log = logging.getLogger(__name__)

TURN_LIMIT_S = 120.0
"""A measurement that neither takes a frame nor ends for so long is stuck; the estimates within have limits of their own."""
_UNEXPECTED = "The measurement failed inside the box; its log says what. Measure again."


class Cancelled(Exception):
    """The operator pressed Cancel, or the device is shutting down."""


@dataclass(frozen=True)
class Job:
    """What to measure. ``continues``: a second position of a survey that has a recording already. ``chainage`` (m) is where the
    sensor stands in the pipe, where somebody said so."""

    survey_id: int
    pipe: dict[str, Any] | None
    position: str
    frames: int
    continues: bool
    chainage: float | None = None


@dataclass(frozen=True)
class Outcome:
    """How a measurement ended once it is durable: ``state`` "saved" or "failed", and the conclusion."""

    state: str
    message: str
    conclusion: dict[str, Any]


class Survey(ABC):
    """One kind of survey.

    It implements ``_measure``, which runs in the measuring thread, calls ``_progress`` and ``_check_cancelled`` often, makes
    its result durable and returns how it ended. Whatever it raises ends the measurement cleanly.
    """

    kind: str

    def __init__(self, store: Store, bus: Bus) -> None:
        self._store = store
        self._bus = bus
        self._lock = threading.Lock()
        self._cancel = threading.Event()
        self._thread: threading.Thread | None = None
        self._state: dict[str, Any] = _IDLE
        self.turns = Turns()
        """Whom the measuring thread tells that it goes on."""

    def state(self) -> dict[str, Any]:
        """{"state": "idle", "measuring" or "computing", "survey_id", "frames_done", "frames_wanted", "position"}."""
        return dict(self._state)

    @property
    def busy(self) -> bool:
        """Whether a measurement is under way."""
        return self._state is not _IDLE

    def refuse_if_measuring(self, survey_id: int) -> None:
        """Raises Busy while this very survey is being measured."""
        if self._state["survey_id"] == survey_id:
            raise Busy("This survey is being measured: wait for it or cancel it.")

    def start(
        self,
        pipe_id: int | None,
        position: str | None,
        frames: int,
        survey_id: int | None = None,
        chainage: float | None = None,
    ) -> int:
        """Begin to measure; the survey's number. Raises Busy, NotFound, Invalid, StorageFull."""
        with self._lock:
            if self.busy:
                raise Busy("A measurement is under way: wait for it or cancel it.")
            if survey_id is None:
                pipe = None if pipe_id is None else self._store.places.pipe(pipe_id)
                number = self._store.surveys.begin(self.kind, pipe_id)
                job = Job(number, pipe, position or "entrance", frames, False, chainage)
            else:
                survey = self._store.surveys.get(survey_id)
                if survey["kind"] != self.kind:
                    raise Invalid(f"Survey {survey_id} is no {self.kind} survey and cannot be continued as one.")
                continues = bool(survey["recordings"])  # not after a first try that failed
                self._store.surveys.reopen(survey_id)
                job = Job(survey_id, survey["pipe"], position or ("middle" if continues else "entrance"), frames, continues)
            self._cancel.clear()
            self._set(job, "measuring", 0)
            self._thread = threading.Thread(target=self._run, args=(job,), name=f"survey {job.survey_id}", daemon=True)
            self._thread.start()
        log.info("survey %d: measuring %d frames at the %s", job.survey_id, frames, job.position)
        return job.survey_id

    def cancel(self) -> None:
        """End the measurement under way, if there is one. Returns at once."""
        self._cancel.set()

    def close(self, wait_s: float = 5.0) -> None:
        """Cancel and wait. May be called twice."""
        self.cancel()
        if self._thread is not None:
            self._thread.join(wait_s)

    @abstractmethod
    def _measure(self, job: Job) -> Outcome: ...

    def _check_cancelled(self) -> None:
        self.turns.loop(self.kind, TURN_LIMIT_S)()
        if self._cancel.is_set():
            raise Cancelled

    def _progress(self, job: Job, state: str, frames_done: int, message: str = "") -> None:
        self._set(job, state, frames_done)
        self._tell(job, state, frames_done, message)

    def _set(self, job: Job, state: str, frames_done: int) -> None:
        self._state = {
            "state": state,
            "survey_id": job.survey_id,
            "frames_done": frames_done,
            "frames_wanted": job.frames,
            "position": job.position,
        }

    def _tell(self, job: Job, state: str, frames_done: int, message: str) -> None:
        self._bus.publish(
            "measurement",
            {
                "kind": self.kind,
                "survey_id": job.survey_id,
                "state": state,
                "frames_done": frames_done,
                "frames_wanted": job.frames,
                "message": message,
            },
        )

    def _run(self, job: Job) -> None:
        state, message = "failed", _UNEXPECTED
        prompts: list[dict[str, Any]] = []
        durable = False
        try:
            outcome = self._measure(job)
            state, message, prompts = outcome.state, outcome.message, outcome.conclusion["prompts"]
            durable = True
        except Cancelled:
            state, message = "cancelled", "The measurement was cancelled."
        except DeviceError as error:
            message = str(error)
        except Exception:  # the last net: an estimator's bug costs this measurement, not the daemon
            log.exception("survey %d failed in an unexpected way", job.survey_id)
        if not durable:
            self._forget(job)
        self.turns.over(self.kind)
        done = self._state["frames_done"]
        self._state = _IDLE
        log.info("survey %d: %s%s", job.survey_id, state, f", {message}" if message else "")
        self._tell(job, state, done, message)
        if prompts:
            self._bus.publish("prompt", {"kind": self.kind, "survey_id": job.survey_id, **prompts[0]})

    def _forget(self, job: Job) -> None:
        """Leave no half survey behind."""
        try:
            self._store.surveys.abandon(job.survey_id)
        except DeviceError as error:  # the next start of the device abandons it
            log.error("survey %d could not be abandoned: %s", job.survey_id, error)


_IDLE: dict[str, Any] = {"state": "idle", "survey_id": None, "frames_done": 0, "frames_wanted": 0, "position": None}
