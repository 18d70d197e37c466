"""The structure survey: a scanner is taken around the pipes of a chamber, and a map is made of them while it goes on.

One thread takes readings and scans, puts them in order and maps them. After each scan the map is made durable, then told.
"""

from __future__ import annotations

import logging
import threading
import time
from dataclasses import dataclass, field
from typing import Any

from device.bus import Bus
from device.errors import Busy, DeviceError, EstimateFailed, Invalid, StorageFull
from device.notify import Turns
from device.prompts import PROMPTS
from device.recorder import Recorder, Shelf
from device.recorder.chamber import scan_as_recorded
from device.recorder.samples import Words
from device.recorder.versions import versions
from device.store import Store
from device.structure.course import Course, CourseSetup, verdict
from device.structure.in_order import Event, InOrder
from device.structure.rig import ChamberRig
from device.surveys.topics import CHAMBER, ENDED, FINDINGS, PROMPTED
from drivers.navigation.scans import Scan

log = logging.getLogger(__name__)

TURN_LIMIT_S = 180.0
"""A survey that takes longer over one scan is stuck."""
TELL_S = 0.5
FIRST_S = 30.0
"""How long the first readings may take to come."""
_UNEXPECTED = "The survey failed inside the box; its log says why. What was mapped is kept."


@dataclass
class _Survey:
    """One survey under way. ``found`` is what was kept last."""

    survey_id: int
    node_id: int | None
    course: Course
    recorder: Recorder
    begun: float
    begun_ns: int
    order: InOrder = field(default_factory=InOrder)
    state: str = "waiting"
    found: dict[str, Any] | None = None
    dropped: int = 0
    ending: threading.Event = field(default_factory=threading.Event)
    cancelled: bool = False
    full: bool = False
    prompted: set[str] = field(default_factory=set)

    @property
    def seconds(self) -> float:
        """Since it began."""
        return round(time.monotonic() - self.begun, 1)


