"""The tether of this box: its encoder's feed, and the calibration that outlives a restart."""

from __future__ import annotations

import threading
from dataclasses import asdict, replace
from typing import Any

from device.errors import Invalid
from device.feeds.feed import EncoderFeed
from device.store.drives import Remembered
from drivers.encoder.base import Reading
from drivers.encoder.calibration import Calibration, two_point

_NAME = "encoder"
_SILENT = "The tether encoder has sent no reading: see that it is plugged in and switched on."
_FRESH_S = 3.0


class Tether:
    """An encoder with the counts per metre, direction and zero that were set on the page."""

    def __init__(self, feed: EncoderFeed, remembered: Remembered, counts_per_metre: float) -> None:
        self.feed = feed
        self._remembered = remembered
        self._lock = threading.Lock()
        self._start: Reading | None = None
        kept = remembered.get(_NAME)
        try:
            self._calibration = Calibration(**{"counts_per_metre": counts_per_metre, **kept})
        except (TypeError, ValueError):  # written by another version: the settings still stand
            self._calibration = Calibration(counts_per_metre=counts_per_metre)

    @property
    def calibration(self) -> Calibration:
        """How counts become metres just now."""
        return self._calibration

    def state(self) -> dict[str, Any]:
        """Counts, metres and calibration, JSON-ready."""
        reading, calibration = self.feed.latest, self._calibration
        return {
            "counts": None if reading is None else reading.value,
            "unit": None if reading is None else reading.unit,
            "metres": None if reading is None else round(calibration.metres(reading), 3),
            **asdict(calibration),
            "calibrating": self._start is not None,
        }

    def metres(self) -> float | None:
        """Where the crawler is now; None while the encoder is silent."""
        reading, age_s = self.feed.latest, self.feed.status().age_s
        return None if reading is None or age_s is None or age_s > _FRESH_S else round(self._calibration.metres(reading), 3)

    def change(self, change: dict[str, Any]) -> None:
        """Set "counts_per_metre" and "direction", where given. Raises Invalid."""
        with self._lock:
            self._set(**change)

    def zero(self, chainage_m: float) -> None:
        """The crawler stands at ``chainage_m`` now. Raises Invalid."""
        with self._lock:
            self._calibration = self._checked(lambda: self._calibration.zeroed_at(self._reading(), chainage_m))
            self._keep()

    def calibrate(self, point: str, length_m: float | None) -> None:
        """ "start": this is the first point. "end": so many metres further is the second one. Raises Invalid."""
        reading = self._reading()
        with self._lock:
            if point == "start":
                self._start = reading
                return
            first = self._start
            if first is None:
                raise Invalid("Set the first point of the calibration first.")
            if length_m is None:
                raise Invalid("Say how many metres lie between the two points.")
            self._calibration = self._checked(lambda: two_point(first, reading, length_m))
            self._start = None
            self._keep()

    def _set(self, **change: Any) -> None:
        """The crawler has not moved: what it counts now keeps its chainage."""
        reading = self.feed.latest
        before = None if reading is None else self._calibration.metres(reading)
        changed = self._checked(lambda: replace(self._calibration, **{**change, "scale_std": None}))
        if reading is not None and before is not None:
            changed = changed.zeroed_at(reading, before)
        self._calibration = changed
        self._keep()

    def _reading(self) -> Reading:
        reading, age_s = self.feed.latest, self.feed.status().age_s
        if reading is None or age_s is None or age_s > _FRESH_S:
            raise Invalid(_SILENT)
        return reading

    def _keep(self) -> None:
        self._remembered.put(_NAME, asdict(self._calibration))

    @staticmethod
    def _checked(make: Any) -> Calibration:
        try:
            calibration: Calibration = make()
        except ValueError as error:
            raise Invalid(str(error)) from None
        return calibration
