"""What systemd is told: READY once the box can be used, WATCHDOG as long as its work loops turn, STATUS for whoever looks.

The protocol is one datagram of lines to the socket that ``$NOTIFY_SOCKET`` names (man sd_notify). Without it nothing is told.
"""

from __future__ import annotations

import logging
import os
import socket
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass

log = logging.getLogger(__name__)


class Notifier:
    """The socket of the service manager; None where there is none."""

    def __init__(self, address: str | None) -> None:
        self._address = address or None
        self._socket = None if not self._address else socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC)

    def tell(self, *lines: str) -> bool:
        """Send the lines as one message; whether anybody was there to take it. Never raises."""
        if self._socket is None or self._address is None:
            return False
        name = "\0" + self._address[1:] if self._address.startswith("@") else self._address
        try:
            self._socket.sendto("\n".join(lines).encode(), name)
        except OSError as error:
            log.warning("systemd could not be told %s: %s", lines[0], error)
            return False
        return True

    def close(self) -> None:
        """May be called twice."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None


class Turns:
    """The work loops of this process: each says that it has turned once more, and how long a turn may take.

    A loop that is not running is not late: it begins with its first turn and ends with ``over``.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._lock = threading.Lock()
        self._last: dict[str, tuple[float, float]] = {}

    def loop(self, name: str, limit_s: float) -> Callable[[], None]:
        """What the loop of that name calls on every turn."""

        def turn() -> None:
            with self._lock:
                self._last[name] = (self._clock(), limit_s)

        return turn

    def over(self, name: str) -> None:
        """The loop has ended as it should."""
        with self._lock:
            self._last.pop(name, None)

    def late(self) -> list[str]:
        """The loops that have not turned for longer than they may."""
        now = self._clock()
        with self._lock:
            return sorted(name for name, (last, limit_s) in self._last.items() if now - last > limit_s)


@dataclass(frozen=True)
class Watchdog:
    """How often systemd wants to hear of us; None: it does not."""

    period_s: float | None

    @staticmethod
    def of(environment: Mapping[str, str]) -> Watchdog:
        """From ``$WATCHDOG_USEC`` and ``$WATCHDOG_PID``, as man sd_watchdog_enabled has it."""
        try:
            period_us = int(environment.get("WATCHDOG_USEC", "0"))
            pid = int(environment.get("WATCHDOG_PID") or os.getpid())
        except ValueError:
            return Watchdog(None)
        return Watchdog(period_us / 1e6 if period_us > 0 and pid == os.getpid() else None)


class Keeper:
    """One thread between the box and systemd.

    READY is told when ``ready`` is true; how long that may take is the unit's TimeoutStartSec. Then WATCHDOG is told at a third
    of its period, only while no loop of ``turns`` is late, with ``status`` as the status line.
    """

    def __init__(
        self,
        notifier: Notifier,
        watchdog: Watchdog,
        turns: Turns,
        ready: Callable[[], bool],
        status: Callable[[], str],
        *,
        poke: Callable[[], None] = lambda: None,
        start_poll_s: float = 0.25,
    ) -> None:
        self._notifier, self._watchdog, self._turns = notifier, watchdog, turns
        self._ready, self._status, self._poke = ready, status, poke
        self._start_poll_s = start_poll_s
        self._stop = threading.Event()
        self._late: list[str] = []
        self._thread = threading.Thread(target=self._run, name="systemd", daemon=True)

    def start(self) -> None:
        """Begin to tell. Returns at once."""
        self._thread.start()

    def close(self) -> None:
        """Say that the box is stopping. May be called twice."""
        if not self._stop.is_set():
            self._stop.set()
            self._notifier.tell("STOPPING=1", "STATUS=stopping")
        if self._thread.is_alive():
            self._thread.join(2.0)
        self._notifier.close()

    def _run(self) -> None:
        while not self._ready():
            self._notifier.tell("STATUS=starting: " + self._status())
            if self._stop.wait(self._start_poll_s):
                return
        self._notifier.tell("READY=1", "STATUS=" + self._status())
        period_s = 10.0 if self._watchdog.period_s is None else self._watchdog.period_s / 3
        while not self._stop.wait(period_s):
            self._poke()
            late = self._turns.late()
            if late != self._late:
                log.log(
                    logging.ERROR if late else logging.INFO, "loops that stand still: %s", ", ".join(late) or "none any more"
                )
                self._late = late
            if late:
                self._notifier.tell("STATUS=stuck: " + ", ".join(late))
            else:
                self._notifier.tell("WATCHDOG=1", "STATUS=" + self._status())
