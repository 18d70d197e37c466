"""What the box remembers: one SQLite database, durable, with numbered migrations."""

from __future__ import annotations

from pathlib import Path

from device.clock import Clock
from device.store.database import Database
from device.store.drives import Drives, Kept, KeptLandmark, Remembered
from device.store.inspections import Inspections
from device.store.journal import Journal
from device.store.places import Places
from device.store.structures import Structures
from device.store.surveys import NewRecording, Surveys

__all__ = ["Kept", "KeptLandmark", "NewRecording", "Store"]


class Store:
    """The database with its queries, by subject: ``places``, ``surveys``, ``drives``, ``structures`` and ``journal``;
    ``remembered`` holds settings.

    ``notice`` is a sentence for the operator where the database had to be set aside. Raises as ``Database`` does.
    """

    def __init__(self, folder: Path, clock: Clock) -> None:
        self._database = Database(folder)
        self.notice = self._database.notice
        self.places = Places(self._database)
        self.surveys = Surveys(self._database, clock)
        self.drives = Drives(self._database, clock)
        self.structures = Structures(self._database, clock)
        self.inspections = Inspections(self._database, clock)
        self.remembered = Remembered(self._database)
        self.journal = Journal(self._database, clock)

    def close(self) -> None:
        """May be called twice."""
        self._database.close()
