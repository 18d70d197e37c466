"""What the page and the API do with drives: begin, steer and end one, read its map, calibrate the tether. JSON-ready."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from device.bus import Bus
from device.errors import Invalid
from device.feeds.feed import Feed
from device.lamp.keeper import LampKeeper
from device.landmarks.crawler import Crawler
from device.landmarks.survey import LandmarkSurvey
from device.landmarks.tether import Tether
from device.notify import Turns
from device.recorder import Shelf
from device.store import Store

_JSON = dict[str, Any]


class DriveDesk:
    """Every method raises NotFound for a number that is not there, and Invalid with a sentence for what cannot be."""

    def __init__(
        self,
        store: Store,
        bus: Bus,
        crawler: Crawler,
        shelf: Shelf,
        lamp: LampKeeper | None,
        *,
        turns: Turns,
        refuse_without_room: Callable[[], None],
    ) -> None:
        self._store = store
        self._crawler = crawler
        self._lamp = lamp
        self._refuse_without_room = refuse_without_room
        self.survey = LandmarkSurvey(store, bus, crawler, shelf)
        """The drive itself, for the box that logs by itself."""
        self.survey.turns = turns
        for feed in crawler.feeds:
            feed.on_turn = turns.loop(f"watchdog of {feed.name}", 15.0)

    # The box's part: sensors and thread

    @property
    def feeds(self) -> list[Feed[Any]]:
        """The sensors of the crawler."""
        return self._crawler.feeds

    def sensors(self) -> list[tuple[str, Feed[Any]]]:
        """Each of them with what it is, for the box's health."""
        return [("grabber" if feed is self._crawler.grabber else "encoder", feed) for feed in self.feeds]

    def start(self) -> None:
        """Begin to read the sensors. Returns at once."""
        for feed in self.feeds:
            feed.start()

    def close(self) -> None:
        """Stop; a drive under way is kept as it stands, as interrupted. May be called twice."""
        self.survey.close()
        for feed in self.feeds:
            feed.close()

    def refuse_if_driving(self, survey_id: int) -> None:
        """Raises Busy while this very drive goes on."""
        self.survey.refuse_if_driving(survey_id)

    # The operator's part: the drive under way

    def state(self) -> _JSON:
        """The drive under way, the CCTV and the tether."""
        return self.survey.state()

    def begin(
        self,
        pipe_id: int | None = None,
        direction: str = "downstream",
        radius_m: float | None = None,
        start_chainage_m: float | None = None,
    ) -> _JSON:
        """Begin to map a pipe: {"survey_id"}. How it goes on is told by "drive" events. Raises Busy, StorageFull."""
        self._refuse_without_room()
        self._let_there_be_light()
        pipe = None if pipe_id is None else self._store.places.pipe(pipe_id)
        return {"survey_id": self.survey.start(pipe, direction, radius_m, start_chainage_m)}

    def pause(self) -> None:
        """Map nothing until ``resume``."""
        self.survey.pause(True)

    def resume(self) -> None:
        """Go on mapping."""
        self.survey.pause(False)

    def cancel(self) -> None:
        """Forget the drive under way, if there is one."""
        self.survey.cancel()

    def end(self, length_m: float | None = None) -> _JSON:
        """The end node is reached: {"survey_id"}."""
        return {"survey_id": self.survey.end(length_m)}

    def mark(self, label: str, clock: float | None = None, note: str = "") -> _JSON:
        """A landmark where the crawler is now. Raises StorageFull."""
        return self.survey.mark(label, clock, note)

    def picture(self, overlay: bool = False, heatmap: str | None = None) -> bytes | None:
        """JPEG of the newest CCTV picture, or None; ``heatmap`` is a class of the network. Whoever looks wants to see: a
        resting lamp is lit."""
        self._let_there_be_light()
        return self.survey.picture(overlay, heatmap)

    # The tether; each raises Busy while a drive is under way

    def set_encoder(self, change: _JSON) -> _JSON:
        """Set "counts_per_metre" and "direction"; the encoder."""
        self._idle_tether().change(change)
        return self.survey.encoder()

    def zero_encoder(self, chainage_m: float = 0.0) -> _JSON:
        """The crawler stands at this chainage; the encoder."""
        self._idle_tether().zero(chainage_m)
        return self.survey.encoder()

    def calibrate_encoder(self, point: str, length_m: float | None = None) -> _JSON:
        """Two-point calibration; the encoder."""
        self._idle_tether().calibrate(point, length_m)
        return self.survey.encoder()

    # What was found

    def map(self, survey_id: int) -> _JSON:
        """The map of a drive, also of the one under way."""
        return self._store.drives.map(survey_id)

    def thumbnail(self, survey_id: int, landmark: int, heatmap: str | None = None) -> bytes | None:
        """JPEG of a landmark, or None."""
        return self.survey.thumbnail(survey_id, landmark, heatmap)

    def change_landmark(self, survey_id: int, landmark: int, change: _JSON) -> _JSON:
        """What somebody says of a landmark: "decision", "class", "chainage_m", "clock", "note", "by"."""
        said = {key: value for key, value in change.items() if key != "by"}
        return self.survey.say(survey_id, landmark, said, str(change.get("by") or ""))

    def _let_there_be_light(self) -> None:
        if self._lamp is not None:
            self._lamp.look()

    def _idle_tether(self) -> Tether:
        self.survey.refuse_if_driving()
        if self._crawler.tether is None:
            raise Invalid("This box has no tether encoder: name one in its settings.")
        return self._crawler.tether
