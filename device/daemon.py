"""The box behind one door: ``Device`` is all that the page, the API and the command line see of it."""

from __future__ import annotations

import fcntl
import logging
import os
import shutil
import threading
import time
from collections.abc import Callable
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import IO, Any

from device.access import Access, pin_of
from device.anomaly.desk import AnomalyDesk
from device.anomaly.rig import StereoEye, make_stereo
from device.autonomy.loop import Unattended, told
from device.autonomy.machine import Condition
from device.bus import Bus, Subscription
from device.clock import Clock
from device.config import Settings
from device.diameter import clouds
from device.diameter.live import LiveEstimates
from device.diameter.survey import DiameterSurvey
from device.durable import make_folder
from device.errors import DeviceError, Invalid, NotFound, StorageFull, StoreUnusable
from device.feeds.cameras import feeds as make_feeds
from device.feeds.feed import CameraFeed
from device.health.machine import MachineReader
from device.health.watch import HealthWatch
from device.inspections.desk import Desk
from device.lamp.keeper import LampKeeper
from device.landmarks.crawler import Crawler
from device.landmarks.crawlers import make_crawler
from device.landmarks.desk import DriveDesk
from device.notify import Turns
from device.pictures import PICTURE_KINDS, PictureCache
from device.prompts import PROMPTS
from device.recorder import Shelf
from device.recorder.desk import RecordingDesk, keep_outcome
from device.recorder.policy import MB, DiskPolicy
from device.recorder.shelf import FOLDER
from device.store import Store
from device.store.journal import LastTime
from device.store.surveys import QUESTIONS
from device.structure.desk import StructureDesk
from device.structure.rig import make_rig
from device.workers import WorkerPool
from drivers.lamp.base import Lamp

log = logging.getLogger(__name__)

POSITIONS = ("entrance", "top", "middle")
HEALTH_TOPIC = "/health"
_STATUS_PERIOD_S = 1.0
_ROOM_AGAIN = 1.2
"""There is room again for surveys by itself where so many times the reserve is free: a value at the edge must not flicker."""
_MOST_FRAMES = 500


