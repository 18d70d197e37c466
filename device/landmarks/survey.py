"""The landmarks survey: a drive through a pipe, mapped while it goes on and smoothed when its end is reached.

One thread takes the pictures, places each by the tether, and hands it to the pipeline. About once a second what has come is
made durable, a few times a second it is told to whoever listens; what is told of a stored landmark has been stored before.
"""

from __future__ import annotations

import logging
import threading
import time
from typing import Any

from device.bus import Bus
from device.errors import Busy, DeviceError, Invalid, NotFound, StorageFull
from device.landmarks.crawler import Crawler
from device.landmarks.drive import Drive
from device.landmarks.drive_findings import DriveFindings
from device.landmarks.drive_log import DriveLog, head
from device.landmarks.heatmaps import Heatmaps
from device.landmarks.overlay import draw
from device.landmarks.pipeline import LandmarkPipeline, PipelineSetup
from device.landmarks.placing import Placing
from device.notify import Turns
from device.pictures import PictureCache, encode_jpeg
from device.recorder import Shelf
from device.store import Kept, KeptLandmark, Store

log = logging.getLogger(__name__)

TURN_LIMIT_S = 60.0
"""A drive that takes longer over one picture is stuck."""
KEEP_S = 1.0
TELL_S = 0.25
AWAKE_S = 5.0
"""How long a costly grabber stays awake after somebody looked at its picture."""
_FRAMES_WAITING = 2
_READINGS_WAITING = 4096
_UNEXPECTED = "The drive failed inside the box; its log says why. What was mapped is kept."


