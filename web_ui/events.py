"""Live events: one Server-Sent Events stream per tab, capped, with heartbeats, gone when its client is.

A phone that leaves the hotspot says no goodbye. Its stream ends when the tab comes back with the same `tab` name (the new
stream replaces the old one), or when TCP gives the peer up (`web_ui.server` sets the timeout).
"""

import threading
import time
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

from flask import Blueprint, Response, request

from device.bus import Subscription
from device.json_text import dumps
from web_ui import bodies, faults, guards

if TYPE_CHECKING:
    from device.daemon import Device

STREAM_CAP = 8
HEARTBEAT_S = 10.0
_WAIT_S = 1.0  # how long a stream may take to notice that it is no longer wanted


class Streams:
    """The streams open now: at most `cap`, and at most one for each tab name."""

    def __init__(self, cap: int) -> None:
        self._cap = cap
        self._lock = threading.Lock()
        self._open: dict[str, Stream] = {}
        self._unnamed = 0

    def admit(self, stream: "Stream", tab: str) -> str | None:
        """Register `stream`; returns its key, or None at the cap. An older stream of the same tab is told to end."""
        with self._lock:
            if not tab:
                self._unnamed += 1
                tab = f"unnamed {self._unnamed}"
            older = self._open.get(tab)
            if older is None and len(self._open) >= self._cap:
                return None
            self._open[tab] = stream
        if older is not None:
            older.stop()
        return tab

    def leave(self, stream: "Stream", key: str) -> None:
        """Forget `stream` unless a newer one of its tab has taken the place."""
        with self._lock:
            if self._open.get(key) is stream:
                del self._open[key]

    def __len__(self) -> int:
        with self._lock:
            return len(self._open)


class Stream:
    """The bytes of one client's stream, as a WSGI iterable; `close` is called by the server in every case."""

    def __init__(self, device: "Device", gone: Callable[[], bool]) -> None:
        self._device = device
        self._gone = gone  # the client went away, or is no longer let in
        self._stopped = threading.Event()
        self._on_close: Callable[[], None] = lambda: None
        self._subscription: Subscription | None = None

    def when_closed(self, action: Callable[[], None]) -> None:
        """Run `action` once the stream is closed."""
        self._on_close = action

    def stop(self) -> None:
        """Let the stream end within a second."""
        self._stopped.set()

    def close(self) -> None:
        """End the stream and give its place back."""
        self._stopped.set()
        if self._subscription is not None:
            self._subscription.close()
        self._on_close()

    def __iter__(self) -> Iterator[bytes]:
        self._subscription = subscription = self._device.subscribe()
        yield b"retry: 2000\n\n"
        yield frame("status", self._device.status())
        yield frame("live", self._device.live())
        yield frame("drive", self._device.drive.state())
        yield frame("structure", self._device.structure.state())
        yield frame("control", self._device.access.state())
        spoke = time.monotonic()
        while not (self._stopped.is_set() or subscription.closed or self._gone()):
            event = subscription.get(_WAIT_S)
            if event is not None:
                yield b"id: %d\n" % event.moment_ns + wire(event.name, event.json())  # how old it is when it arrives
            elif time.monotonic() - spoke < HEARTBEAT_S:
                continue
            else:
                yield b": still here\n\n"
            spoke = time.monotonic()


def wire(name: str, text: str) -> bytes:
    """One event in the stream's wire format (the JSON `text` holds no line break)."""
    return f"event: {name}\ndata: {text}\n\n".encode()


def frame(name: str, data: Any) -> bytes:
    """`data` as one event."""
    return wire(name, dumps(data))


def blueprint(device: "Device", cap: int) -> Blueprint:
    """The route of the stream, for at most `cap` clients at a time."""
    events = Blueprint("events", __name__, url_prefix="/api/v1")
    streams = Streams(cap)

    @events.get("/events")
    def stream() -> Response:
        tab = bodies.read_query(bodies.EventsQuery).tab
        disconnected = request.environ.get("waitress.client_disconnected", lambda: False)
        token = request.cookies.get(guards.COOKIE, "")
        body = Stream(device, lambda: disconnected() or device.access.session(token) is None)
        key = streams.admit(body, tab)
        if key is None:
            response = faults.answer(503, f"{cap} screens are already watching this box; close one of them.")
            response.headers["Retry-After"] = "15"
            return response
        body.when_closed(lambda: streams.leave(body, key))
        return Response(body, mimetype="text/event-stream", headers={"X-Accel-Buffering": "no"})

    return events