class StructureSurvey:
    """One survey at a time."""

    kind = "structure"

    def __init__(self, store: Store, bus: Bus, rig: ChamberRig, shelf: Shelf) -> None:
        self._store = store
        self._bus = bus
        self._rig = rig
        self._shelf = shelf
        self._lock = threading.RLock()
        self._survey: _Survey | None = None
        self._thread: threading.Thread | None = None
        self.turns = Turns()
        """Whom the survey's thread tells that it goes on."""

    @property
    def available(self) -> bool:
        """Whether this box has a scanner and the navigation that goes with it."""
        return self._rig.scanner is not None

    @property
    def busy(self) -> bool:
        """Whether a survey is under way."""
        return self._survey is not None

    def state(self) -> dict[str, Any]:
        """The survey and its sensors at this moment, see ``web_ui.openapi``. Never waits for a scan that is being mapped."""
        rig, survey = self._rig, self._survey
        scanner = [] if rig.scanner is None else [{"role": "scanner", **rig.scanner.to_json()}]
        sensors = [*scanner, *({"role": role, **feed.to_json()} for role, feed in rig.navigation.items())]
        common: dict[str, Any] = {
            "available": self.available,
            "state": "idle",
            "survey_id": None,
            "node_id": None,
            "seconds": 0.0,
            "scans": 0,
            "dropped": 0,
            "late": 0,
            "position": None,
            "sigma_m": None,
            "pipes": 0,
            "objects": 0,
            "unsure": 0,
            "consistent": True,
            "sensors": sensors,
            "prompts": [],
        }
        if survey is None:
            return common
        found = survey.found or {"scans": 0, "pipes": [], "objects": [], "uncertain": [], "consistent": True, "track": []}
        sigma = survey.course.sigma_m
        return {
            **common,
            "state": survey.state,
            "survey_id": survey.survey_id,
            "node_id": survey.node_id,
            "seconds": survey.seconds,
            "scans": found["scans"],
            "dropped": survey.dropped,
            "late": survey.order.late + survey.course.left_out,
            "position": found["track"][-1]["position"] if found["track"] else None,
            "sigma_m": None if sigma is None else round(sigma, 4),
            "pipes": len(found["pipes"]),
            "objects": len(found["objects"]),
            "unsure": len(found["uncertain"]),
            "consistent": found["consistent"],
            "prompts": [PROMPTS[code].to_json() for code in self._codes(survey)],
        }

    def start(self, node_id: int | None, seed: int = 0) -> int:
        """Begin to map a chamber; the survey's number. Raises Busy, NotFound, Invalid, StorageFull."""
        with self._lock:
            if self.busy:
                raise Busy("A structure survey is under way: end it or cancel it first.")
            scanner = self._rig.scanner
            if scanner is None:
                raise Invalid("This box has no scanner for chambers: name one in its settings, table [structure].")
            setup = CourseSetup.of(self._rig, seed)
            settings = {"radius_m": setup.radius_m, "upright": setup.upright, "scanner": scanner.name}
            survey_id = self._store.structures.begin(node_id, settings)
            head = {"kind": self.kind, "versions": versions(), "setup": setup.to_json(), "node_id": node_id}
            recorder = self._shelf.begin(survey_id, head)
            survey = _Survey(survey_id, node_id, Course(setup), recorder, time.monotonic(), time.monotonic_ns())
            self._survey = survey
            self._thread = threading.Thread(target=self._run, args=(survey,), name=f"structure {survey_id}", daemon=True)
            self._thread.start()
        log.info("structure survey %d: begun", survey_id)
        return survey_id

    def end(self) -> int:
        """All has been seen; the survey's number. Raises Invalid."""
        survey = self._going()
        survey.state = "finishing"
        survey.ending.set()
        return survey.survey_id

    def cancel(self) -> None:
        """Forget the survey under way, if there is one. Returns at once."""
        survey = self._survey
        if survey is not None:
            survey.cancelled = True
            survey.ending.set()

    def refuse_if_scanning(self, survey_id: int) -> None:
        """Raises Busy while this very survey goes on."""
        survey = self._survey
        if survey is not None and survey.survey_id == survey_id:
            raise Busy("This survey is under way: end it or cancel it.")

    def close(self, wait_s: float = 10.0) -> None:
        """Stop. A survey under way is kept as it stands, as interrupted. May be called twice."""
        survey = self._survey
        if survey is not None and not survey.ending.is_set():
            survey.state = "closing"
            survey.ending.set()
        if self._thread is not None:
            self._thread.join(wait_s)

    # The survey's own thread

    def _run(self, survey: _Survey) -> None:
        message, wanted, stored = "", True, ""
        try:
            self._go(survey)
            if survey.cancelled:
                wanted, message = False, "The survey was cancelled."
                self._store.structures.forget(survey.survey_id)
            else:
                stored = self._finish(survey)
        except DeviceError as error:
            message = str(error)
            log.error("structure survey %d: %s", survey.survey_id, error)
            stored = self._leave(survey)
        except Exception:  # the last net: what was stored so far stays
            log.exception("structure survey %d failed in an unexpected way", survey.survey_id)
            message = _UNEXPECTED
            stored = self._leave(survey)
        survey.recorder.close(discard=not wanted, wait_s=0.0)
        self.turns.over("structure")
        with self._lock:
            self._survey = None
        log.info("structure survey %d: %s%s", survey.survey_id, stored or "gone", f", {message}" if message else "")
        self._bus.publish(
            "structure", {**self.state(), "ended": survey.survey_id, "stored": stored or None, "message": message}
        )

    def _go(self, survey: _Survey) -> None:
        scans, readings = self._rig.scans(), self._rig.readings()
        self._rig.begin()
        tell_due = time.monotonic()
        turn = self.turns.loop("structure", TURN_LIMIT_S)
        try:
            while not survey.ending.is_set():
                turn()
                scan = scans.get(0.1)
                for tap in readings:
                    while (reading := tap.get(0.0)) is not None:
                        if reading.monotonic_ns >= survey.begun_ns:
                            survey.order.add(reading)
                survey.dropped = scans.dropped
                if scan is not None and scan.monotonic_ns >= survey.begun_ns:
                    self._take(survey, survey.order.until(scan_as_recorded(scan), time.monotonic()))
                if not scans.waiting:
                    self._take(survey, survey.order.waited(time.monotonic()))
                if survey.course.mapper is None and survey.seconds > FIRST_S:
                    raise EstimateFailed("No depth and attitude came: check pressure sensor and AHRS, then begin again.")
                if time.monotonic() >= tell_due:
                    tell_due = time.monotonic() + TELL_S
                    self._tell(survey)
        finally:
            scans.close()
            for tap in readings:
                tap.close()

    def _take(self, survey: _Survey, events: list[Event]) -> None:
        for event in events:
            if survey.cancelled or survey.state == "closing":
                return  # the box is being switched off: no time for another scan
            survey.recorder.write(CHAMBER, event)
            if survey.course.take(event) and isinstance(event, Scan):
                survey.state = "scanning" if survey.state == "waiting" else survey.state
                self._keep_if_possible(survey)

    def _keep_if_possible(self, survey: _Survey) -> None:
        _, found = survey.course.found()
        if found is None:
            return
        try:
            self._store.structures.keep(survey.survey_id, found, summary(found, survey.seconds))
            survey.found, survey.full = found, False  # what is told of has been stored
        except StorageFull as error:  # the survey goes on: the next scan's map is kept where there is room
            if not survey.full:
                log.error("structure survey %d: %s", survey.survey_id, error)
            survey.full = True

    def _finish(self, survey: _Survey) -> str:
        if survey.state == "closing":
            return self._leave(survey)
        found = concluded(survey.course)
        if found is None:
            self._store.structures.forget(survey.survey_id)
            raise EstimateFailed("No scan came, so there is nothing to keep: check the scanner, then begin again.")
        for prompt in found["prompts"]:
            survey.recorder.write(PROMPTED, Words(prompt["code"], f"{prompt['reason']} {prompt['remedy']}"))
        self._store.structures.keep(survey.survey_id, found, summary(found, survey.seconds), "saved")
        survey.found = found
        survey.recorder.write(ENDED, {"state": "saved"})
        survey.recorder.write(FINDINGS, found)
        return "saved"

    def _leave(self, survey: _Survey) -> str:
        """After a fault, and when the box is switched off: what has been kept stays, as interrupted; without a map it goes."""
        try:
            if survey.found is None:
                self._store.structures.forget(survey.survey_id)
                return ""
            found = survey.found
            self._store.structures.keep(survey.survey_id, found, summary(found, survey.seconds), "interrupted")
        except Exception:  # the store may be closed by now; the next start of the box calls it interrupted
            log.exception("structure survey %d could not be closed", survey.survey_id)
        return "interrupted"

    def _codes(self, survey: _Survey) -> list[str]:
        """What the operator is told just now, the weightiest first."""
        codes = ["storage_full"] if survey.full else []
        if survey.recorder.lost:
            codes.append("not_recorded")
        states = {role: feed.status().state for role, feed in self._rig.navigation.items()}
        if self._rig.scanner is not None and self._rig.scanner.status().state == "lost":
            codes.append("scanner_lost")
        codes += [f"{role}_lost" for role, state in states.items() if state == "lost" and f"{role}_lost" in PROMPTS]
        return codes + survey.course.codes()

    def _tell(self, survey: _Survey) -> None:
        state = self.state()
        for prompt in state["prompts"]:
            if prompt["code"] not in survey.prompted:
                survey.recorder.write(PROMPTED, Words(prompt["code"], f"{prompt['reason']} {prompt['remedy']}"))
        survey.prompted = {prompt["code"] for prompt in state["prompts"]}
        self._bus.publish("structure", {**state, "ended": None, "stored": None, "message": ""})

    def _going(self) -> _Survey:
        survey = self._survey
        if survey is None or survey.ending.is_set():
            raise Invalid("No structure survey is under way.")
        return survey


def concluded(course: Course) -> dict[str, Any] | None:
    """The whole map at the end, with its verdict; None without a scan."""
    course.smooth()
    _, found = course.found()
    if found is None:
        return None
    judged, codes = verdict(found)
    return {**found, "verdict": judged, "prompts": [PROMPTS[code].to_json() for code in codes]}


def summary(found: dict[str, Any], seconds: float) -> dict[str, Any]:
    """What the list of surveys says of it."""
    return {
        "pipes": len(found["pipes"]),
        "objects": len(found["objects"]),
        "unsure": len(found["uncertain"]),
        "scans": found["scans"],
        "consistent": found["consistent"],
        "seconds": seconds,
    }
