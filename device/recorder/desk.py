"""The raw data of surveys as the page, the API and the reports see it. JSON-ready."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Any

from device.errors import DeviceError, NotFound
from device.recorder.names import Name, name_of
from device.recorder.recorder import RecorderStatus
from device.recorder.shelf import Shelf
from device.store import Store

GONE = "The raw data was removed to make room for newer surveys."
NEVER = "No raw data was recorded."

log = logging.getLogger(__name__)


class RecordingDesk:
    """What lies on the shelf, and what the store knows of what lay there."""

    def __init__(self, store: Store, shelf: Shelf) -> None:
        self._store = store
        self._shelf = shelf

    def of(self, survey_id: int) -> dict[str, Any]:
        """Raw data of a survey: {"state", "message", "dropped", "files": [{"take", "part", "file", "bytes"}]}. Raises NotFound.

        "state" is "recording", "kept", "gone" or "none"; "message" says why there is none, or not all of it.
        """
        ended = self._store.surveys.recording(survey_id) or {}
        now = self._shelf.under_way(survey_id)
        files = [file for path in self._shelf.files(survey_id) if (file := _stated(path)) is not None]
        message = ended.get("message", "")
        if not files and not message:
            message = GONE if ended.get("files") else NEVER
        return {
            "state": "recording" if now is not None else "kept" if files else "gone" if ended.get("files") else "none",
            "message": "" if now is not None else message,
            "dropped": now.dropped if now is not None else ended.get("dropped", 0),
            "files": files,
        }

    def file(self, survey_id: int, take: int, part: int) -> Path:
        """Where a file of the survey's raw data lies. Raises NotFound."""
        self._store.surveys.recording(survey_id)
        for path in self._shelf.files(survey_id):
            if name_of(path) == Name(survey_id, take, part):
                return path
        raise NotFound(f"Survey {survey_id} has no such recording: it was removed to make room, or there never was one.")


def _stated(path: Path) -> dict[str, Any] | None:
    name = name_of(path)
    try:
        size = path.stat().st_size
    except FileNotFoundError:
        return None  # it has just gone to make room
    return None if name is None else {"take": name.take, "part": name.part, "file": path.name, "bytes": size}


def keep_outcome(store: Store, survey_id: int, status: RecorderStatus) -> None:
    """What became of a recording, for when its files are gone."""
    try:
        store.surveys.recorded(survey_id, status.to_json())
    except DeviceError as error:  # the files tell it too, but for the reason
        log.error("what became of the recording of survey %d could not be stored: %s", survey_id, error)
