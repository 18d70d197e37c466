"""Where the crawler was when a picture was taken: readings of the tether, or of the distance burned into the pictures."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

from drivers.base import DriverError
from drivers.encoder.base import Encoder, Reading
from drivers.encoder.calibration import Calibration
from drivers.encoder.osd import OsdEncoder
from drivers.grabber.base import VideoFrame
from estimators.odometry import Odometer, Position

GAP_S = 1.0
"""A picture so much later than the last reading is at no known place."""
SILENT_S = 2.0
FINE_M = 0.01
"""A counter with smaller steps than this is taken as it is."""
_BURNED_IN = Calibration()


@dataclass(frozen=True)
class Whereabouts:
    """The newest known place: the time of its reading (s, on the readings' clock), chainage and its std (m), speed (m/s)."""

    time_s: float
    chainage: float
    std: float
    speed: float


class Placing:
    """Readings in, positions out. ``calibration`` of the tether; or ``reader``, which is fed with the pictures themselves and
    read in a thread of its own, since reading text takes longer than a picture lasts. ``heard`` is told of each reading."""

    def __init__(
        self,
        calibration: Calibration | None,
        reader: Encoder | None = None,
        heard: Callable[[Reading], object] = lambda reading: None,
    ) -> None:
        self._calibration = calibration or _BURNED_IN
        self._odometer: Odometer | None = None
        self._newest_s = 0.0
        self._heard = time.monotonic()
        self._tell = heard
        self._readings = 0
        self._lock = threading.Lock()
        self._osd = reader if isinstance(reader, OsdEncoder) else None
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None
        if self._osd is not None:
            self._thread = threading.Thread(target=self._read_text, name="burned-in distance", daemon=True)
            self._thread.start()

    def add(self, reading: Reading) -> None:
        """One reading."""
        with self._lock:
            if self._odometer is None:
                quantum = self._calibration.quantum(reading)
                self._odometer = Odometer(quantum if quantum >= FINE_M else 0.0)
            self._odometer.add(reading.time_s, self._calibration.metres(reading))
            self._newest_s = max(self._newest_s, reading.time_s)
            self._heard = time.monotonic()
            self._readings += 1
            self._tell(reading)

    def see(self, frame: VideoFrame) -> None:
        """A picture, for the distance burned into it. Returns at once."""
        if self._osd is not None:
            self._osd.feed(frame)

    def at(self, time_s: float) -> Position | None:
        """Where the crawler was at ``time_s``; None where no reading is near enough."""
        return self.find(time_s)[0]

    def find(self, time_s: float) -> tuple[Position | None, int]:
        """The same, and after how many readings that is said."""
        with self._lock:
            if self._odometer is None or time_s - self._newest_s > GAP_S:
                return None, self._readings
            return self._odometer.at(time_s), self._readings

    def now(self) -> Whereabouts | None:
        """Where the crawler was at the newest reading; None before the first one."""
        with self._lock:
            if self._odometer is None:
                return None
            found = self._odometer.at(self._newest_s)
            return Whereabouts(self._newest_s, found.chainage, found.std, found.speed)

    def silent(self, monotonic_s: float) -> bool:
        """Whether no reading has come for a while."""
        return monotonic_s - self._heard > SILENT_S

    @property
    def jumps(self) -> list[tuple[float, float]]:
        """Jumps of the counter so far: (s, m)."""
        with self._lock:
            return [] if self._odometer is None else list(self._odometer.jumps)

    def close(self, wait_s: float = 2.0) -> None:
        """Stop reading text. May be called twice."""
        self._stop.set()
        if self._thread is not None:
            self._thread.join(wait_s)

    def _read_text(self) -> None:
        assert self._osd is not None  # the thread is only started with one
        try:
            self._osd.open()
        except DriverError:
            return  # silence: the page says that no distance can be read
        while not self._stop.is_set():
            try:
                self.add(self._osd.read(0.2))
            except DriverError:
                continue  # no picture, or none with a believable distance
        self._osd.close()
