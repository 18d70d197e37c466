"""All recordings of this box: begins them, keeps room for them and for findings, recovers what a power cut left behind."""

from __future__ import annotations

import contextlib
import logging
import shutil
import threading
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from device.durable import make_folder, sync_folder
from device.recorder.names import Name, name_of, recordings_in
from device.recorder.policy import DiskPolicy, Stored, decide
from device.recorder.recorder import PART_BYTES, Recorder, RecorderStatus
from device.recorder.recovery import CannotRecover, Report, in_use, recover, remove_leftovers
from device.recorder.scan import ends_well

log = logging.getLogger(__name__)

FOLDER = "recordings"
"""In the data folder."""
TURNED_OFF = "Recording is turned off in the settings."


class Shelf:
    """The folder of recordings. ``policy`` says how much of the disk they may have; ``free`` tells how much is left,
    ``offset_ns`` what to add to the monotonic clock for the date; ``on_end`` is told of each recording that has ended.
    ``first_notes`` are what each recording begins with: topic, JSON."""

    def __init__(
        self,
        folder: Path,
        policy: DiskPolicy | None = None,
        *,
        enabled: bool = True,
        part_bytes: int = PART_BYTES,
        free: Callable[[Path], int] = lambda folder: shutil.disk_usage(folder).free,
        offset_ns: Callable[[], int] = lambda: 0,
        on_change: Callable[[], None] = lambda: None,
        on_end: Callable[[int, RecorderStatus], None] = lambda survey, status: None,
        first_notes: Callable[[], Mapping[str, dict[str, Any]]] = dict,
    ) -> None:
        self.folder = folder
        self._policy = policy or DiskPolicy()
        self._enabled = enabled
        self._part_bytes = part_bytes
        self._free = free
        self._offset_ns = offset_ns
        self._on_change = on_change
        self._on_end = on_end
        self._first_notes = first_notes
        self._lock = threading.Lock()
        self._making_room = threading.Lock()
        self._under_way: list[Recorder] = []
        self._pruned = 0
        self._reports: list[Report] = []

    def begin(self, survey: int, head: Mapping[str, object]) -> Recorder:
        """A recorder for a survey, begun. Where nothing can be recorded it is off and says why; it never raises for that."""
        takes = [name.take for path in recordings_in(self.folder) if (name := name_of(path)) and name.survey == survey]
        recorder = Recorder(
            self.folder,
            Name(survey, 1 + max(takes, default=0), 1),
            {"survey_id": survey, **head},
            offset_ns=self._offset_ns(),
            part_bytes=self._part_bytes,
            may_go_on=self.make_room,
            on_change=self._on_change,
            on_end=lambda ended: self._on_end(survey, ended.status()),
        )
        with self._lock:
            self._under_way = [other for other in self._under_way if other.recording] + [recorder]
        if not self._enabled:
            return recorder.turned_off(TURNED_OFF)
        opened = recorder.open()
        for topic, note in self._first_notes().items():
            opened.write(topic, note)
        return opened

    def note(self, topic: str, note: dict[str, Any]) -> None:
        """Something that every recording under way should tell, as JSON. Never waits for the disk."""
        with self._lock:
            under_way = [one for one in self._under_way if one.recording]
        for recorder in under_way:
            recorder.write(topic, note)

    def make_room(self) -> bool:
        """Remove the oldest recordings where the policy asks for it; whether recording may go on. Raises OSError."""
        with self._making_room:
            make_folder(self.folder)
            free = self._free(self.folder)
            if free >= self._policy.keep_free and self._policy.most_raw is None:
                return True
            wanted = decide(free, self._stored(), self._policy)
            for path in wanted.remove:
                log.warning("room is short: the recording %s goes", path.name)
                path.unlink(missing_ok=True)
                self._pruned += 1
            if wanted.remove:
                sync_folder(self.folder)
            return wanted.may_record

    def _stored(self) -> list[Stored]:
        """Every recording, oldest first."""
        found = []
        for path in recordings_in(self.folder):
            with contextlib.suppress(FileNotFoundError):  # somebody removed it just now
                found.append(Stored(path, path.stat().st_size, in_use(path)))
        return found

    def recover_all(self) -> list[Report]:
        """Make whole what was cut off when the box last stopped. What cannot be recovered stays as it is."""
        remove_leftovers(self.folder)
        reports = []
        for path in recordings_in(self.folder):
            try:
                if ends_well(path) or in_use(path):
                    continue
                reports.append(recover(path))
                log.warning("the recording %s was cut off; it is recovered, %s s are lost", path.name, reports[-1].lost_seconds)
            except (CannotRecover, OSError) as error:
                log.error("%s", error)
        self._reports = reports
        self._on_change()
        return reports

    def files(self, survey: int) -> list[Path]:
        """The recordings of a survey, oldest first."""
        return [path for path in recordings_in(self.folder) if (name := name_of(path)) and name.survey == survey]

    @property
    def lost(self) -> bool:
        """Whether the newest survey is not recorded though it should be."""
        with self._lock:
            return bool(self._under_way) and self._under_way[-1].lost

    def under_way(self, survey: int) -> RecorderStatus | None:
        """Of the survey's recording that is being written, if one is."""
        with self._lock:
            found = [one for one in self._under_way if one.name.survey == survey and one.recording]
        return found[-1].status() if found else None

    def remove(self, survey: int) -> None:
        """The survey is gone for good, and so are its recordings. What cannot be removed stays until its room is needed."""
        for path in self.files(survey):
            try:
                path.unlink(missing_ok=True)
            except OSError as error:
                log.error("the recording %s cannot be removed: %s", path.name, error)

    def status(self) -> dict[str, Any]:
        """The recordings under way and what became of others, JSON-ready."""
        with self._lock:
            under_way = list(self._under_way)
        return {
            "enabled": self._enabled,
            "pruned": self._pruned,
            "recovered": len(self._reports),
            "now": [{"survey_id": one.name.survey, **one.status().to_json()} for one in under_way],
        }

    def close(self) -> None:
        """Make every file whole. May be called twice."""
        with self._lock:
            under_way = list(self._under_way)
        for recorder in under_way:
            recorder.close()
