"""A structure survey computed again: the same readings and scans in the same order, to the same map."""

from __future__ import annotations

from typing import Any

from device.errors import Invalid
from device.recorder.reader import Entry
from device.structure.course import Course, CourseSetup
from device.structure.survey import concluded
from device.surveys.topics import CHAMBER
from drivers.navigation.readings import Attitude, Depth, Velocity
from drivers.navigation.scans import Scan


class StructureReplay:
    """``head`` as ``surveys.structure`` writes it. Raises Invalid where it cannot be read."""

    def __init__(self, head: dict[str, Any]) -> None:
        self.missing = self.frames = 0
        self._sequence = 0
        try:
            self._course = Course(CourseSetup.read(head["setup"]))
        except (KeyError, TypeError, ValueError) as error:
            raise Invalid(f"The head of this recording is damaged: {error}.") from None

    def take(self, entry: Entry) -> str | None:
        """Readings and scans as they were mapped; what a damaged file has lost is counted."""
        sample = entry.sample
        if entry.topic != CHAMBER or not isinstance(sample, Scan | Velocity | Depth | Attitude):
            return None
        self.missing += entry.sequence - self._sequence
        self._sequence = entry.sequence + 1
        if not self._course.take(sample) or not isinstance(sample, Scan):
            return None
        self.frames += 1
        return f"scan {self.frames} at {self._course.times[-1]:.1f} s, {len(sample.points)} points"

    def finish(self) -> dict[str, Any]:
        """As the survey ends."""
        found = concluded(self._course)
        return {} if found is None else found

    def close(self) -> None:
        """Nothing is held."""