class LandmarkSurvey:
    """One drive at a time."""

    kind = "landmarks"

    def __init__(self, store: Store, bus: Bus, crawler: Crawler, shelf: Shelf) -> None:
        self._store = store
        self._shelf = shelf
        self._bus = bus
        self._crawler = crawler
        self._lock = threading.RLock()
        """Held while a frame is mapped: whoever else looks into the drive waits some milliseconds."""
        self._drive: Drive | None = None
        self._thread: threading.Thread | None = None
        self._pictures = PictureCache()
        self._heatmaps = Heatmaps()
        self.turns = Turns()
        """Whom the drive's thread tells that it goes on."""

    # What the page asks

    @property
    def available(self) -> bool:
        """Whether this box has a CCTV grabber and something that tells the distance."""
        return self._crawler.grabber is not None and (self._crawler.tether is not None or self._crawler.reader is not None)

    def state(self) -> dict[str, Any]:
        """The drive, the CCTV and the tether at this moment, see ``web_ui.openapi``."""
        drive = self._drive
        grabber, encoder = self._crawler.grabber, self._encoder_json()
        common: dict[str, Any] = {
            "available": self.available,
            "state": "idle",
            "survey_id": None,
            "pipe_id": None,
            "direction": "downstream",
            "chainage_m": None,
            "sigma_m": None,
            "speed_mps": None,
            "seconds": 0.0,
            "frames": 0,
            "dropped": 0,
            "fps": 0.0 if grabber is None else round(grabber.status().fps, 1),
            "grabber": None if grabber is None else grabber.to_json(),
            "encoder": encoder,
            "prompts": [],
            "counts": {"candidate": 0, "confirmed": 0, "passed": 0},
            "progress": None,
        }
        if drive is None:
            return common
        with self._lock:
            return {**common, **drive.to_json()}

    def encoder(self) -> dict[str, Any]:
        """The tether with its calibration. Raises Invalid where there is none."""
        found = self._encoder_json()
        if found is None:
            raise Invalid("This box has no tether encoder: name one in its settings.")
        return found

    def start(
        self,
        pipe: dict[str, Any] | None,
        direction: str,
        radius_m: float | None,
        start_chainage_m: float | None,
        more: dict[str, Any] | None = None,
    ) -> int:
        """Begin a drive; its survey's number. ``more`` is kept with its settings. Raises Busy, Invalid, StorageFull."""
        crawler = self._crawler
        with self._lock:
            if self._drive is not None:
                raise Busy("A drive is under way: end it or cancel it first.")
            if crawler.grabber is None:
                raise Invalid("This box has no CCTV grabber: name one in its settings.")
            if not self.available:
                raise Invalid("This box has nothing that tells the distance: name an encoder in its settings.")
            if crawler.tether is not None:
                crawler.begin()
                crawler.tether.zero(start_chainage_m or 0.0)
            if radius_m is None:
                dn = (pipe or {}).get("reference_dn")
                radius_m = crawler.radius if dn is None else dn / 2000.0
            optics = crawler.optics()
            setup = PipelineSetup(optics.focal, optics.centre, radius_m, sparse=crawler.sparse)
            pipe_id = None if pipe is None else pipe["id"]
            settings = {
                "direction": direction,
                "radius_m": radius_m,
                "focal_px": optics.focal,
                "centre_px": optics.centre,
                "start_chainage_m": start_chainage_m or 0.0,
                "encoder": self._encoder_json(),
                "grabber": crawler.grabber.name,
                **(more or {}),
            }
            number = self._store.drives.begin(pipe_id, settings)
            reader = None if crawler.reader is None else crawler.reader()
            calibration = None if crawler.tether is None else crawler.tether.calibration
            detector = crawler.detector()
            drive_log = DriveLog(self._shelf.begin(number, head(setup, calibration, detector, number, settings)))
            placing = Placing(calibration, reader, drive_log.reading)
            pipeline = LandmarkPipeline(setup, detector, seed=number)
            self._drive = Drive(number, pipe_id, direction, crawler, pipeline, placing, drive_log, time.monotonic())
            self._thread = threading.Thread(target=self._run, args=(self._drive,), name=f"drive {number}", daemon=True)
            self._thread.start()
        log.info("drive %d: begins, %s", number, direction)
        return number

    def pause(self, paused: bool) -> None:
        """Map nothing until ``pause(False)``; the way goes on being counted. Raises Invalid."""
        with self._lock:
            drive = self._going()
            drive.state = "paused" if paused else "driving"
        self._crawler.hold(paused)

    def cancel(self) -> None:
        """Forget the drive under way, if there is one. Returns at once."""
        drive = self._drive
        if drive is not None:
            drive.cancelled = True
            drive.ending.set()

    def end(self, length_m: float | None) -> int:
        """The end node is reached: smooth, store. Returns at once with the survey's number. Raises Invalid."""
        with self._lock:
            drive = self._going()
            drive.length_m = length_m
            drive.state, drive.progress = "finishing", 0.0
            drive.ending.set()
            return drive.survey_id

    def mark(self, label: str, clock: float | None, note: str) -> dict[str, Any]:
        """A landmark where the crawler is now; it is stored when this returns. Raises Invalid, StorageFull."""
        with self._lock:
            drive = self._going()
            where = drive.placing.now()
            if where is None:
                raise Invalid("Nobody knows where the crawler is: the tether encoder is silent.")
            number, row = drive.new_mark(label, clock, where)
            self._store.drives.keep(drive.survey_id, Kept(landmarks=[KeptLandmark(number, row)]))
            drive.marked(number, where.time_s, row)
        if note:
            return self.say(drive.survey_id, number, {"note": note}, "")
        return self._store.drives.landmark(drive.survey_id, number)

    def say(self, survey_id: int, number: int, said: dict[str, Any], by: str) -> dict[str, Any]:
        """Keep what ``by`` said of a landmark, of this drive or an earlier one. Raises NotFound."""
        with self._lock:
            drive = self._drive
            if drive is None or drive.survey_id != survey_id:
                return self._store.drives.say(survey_id, number, said, by)
            if number not in drive.kept:  # a candidate: what somebody speaks of is kept, whatever becomes of it
                row = next((row for row in drive.rows() if row["id"] == number), None)
                if row is None:
                    raise NotFound(f"Survey {survey_id} has no landmark number {number}.")
                self._store.drives.keep(survey_id, Kept(landmarks=[KeptLandmark(number, row)]))
                drive.kept[number] = row
            answer = self._store.drives.say(survey_id, number, said, by)
            drive.words[number] = answer["history"]
            return answer

    def picture(self, overlay: bool, heatmap: str | None = None) -> bytes | None:
        """JPEG of the newest CCTV picture, or None. ``overlay``: with what the drive makes of it drawn in. ``heatmap``: with
        what the network sees of this class painted over it. Raises Invalid for a class that it does not know."""
        grabber = self._crawler.grabber
        if grabber is None:
            return None
        grabber.wake(AWAKE_S)
        drive = self._drive
        shown = None if drive is None else drive.shown
        if overlay and drive is not None and shown is not None:
            frame, step = shown
        else:
            if grabber.latest is None or grabber.status().state not in ("up", "degraded"):
                return None
            frame, step, overlay = grabber.latest, None, False

        def make() -> bytes:
            image = frame.image if heatmap is None else self._heatmaps.over(frame.image, heatmap)
            if step is not None and drive is not None and step.view is not None:
                with self._lock:
                    scene = drive.pipeline.scene(step, drive.numbers)
                image = draw(image, scene)
            return encode_jpeg(image)

        return self._pictures.shared((overlay, heatmap), frame.monotonic_ns, make)

    def thumbnail(self, survey_id: int, number: int, heatmap: str | None = None) -> bytes | None:
        """JPEG of a landmark's best picture, or None; ``heatmap`` as in ``picture``. Raises NotFound, Invalid."""
        data = self._store.drives.thumbnail(survey_id, number)
        if data is None or heatmap is None:
            return data
        return self._heatmaps.over_jpeg(data, heatmap)

    def refuse_if_driving(self, survey_id: int | None = None) -> None:
        """Raises Busy while a drive is under way (or this very one)."""
        drive = self._drive
        if drive is not None and survey_id in (None, drive.survey_id):
            raise Busy("A drive is under way: end it or cancel it first.")

    def close(self, wait_s: float = 10.0) -> None:
        """Stop. A drive under way is kept as it stands, as interrupted. May be called twice."""
        drive = self._drive
        if drive is not None and not drive.ending.is_set():
            drive.state = "closing"
            drive.ending.set()
        if self._thread is not None:
            self._thread.join(wait_s)

    # The drive's own thread

    def _run(self, drive: Drive) -> None:
        message = ""
        found: DriveFindings | None = None
        try:
            self._go(drive)
            drive.log.ended(drive.state, drive.length_m)
            if drive.cancelled:
                self._store.drives.forget(drive.survey_id)
                message = "The drive was cancelled."
            elif drive.state == "closing":
                self._keep(drive, "interrupted")
                with self._lock:
                    found = drive.findings("interrupted", None)
            else:
                found = self._finish(drive)
        except DeviceError as error:
            message = str(error)
            log.error("drive %d: %s", drive.survey_id, error)
        except Exception:  # the last net: what was stored so far stays, and the next start of the box calls it interrupted
            log.exception("drive %d failed in an unexpected way", drive.survey_id)
            message = _UNEXPECTED
            self._save_what_is_there(drive)
        drive.log.close(None if found is None else found.to_json(), wanted=not drive.cancelled)
        with self._lock:
            self._drive = None
        log.info("drive %d: over%s", drive.survey_id, f", {message}" if message else "")
        self._publish(message=message)

    def _go(self, drive: Drive) -> None:
        grabber, tether = self._crawler.grabber, self._crawler.tether
        assert grabber is not None  # start() saw to it
        frames = drive.log.frames(grabber, _FRAMES_WAITING)
        readings = None if tether is None else tether.feed.tap(_READINGS_WAITING)
        keep_due = tell_due = time.monotonic()
        dropped_before = grabber.status().drops
        try:
            turn = self.turns.loop("drive", TURN_LIMIT_S)
            while not drive.ending.is_set():
                turn()
                frame = frames.get(0.05)
                with self._lock:
                    while readings is not None and (reading := readings.get(0.0)) is not None:
                        drive.placing.add(reading)
                    if frame is not None:
                        drive.take(frame)
                    drive.dropped = grabber.status().drops - dropped_before
                    drive.watch()
                now = time.monotonic()
                if now >= keep_due:
                    keep_due = now + KEEP_S
                    self._keep_if_possible(drive)
                if now >= tell_due:
                    tell_due = now + TELL_S
                    self._tell(drive)
        finally:
            self.turns.over("drive")
            frames.close()
            if readings is not None:
                readings.close()

    def _tell(self, drive: Drive) -> None:
        with self._lock:
            news = drive.news()
        self._publish(**news)

    def _publish(self, **more: Any) -> None:
        """The state with what is new of the map."""
        self._bus.publish("drive", {**self.state(), "landmarks": [], "gone": [], "faults": [], **more})

    def _keep_if_possible(self, drive: Drive) -> None:
        try:
            self._keep(drive)
            drive.full = False
        except StorageFull as error:  # the drive goes on: what could not be written waits for the next second
            if not drive.full:
                log.error("drive %d: %s", drive.survey_id, error)
            drive.full = True

    def _keep(self, drive: Drive, state: str | None = None) -> None:
        """Make durable what has come since the last time. Raises StorageFull, and then nothing counts as kept."""
        with self._lock:
            unkept = drive.unkept()
        self._store.drives.keep(drive.survey_id, unkept.for_store(), state)
        with self._lock:
            drive.were_kept(unkept)

    def _finish(self, drive: Drive) -> DriveFindings | None:
        """What the filter has found is made durable first; smoothing can then only add."""
        with self._lock:  # the page goes on asking for what the mapper now drops
            drive.pipeline.close()
        drive.pipeline.finish()
        self._keep(drive)
        self._tell(drive)

        def progress(share: float) -> None:
            drive.progress = share
            self._publish()

        progress(0.1)
        smoothed = drive.pipeline.smooth(length=drive.length_m)
        progress(0.9)
        if drive.cancelled:
            self._store.drives.forget(drive.survey_id)
            return None
        with self._lock:
            found = drive.findings("saved", smoothed)
        if smoothed is None:
            self._store.drives.keep(drive.survey_id, Kept(), "saved")
            return found
        landmarks = [KeptLandmark(number, row) for number, row in found.rows.items()]
        summary = {**drive.summary(len(found.rows)), **found.summary}
        gone = drive.missing_in(found.rows)
        self._store.drives.keep(drive.survey_id, Kept(landmarks, gone, found.rings, found.slips, (), summary), "saved")
        return found

    def _save_what_is_there(self, drive: Drive) -> None:
        try:
            self._keep(drive, "interrupted")
        except Exception:  # noqa: BLE001 - it may be the very thing that failed
            log.warning("drive %d: its last second could not be stored", drive.survey_id)

    def _going(self) -> Drive:
        drive = self._drive
        if drive is None or drive.ending.is_set():
            raise Invalid("No drive is under way.")
        return drive

    def _encoder_json(self) -> dict[str, Any] | None:
        tether = self._crawler.tether
        return None if tether is None else {**tether.feed.to_json(), **tether.state()}
