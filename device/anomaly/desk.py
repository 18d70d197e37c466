"""The anomaly survey as the page, the API and the rest of the box see it: the camera, the live state, scans, what was kept."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from device.anomaly.along import joined, placed_scan
from device.anomaly.live import AnomalyLive, PairWorker
from device.anomaly.rig import StereoEye
from device.anomaly.survey import AnomalySurvey, reference_jpeg
from device.anomaly.views import map_json, unpacked, wall_png
from device.bus import Bus
from device.calibrating.board_paper import board_of
from device.calibrating.session import CalibrationSession
from device.config import StereoSettings
from device.errors import Busy, Invalid, NotFound
from device.feeds.feed import Feed, StereoFeed
from device.landmarks.tether import Tether
from device.notify import Turns
from device.pictures import PictureCache
from device.recorder import Shelf
from device.store import Store

_JSON = dict[str, Any]
NO_CAMERA = "This box has no stereo camera: name one in its settings."
_IDLE: _JSON = {"state": "idle", "survey_id": None, "frames_done": 0, "frames_wanted": 0}


class AnomalyDesk:
    """Everything about anomaly surveys. ``eye`` is None where the box has no stereo camera: then nothing can be scanned, and
    what was found before is still told. Errors are DeviceErrors."""

    def __init__(
        self,
        settings: StereoSettings,
        eye: StereoEye | None,
        store: Store,
        bus: Bus,
        shelf: Shelf,
        pictures: PictureCache,
        tether: Tether | None,
        *,
        on_crawler: bool,
        turns: Turns,
        refuse_without_room: Callable[[], None],
    ) -> None:
        self._settings = settings
        self._eye = eye
        self._store = store
        self._bus = bus
        self._pictures = pictures
        self._tether = tether
        self._on_crawler = on_crawler
        self._refuse = refuse_without_room
        self._worker = PairWorker()
        self._live: AnomalyLive | None = None
        self._survey: AnomalySurvey | None = None
        self._calibration: CalibrationSession | None = None
        if eye is not None and eye.lenses is not None and settings.calibration is not None:
            self._calibration = CalibrationSession(eye.lenses, eye.feed, eye.source, settings.calibration)
        if eye is not None:
            self._live = AnomalyLive(eye, self._worker, self._tell)
            self._survey = AnomalySurvey(store, bus, eye, self._worker, self._live, shelf)
            self._survey.turns = turns
            self._live.on_turn = turns.loop("anomaly live", 30.0)
            eye.feed.on_turn = turns.loop(f"watchdog of {eye.feed.name}", 15.0)

    @property
    def feeds(self) -> list[StereoFeed]:
        """The camera's, where there is one."""
        return [] if self._eye is None else [self._eye.feed]

    def sensors(self) -> list[tuple[str, Feed[Any]]]:
        """For the health of the box."""
        return [("stereo", feed) for feed in self.feeds]

    def start(self) -> None:
        """Begin to wait for somebody who looks."""
        if self._eye is not None and self._live is not None:
            self._eye.feed.start()
            self._live.start()

    def close(self) -> None:
        """Stop. May be called twice."""
        if self._calibration is not None:
            self._calibration.close()
        if self._survey is not None:
            self._survey.close()
        if self._live is not None:
            self._live.close()
        for feed in self.feeds:
            feed.close()
        self._worker.close()

    def look(self) -> _JSON:
        """``state``, for somebody who looks: the camera wakes."""
        if self._live is not None:
            self._live.wake()
        return self.state()

    def state(self) -> _JSON:
        """{"available", "plain_cameras", "state", "survey_id", "frames_done", "frames_wanted", "pairs", "camera", "live",
        "chainage_m", "on_crawler"}."""
        survey = _IDLE if self._survey is None else {key: self._survey.state()[key] for key in _IDLE}
        return {
            "available": self._eye is not None,
            "plain_cameras": self._calibration is not None,
            **survey,
            "pairs": self._settings.pairs,
            "camera": None if self._eye is None else self._eye.feed.to_json(),
            "live": None if self._live is None else self._live.newest(),
            "chainage_m": None if self._tether is None else self._tether.metres(),
            "on_crawler": self._on_crawler,
        }

    def picture(self) -> bytes | None:
        """JPEG of the newest left picture, or None. Whoever looks wakes the camera."""
        if self._eye is None or self._live is None:
            return None
        self._live.wake()
        frame = self._eye.feed.latest
        if frame is None:
            return None
        view = "stereo", self._eye.feed.name
        return self._pictures.shared(view, frame.monotonic_ns, lambda: reference_jpeg(frame.left))

    def scan(self, pipe_id: int | None = None, chainage: float | None = None, pairs: int | None = None) -> _JSON:
        """Begin to scan the present view: {"survey_id"}. Raises Busy, NotFound, Invalid, StorageFull."""
        if self._survey is None:
            raise Invalid(NO_CAMERA)
        if self._calibration is not None and self._calibration.busy:
            raise Busy("The two cameras are being calibrated: finish or cancel that first.")
        self._refuse()
        wanted = self._settings.pairs if pairs is None else pairs
        return {"survey_id": self._survey.start(pipe_id, None, wanted, chainage=chainage)}

    def cancel(self) -> None:
        """End the scan under way, if there is one."""
        if self._survey is not None:
            self._survey.cancel()

    def refuse_if_scanning(self, survey_id: int) -> None:
        """Raises Busy while this very survey is under way."""
        if self._survey is not None:
            self._survey.refuse_if_measuring(survey_id)

    @property
    def calibration(self) -> CalibrationSession:
        """The calibration of two plain cameras. Raises NotFound where the box has none."""
        if self._calibration is None:
            raise NotFound(NO_CAMERA if self._eye is None else "This stereo camera knows its own lenses.")
        return self._calibration

    def calibrate(self, kind: str, columns: int, rows: int, square_m: float) -> None:
        """Begin to look for such a board with both cameras. Raises Busy, Invalid, NotFound."""
        session, board = self.calibration, board_of(kind, columns, rows, square_m)
        if self._survey is not None and self._survey.busy:
            raise Busy("A scan is under way: wait for it or cancel it.")
        if self._eye is not None and self._eye.feed.tapped:
            raise Busy("A drive, or somebody who looks at its picture, uses these cameras: end it first.")
        session.start(board)

    # What was found

    def found(self, survey_id: int) -> _JSON:
        """The result of a scan with its thinned "map" (None where it was refused). Raises NotFound."""
        survey = self._anomaly(survey_id)
        kept = self._store.surveys.anomaly_view(survey_id, "map")
        about = {key: survey[key] for key in ("kind", "state", "created", "pipe")}
        return {
            "survey_id": survey_id,
            **about,
            **(survey["result"] or {}),
            "map": None if kept is None else map_json(unpacked(kept)),
        }

    def along(self, survey_id: int) -> _JSON:
        """What the scans that were made in one go with this one, in the same pipe, tell together; see
        ``device.anomaly.along.joined``. Raises NotFound."""
        self._anomaly(survey_id)
        stated = [self._store.surveys.get(number) for number in self._store.surveys.in_one_go(survey_id)]
        return joined(
            [
                placed_scan(one["id"], one["result"], one["result"]["chainage_m"])
                for one in stated
                if one["result"] is not None and one["final_verdict"] == "accept"
            ]
        )

    def view(self, survey_id: int, what: str) -> bytes | None:
        """JPEG "reference" or "overlay" of a scan, or None. Raises NotFound."""
        self._anomaly(survey_id)
        return self._store.surveys.anomaly_view(survey_id, what)

    def wall(self, survey_id: int) -> bytes | None:
        """PNG of the unrolled wall, or None. Raises NotFound."""
        self._anomaly(survey_id)
        kept = self._store.surveys.anomaly_view(survey_id, "map")
        return None if kept is None else wall_png(unpacked(kept))

    def _anomaly(self, survey_id: int) -> _JSON:
        survey = self._store.surveys.get(survey_id)
        if survey["kind"] != AnomalySurvey.kind:
            raise NotFound(f"Survey {survey_id} is no anomaly survey.")
        return survey

    def _tell(self) -> None:
        self._bus.publish("anomaly", self.state())
