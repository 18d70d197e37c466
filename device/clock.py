"""Time: monotonic nanoseconds for what is measured, a wall clock with a stated source for what is shown."""

from __future__ import annotations

import threading
import time
import uuid
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Literal

from device.errors import Invalid

ClockSource = Literal["rtc", "ntp", "browser", "none"]

# A clock that says less has lost its battery; the first release cannot have measured anything before it.
_EARLIEST_EPOCH_MS = int(datetime(2025, 1, 1, tzinfo=UTC).timestamp() * 1000)
_LATEST_EPOCH_MS = int(datetime(2100, 1, 1, tzinfo=UTC).timestamp() * 1000)


class Clock:
    """Monotonic time and, as an offset to it, the wall clock.

    The system's wall clock is believed when it was set over the network (``ntp``) or comes from a battery-backed clock
    (``rtc``); otherwise the browser's offer is taken (``browser``), and until one comes the date is unknown (``none``).
    ``root`` holds the ``/sys``, ``/run`` and ``/proc`` to look at, so that a folder of fakes can stand in for a machine.
    """

    def __init__(
        self,
        root: Path = Path("/"),
        monotonic_ns: Callable[[], int] = time.monotonic_ns,
        system_epoch_ms: Callable[[], int] = lambda: time.time_ns() // 1_000_000,
    ) -> None:
        self._monotonic_ns = monotonic_ns
        self._system_epoch_ms = system_epoch_ms
        self._root = root
        self._lock = threading.Lock()
        self._browser_offset_ms: int | None = None
        self.boot_id = _boot_id(root)
        """Monotonic times can be compared within one boot only."""

    def monotonic_ns(self) -> int:
        """Nanoseconds since an arbitrary moment of this boot; never jumps."""
        return self._monotonic_ns()

    @property
    def source(self) -> ClockSource:
        """Where the wall clock comes from."""
        if _EARLIEST_EPOCH_MS <= self._system_epoch_ms() < _LATEST_EPOCH_MS:
            if _set_by_network(self._root):
                return "ntp"
            if _battery_clock_is_set(self._root):
                return "rtc"
        return "none" if self._browser_offset_ms is None else "browser"

    def epoch_ms(self) -> int | None:
        """Milliseconds since 1970, or None while the date is unknown."""
        source = self.source
        if source in ("ntp", "rtc"):
            return self._system_epoch_ms()
        with self._lock:
            if self._browser_offset_ms is None:
                return None
            return self._monotonic_ns() // 1_000_000 + self._browser_offset_ms

    def offer(self, epoch_ms: int) -> bool:
        """The browser offers its time. Returns whether the wall clock now comes from it. Raises Invalid."""
        if isinstance(epoch_ms, bool) or not isinstance(epoch_ms, int) or not _EARLIEST_EPOCH_MS <= epoch_ms < _LATEST_EPOCH_MS:
            raise Invalid("The time offered is not a date between 2025 and 2100.")
        if self.source in ("ntp", "rtc"):
            return False
        with self._lock:
            self._browser_offset_ms = epoch_ms - self._monotonic_ns() // 1_000_000
        return True


def iso(epoch_ms: int | None) -> str | None:
    """ISO 8601 in UTC, to the second; None stays None."""
    if epoch_ms is None:
        return None
    return datetime.fromtimestamp(epoch_ms / 1000, tz=UTC).strftime("%Y-%m-%dT%H:%M:%SZ")


def _set_by_network(root: Path) -> bool:
    return (root / "run/systemd/timesync/synchronized").exists()


def _battery_clock_is_set(root: Path) -> bool:
    for device in sorted((root / "sys/class/rtc").glob("rtc*")):
        try:
            if int((device / "since_epoch").read_text()) * 1000 >= _EARLIEST_EPOCH_MS:
                return True
        except (OSError, ValueError):
            continue  # a clock chip that cannot be read is none
    return False


def _boot_id(root: Path) -> str:
    try:
        return (root / "proc/sys/kernel/random/boot_id").read_text().strip()
    except OSError:
        return uuid.uuid4().hex
