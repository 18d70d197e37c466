"""In-process events: whoever listens slowly gets the newest of each kind, and never holds up the one who tells."""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass, field
from typing import Any

from device.json_text import dumps


@dataclass(frozen=True)
class Event:
    """Something happened. ``data`` is JSON-ready and shared by all subscribers: nobody may change it."""

    name: str
    data: dict[str, Any]
    moment_ns: int = field(default_factory=time.monotonic_ns)
    """When it was told of."""
    _lock: threading.Lock = field(default_factory=threading.Lock, repr=False, compare=False)
    _text: list[str] = field(default_factory=list, repr=False, compare=False)

    def json(self) -> str:
        """``data`` as JSON, made once however many listen."""
        with self._lock:  # the second listener waits for the first one's text
            if not self._text:
                self._text.append(dumps(self.data))
            return self._text[0]


class Subscription:
    """One listener. At most one event of each name waits for it, the newest; the ones it was too slow for are counted."""

    def __init__(self, bus: Bus) -> None:
        self._bus = bus
        self._waiting: dict[str, Event] = {}
        self._condition = threading.Condition()
        self._closed = False
        self._dropped = 0

    @property
    def closed(self) -> bool:
        """True when no event will come any more: closed by the listener, or the device is shutting down."""
        return self._closed

    @property
    def dropped(self) -> int:
        """How many events were replaced by a newer one before they were fetched."""
        return self._dropped

    def get(self, timeout_s: float) -> Event | None:
        """The event that has waited longest, or None after ``timeout_s`` seconds or once closed (see ``closed``)."""
        deadline = time.monotonic() + timeout_s
        with self._condition:
            while not self._waiting and not self._closed:
                remaining = deadline - time.monotonic()
                if remaining <= 0:
                    return None
                self._condition.wait(remaining)
            if not self._waiting:
                return None
            return self._waiting.pop(next(iter(self._waiting)))

    def close(self) -> None:
        """Stop listening. May be called twice."""
        self._bus.forget(self)
        self.end()

    def offer(self, event: Event) -> None:
        """Called by the bus."""
        with self._condition:
            if self._closed:
                return
            if event.name in self._waiting:
                self._dropped += 1  # keeps its place in the queue, so that a fast kind cannot starve a rare one
            self._waiting[event.name] = event
            self._condition.notify()

    def end(self) -> None:
        """Called by the bus: wake the listener up for the last time. What already waits can still be fetched."""
        with self._condition:
            self._closed = True
            self._condition.notify_all()


class Bus:
    """Everything that happens in the device, for whoever wants to know."""

    def __init__(self) -> None:
        self._subscriptions: list[Subscription] = []
        self._lock = threading.Lock()
        self._closed = False

    def subscribe(self) -> Subscription:
        """A new listener; it hears what is published from now on."""
        subscription = Subscription(self)
        with self._lock:
            if self._closed:
                subscription.end()
            else:
                self._subscriptions.append(subscription)
        return subscription

    def publish(self, name: str, data: dict[str, Any]) -> None:
        """Tell every listener. Never waits for one."""
        event = Event(name, data)
        with self._lock:
            listeners = list(self._subscriptions)
        for listener in listeners:
            listener.offer(event)

    def forget(self, subscription: Subscription) -> None:
        """Called by ``Subscription.close``."""
        with self._lock:
            if subscription in self._subscriptions:
                self._subscriptions.remove(subscription)

    def close(self) -> None:
        """Wake up every listener for the last time."""
        with self._lock:
            self._closed = True
            listeners, self._subscriptions = self._subscriptions, []
        for listener in listeners:
            listener.end()
