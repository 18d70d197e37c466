"""What the page and the API do with chambers: begin, end and cancel a survey, read a map, take it away. JSON-ready."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from device.bus import Bus
from device.errors import Invalid
from device.notify import Turns
from device.recorder import Shelf
from device.store import Store
from device.structure.rig import ChamberRig
from device.structure.survey import StructureSurvey

_JSON = dict[str, Any]
FORMATS = ("json", "ply", "glb")


class StructureDesk:
    """Every method raises NotFound for a number that is not there, and Invalid with a sentence for what cannot be."""

    def __init__(
        self,
        store: Store,
        bus: Bus,
        rig: ChamberRig,
        shelf: Shelf,
        *,
        turns: Turns,
        refuse_without_room: Callable[[], None] = lambda: None,
    ) -> None:
        self._store = store
        self._rig = rig
        self._survey = StructureSurvey(store, bus, rig, shelf)
        self._survey.turns = turns
        self._refuse_without_room = refuse_without_room
        for feed in rig.feeds:
            feed.on_turn = turns.loop(f"watchdog of {feed.name}", 15.0)

    # The box's part: sensors and thread

    @property
    def feeds(self) -> list[Any]:
        """The sensors that are read for chambers alone."""
        return self._rig.feeds

    def sensors(self) -> list[tuple[str, Any]]:
        """Each of them with what it is, for the box's health."""
        names = {id(feed): role for role, feed in self._rig.navigation.items()}
        return [(names.get(id(feed), "scanner"), feed) for feed in self._rig.feeds]

    def start(self) -> None:
        """Begin to read the sensors. Returns at once."""
        self._rig.start()
        for feed in self._rig.feeds:
            feed.start()

    def close(self) -> None:
        """Stop; a survey under way is kept as far as it went. May be called twice."""
        self._survey.close()
        for feed in self._rig.feeds:
            feed.close()
        self._rig.close()

    def refuse_if_scanning(self, survey_id: int) -> None:
        """Raises Busy while this very survey goes on."""
        self._survey.refuse_if_scanning(survey_id)

    # The operator's part

    def state(self) -> _JSON:
        """The survey under way and its sensors."""
        return self._survey.state()

    def begin(self, node_id: int | None = None) -> _JSON:
        """Begin to map a chamber: {"survey_id"}. How it goes on is told by "structure" events. Raises Busy, StorageFull."""
        self._refuse_without_room()
        return {"survey_id": self._survey.start(node_id)}

    def end(self) -> _JSON:
        """All has been seen: {"survey_id"}."""
        return {"survey_id": self._survey.end()}

    def cancel(self) -> None:
        """Forget the survey under way, if there is one."""
        self._survey.cancel()

    def map(self, survey_id: int) -> _JSON:
        """The map of a survey, also of the one under way: as it was made durable after its newest scan."""
        return self._store.structures.map(survey_id)

    def file(self, survey_id: int, kind: str) -> tuple[bytes, str, str]:
        """(data, file name, MIME type) of the map as "json" graph, "ply" or "glb"."""
        from device.structure.export import MIME, map_bytes

        if kind not in FORMATS:
            raise Invalid(f"There is no format {kind}: there are {', '.join(FORMATS)}.")
        return map_bytes(self.map(survey_id), kind), f"structure_{survey_id}.{kind}", MIME[kind]