class Device:
    """Cameras, workers, survey and store of one box, started by ``start`` and stopped by ``close``.

    Raises StoreUnusable where the data folder cannot be used, Invalid where the settings name what cannot be. ``feeds``,
    ``pool``, ``crawler`` and ``eye`` stand in for what the settings would make. What the methods return is JSON-ready; their
    errors are DeviceErrors.
    """

    def __init__(
        self,
        settings: Settings,
        *,
        feeds: list[CameraFeed] | None = None,
        pool: WorkerPool | None = None,
        clock: Clock | None = None,
        crawler: Callable[[Store], Crawler] | None = None,
        eye: StereoEye | None = None,
    ) -> None:
        self.settings = settings
        self._begun = time.monotonic()
        self._bus = Bus()
        self._clock = clock or Clock(settings.machine.root)
        self.turns = Turns()
        """The loops of this box, for whoever feeds a watchdog."""
        self._changed = threading.Event()
        self._stop = threading.Event()
        self._feeds = make_feeds(settings, self._changed.set) if feeds is None else feeds
        self._lock_file = _lock(settings.data_dir)
        self._pictures = PictureCache()
        try:
            self._store = Store(settings.data_dir, self._clock)
        except DeviceError:
            self._lock_file.close()
            raise
        try:
            self.access = Access(
                settings.pin or pin_of(settings.data_dir),
                folder=settings.data_dir,
                publish=lambda state: self._bus.publish("control", state),
            )
            rig = make_rig(settings.structure, settings.virtual_seed, self._feeds, self._changed.set)
            eye = eye or make_stereo(settings.stereo, settings.virtual_seed, self._changed.set)
            pairs = None if eye is None else eye.feed
            self._crawler = (crawler or partial(make_crawler, settings, pairs=pairs, on_change=self._changed.set))(self._store)
        except DeviceError:
            self._store.close()
            self._lock_file.close()
            raise
        self.places = self._store.places
        self.inspections = Desk(self._store, self._clock)
        self._shelf = Shelf(
            settings.data_dir / FOLDER,
            _disk_policy(settings),
            enabled=settings.recording.enabled,
            part_bytes=settings.recording.part_mb * MB,
            offset_ns=self._clock_offset_ns,
            on_change=self._changed.set,
            on_end=partial(keep_outcome, self._store),
            first_notes=lambda: {HEALTH_TOPIC: self._health.to_json()},
        )
        self.recordings = RecordingDesk(self._store, self._shelf)
        self._lamp = None if self._crawler.lamp is None else self._make_lamp(self._crawler.lamp)
        self.drive = DriveDesk(
            self._store,
            self._bus,
            self._crawler,
            self._shelf,
            self._lamp,
            turns=self.turns,
            refuse_without_room=self._refuse_without_room,
        )
        self.structure = StructureDesk(
            self._store, self._bus, rig, self._shelf, turns=self.turns, refuse_without_room=self._refuse_without_room
        )
        self.anomaly = AnomalyDesk(
            settings.stereo,
            eye,
            self._store,
            self._bus,
            self._shelf,
            self._pictures,
            self._crawler.tether,
            on_crawler=self._crawler.grabber is not None and self._crawler.grabber.kind == "stereo",
            turns=self.turns,
            refuse_without_room=self._refuse_without_room,
        )
        self._pool = pool or WorkerPool(settings.workers)
        self._live = LiveEstimates(self._feeds, self._pool, self._bus, settings.live_hz)
        self._survey = DiameterSurvey(self._store, self._bus, self._feeds, self._pool, self._live, self._shelf)
        self._health = HealthWatch(
            MachineReader(settings.machine),
            settings.data_dir,
            self._clock,
            self._bus,
            [("camera", feed) for feed in self._feeds]
            + self.drive.sensors()
            + self.structure.sensors()
            + self.anomaly.sensors(),
            turn=self.turns.loop("health", 120.0),
            keep=lambda health: self._shelf.note(HEALTH_TOPIC, health),
        )
        for feed in self._feeds:
            feed.on_turn = self.turns.loop(f"watchdog of {feed.name}", 15.0)
        self._live.on_turn = self.turns.loop("live estimates", 30.0)
        self._survey.turns = self.turns
        self._unattended = Unattended(
            self._store,
            self._clock,
            self._crawler,
            self.drive.survey,
            self._survey if self._feeds else None,
            self._live,
            self._condition,
            lamp_rests=lambda: self._lamp is not None and bool(self._lamp.state()["resting"]),
            enabled=settings.autonomy.enabled,
            rules=settings.autonomy.made(),
            frames=settings.frames,
            turn=self.turns.loop("autonomy", 60.0),
        )
        self._started = self._disk_low = False
        self._announcer = threading.Thread(target=self._announce, name="status", daemon=True)

    def start(self) -> Device:
        """Begin to read the cameras and to publish. Returns at once."""
        try:
            last_time = self._store.journal.switched_on()
        except StorageFull as error:  # a box on a full disk has to start: how else would somebody make room
            log.error("the journal could not be begun: %s", error)
            last_time = LastTime()
        self._started = True
        if last_time.unsafe:
            log.warning("the box was not switched off the last time: its power was cut, or it was killed")
        unfinished = self._store.surveys.abandon_unfinished()
        if unfinished:
            log.warning("%d measurement(s) were cut off when the box last stopped and are gone", unfinished)
        interrupted = self._store.drives.interrupt_unfinished()
        if interrupted:
            log.warning("%d drive(s) were cut off when the box last stopped and are kept as far as they went", interrupted)
        chambers = self._store.structures.interrupt_unfinished()
        if chambers:
            log.warning(
                "%d structure survey(s) were cut off when the box last stopped and are kept as far as they went", chambers
            )
        purged = self._store.surveys.purge(self.settings.purge_days)
        if purged:
            log.info("%d survey(s) deleted more than %d days ago were removed", len(purged), self.settings.purge_days)
        for survey in purged:
            self._shelf.remove(survey)
        for feed in self._feeds:
            feed.start()
        self.drive.start()
        self.structure.start()
        self.anomaly.start()
        self._live.start()
        threading.Thread(target=self._shelf.recover_all, name="recovery", daemon=True).start()
        self._health.start()
        self._unattended.start(last_time)
        if self._lamp is not None:
            self._lamp.start()
        self._announcer.start()
        return self

    def close(self) -> None:
        """Stop everything, cleanly. May be called twice."""
        self._stop.set()
        self._changed.set()
        self._bus.close()
        self._unattended.close()
        self.drive.close()
        self.structure.close()
        self.anomaly.close()
        self._survey.close()
        self._live.close()
        self._shelf.close()
        self._health.close()
        if self._lamp is not None:
            self._lamp.close()
        for feed in self._feeds:
            feed.close()
        self._pool.close()
        if self._started:
            self._started = False
            try:
                self._store.journal.switched_off()
            except DeviceError as error:  # the next start counts an unsafe shutdown that was none: nothing worse
                log.error("the journal could not be closed: %s", error)
        self._store.close()
        self._lock_file.close()

    def end_streams(self) -> None:
        """End every subscription, so that the threads that serve them can end."""
        self._bus.close()

    # What is going on

    def status(self) -> dict[str, Any]:
        """Cameras, survey, storage and clock at this moment. Never waits for the disk or a camera."""
        return {
            "version": program_version(),
            "uptime_s": round(time.monotonic() - self._begun, 1),
            "cameras": [feed.to_json() for feed in self._feeds],
            "survey": self._survey.state(),
            "storage": {"free_mb": self._free_mb(), "notice": self._store.notice},
            "recording": self._shelf.status(),
            "clock": {"source": self._clock.source},
            "prompts": [*self._health.prompts(), *([PROMPTS["not_recorded"].to_json()] if self._shelf.lost else [])],
            "lamp": None if self._lamp is None else self._lamp.state(),
            "autonomy": self._unattended.state(),
            "workers_replaced": self._pool.replaced,
        }

    @property
    def settled(self) -> bool:
        """Whether every sensor is up or has been declared degraded or lost: nobody waits for one that is being started."""
        feeds = (*self._feeds, *self.drive.feeds, *self.structure.feeds, *self.anomaly.feeds)
        return all(feed.status().state != "starting" for feed in feeds)

    def status_line(self) -> str:
        """One line for the service manager."""
        feeds = [(feed.name, feed.status().state) for feed in (*self._feeds, *self.drive.feeds)]
        return ", ".join(f"{name} {state}" for name, state in feeds) or "no sensors"

    # While nobody looks

    def unattended(self) -> dict[str, Any]:
        """Logging by itself, and the journal: {"autonomy", "unsafe_shutdowns", "looked_at" (the last entry that somebody has
        read), "entries" newest last, each with its sentence}."""
        journal = self._store.journal
        return {
            "autonomy": self._unattended.state(),
            "unsafe_shutdowns": journal.unsafe_shutdowns(),
            "looked_at": journal.looked_at,
            "entries": told(journal.entries()),
        }

    def look_at_journal(self, entry: int) -> None:
        """Somebody has read the journal up to this entry."""
        self._unattended.looked(entry)
        self._changed.set()

    def log_by_itself(self, on: bool) -> dict[str, Any]:
        """Begin and end surveys by itself from now on, or not; the state of it."""
        self._unattended.switch(on)
        self._changed.set()
        return self._unattended.state()

    def health(self) -> dict[str, Any]:
        """Everything about the box itself, and what the operator should know of it."""
        return self._health.to_json()

    def lamp(self) -> dict[str, Any]:
        """The lamp. Raises NotFound where the box has none."""
        return self._lit().state()

    def set_lamp(self, level: float | None = None, automatic: bool | None = None) -> dict[str, Any]:
        """How bright the lamp should be, 0 to 1, or that the pictures say it; the lamp. Raises NotFound, Invalid."""
        return self._lit().set(level, automatic)

    def live(self) -> dict[str, Any] | None:
        """{"camera", "frame", "age_s", ...live_summary} of the best camera, None while no camera sends."""
        return self._live.newest()

    def subscribe(self) -> Subscription:
        """Events from now on: "status", "live", "measurement", "prompt", "drive", "structure", "anomaly", "control"."""
        return self._bus.subscribe()

    def picture(self, kind: str, camera: str | None = None) -> bytes | None:
        """JPEG of the newest picture of ``camera``, or of the first camera that has one, or None.

        ``kind`` is "depth" or "color". Raises NotFound, Invalid.
        """
        if kind not in PICTURE_KINDS:
            raise Invalid("There are pictures of depth and of color.")
        if camera is not None and all(feed.name != camera for feed in self._feeds):
            raise NotFound(f"There is no camera called {camera}.")
        for feed in self._feeds:
            frame = feed.latest
            if frame is not None and camera in (None, feed.name) and (kind == "depth" or frame.color is not None):
                return self._pictures.jpeg(feed.name, kind, frame)
        return None

    def cloud(self, survey_id: int | None) -> dict[str, Any]:
        """The point cloud with the fitted cylinder: of a survey, or of this moment. Raises NotFound."""
        if survey_id is not None:
            return self._store.surveys.cloud(survey_id) or clouds.EMPTY
        shown = self._live.shown()
        return clouds.EMPTY if shown is None else clouds.cloud_json(*shown)

    def survey_picture(self, survey_id: int, kind: str) -> bytes | None:
        """JPEG kept with a survey's chosen recording, or None. ``kind`` is "depth" or "color". Raises NotFound, Invalid."""
        if kind not in PICTURE_KINDS:
            raise Invalid("There are pictures of depth and of color.")
        return self._store.surveys.picture(survey_id, kind)

    # Surveys

    def measure(
        self,
        pipe_id: int | None = None,
        position: str | None = None,
        frames: int | None = None,
        survey_id: int | None = None,
    ) -> dict[str, Any]:
        """Begin to measure: {"survey_id"}. With ``survey_id`` it is the second position of that survey.

        Raises Busy, NotFound, Invalid, StorageFull. How it goes on is told by "measurement" events.
        """
        wanted = self.settings.frames if frames is None else frames
        if not 1 <= wanted <= _MOST_FRAMES:
            raise Invalid(f"A recording has between 1 and {_MOST_FRAMES} frames.")
        if position is not None and position not in POSITIONS:
            raise Invalid(f"The position is one of {', '.join(POSITIONS)}.")
        self._refuse_without_room()
        return {"survey_id": self._survey.start(pipe_id, position, wanted, survey_id)}

    def cancel(self) -> None:
        """End the measurement under way, if there is one."""
        self._survey.cancel()

    def surveys(self, pipe_id: int | None = None, limit: int = 50, before: int | None = None) -> list[dict[str, Any]]:
        """Summaries, newest first; ``before`` is the last number of the page before."""
        return self._store.surveys.summaries(pipe_id, max(1, min(limit, 500)), before)

    def survey(self, survey_id: int) -> dict[str, Any]:
        """One survey with its recordings and results. Raises NotFound."""
        return self._store.surveys.get(survey_id)

    def answer(self, survey_id: int, data: dict[str, Any]) -> dict[str, Any]:
        """What the operator says: the three questions, "verdict", "by", "note". The survey. Raises NotFound, Invalid."""
        said = {key: data[key] for key in (*QUESTIONS, "verdict") if key in data}
        if any(said[key] not in (True, False, None) for key in QUESTIONS if key in said):
            raise Invalid("A question is answered with yes, no or not at all.")
        if said.get("verdict") not in ("accept", "retry", None):
            raise Invalid("The verdict is accept or retry.")
        unknown = set(data) - set(said) - {"by", "note"}
        if unknown:
            raise Invalid(f"There is no question called {sorted(unknown)[0]}.")
        self._store.surveys.answer(survey_id, said, str(data.get("by") or ""), str(data.get("note") or ""))
        return self.survey(survey_id)

    def delete_survey(self, survey_id: int) -> None:
        """Out of sight; ``restore_survey`` undoes it until it is purged. Raises NotFound, Busy."""
        self._survey.refuse_if_measuring(survey_id)
        self.drive.refuse_if_driving(survey_id)
        self.structure.refuse_if_scanning(survey_id)
        self.anomaly.refuse_if_scanning(survey_id)
        self._store.surveys.delete(survey_id)

    def restore_survey(self, survey_id: int) -> dict[str, Any]:
        """Undo ``delete_survey``; the survey. Raises NotFound."""
        self._store.surveys.restore(survey_id)
        return self.survey(survey_id)

    def _lit(self) -> LampKeeper:
        if self._lamp is None:
            raise NotFound("This box has no lamp that can be dimmed.")
        return self._lamp

    def _make_lamp(self, lamp: Lamp) -> LampKeeper:
        crawler = self._crawler
        return LampKeeper(lamp, self._store.remembered, crawler.grabber, crawler.tether, on_change=self._changed.set)

    def _condition(self) -> Condition:
        codes = {prompt["code"] for prompt in self._health.prompts()}
        least_mb = self.settings.reserve_mb * (_ROOM_AGAIN if self._disk_low else 1.0)
        self._disk_low = self._free_mb() < least_mb
        return Condition(self._disk_low, "too_hot" in codes, "under_voltage" in codes)

    def _refuse_without_room(self) -> None:
        if self._free_mb() < self.settings.reserve_mb:
            raise StorageFull(f"Less than {self.settings.reserve_mb} MB are free: make room before you measure.")

    def set_clock(self, epoch_ms: int) -> None:
        """The browser offers its time; taken where the box has no better one. Raises Invalid."""
        if self._clock.offer(epoch_ms):
            self._store.surveys.date_this_boot()
            self._store.journal.date_this_boot()
            self._changed.set()

    def _clock_offset_ns(self) -> int:
        epoch_ms = self._clock.epoch_ms()
        return 0 if epoch_ms is None else epoch_ms * 1_000_000 - self._clock.monotonic_ns()

    def _free_mb(self) -> int:
        try:
            return shutil.disk_usage(self.settings.data_dir).free // 1_000_000
        except OSError as error:  # the card was pulled out: nothing can be stored, and the page says so
            log.warning("the free space of %s is unknown: %s", self.settings.data_dir, error)
            return 0

    def _announce(self) -> None:
        turn = self.turns.loop("status", 15.0)
        while not self._stop.is_set():
            turn()
            self._changed.wait(_STATUS_PERIOD_S)
            self._changed.clear()
            if not self._stop.is_set():
                self._bus.publish("status", self.status())
                self._stop.wait(0.05)  # a camera that flaps must not flood the page


def program_version() -> str:
    """The version that is installed."""
    try:
        return version("borescout")
    except PackageNotFoundError:
        return "0 (not installed)"


def _disk_policy(settings: Settings) -> DiskPolicy:
    """Findings come first: raw data never takes the last of the room that a measurement is refused without."""
    recording, least = settings.recording, settings.reserve_mb
    return DiskPolicy(
        keep_free=max(recording.keep_free_mb, least) * MB,
        stop_free=max(recording.stop_free_mb, least) * MB,
        findings_free=least * MB,
        most_raw=None if recording.most_mb is None else recording.most_mb * MB,
    )


def _lock(folder: Path) -> IO[str]:
    """Hold the data folder for this process. Raises StoreUnusable."""
    try:
        make_folder(folder)
        file = (folder / "borescout.lock").open("a+", encoding="ascii")
    except OSError as error:
        raise StoreUnusable(f"The data folder {folder} cannot be used: {error.strerror}.") from None
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        file.seek(0)
        owner = file.read().strip() or "unknown"
        file.close()
        raise StoreUnusable(
            f"Another borescout (process {owner}) is using {folder}: stop it or choose another --data-dir."
        ) from None
    file.truncate(0)
    file.write(str(os.getpid()))
    file.flush()
    return file
