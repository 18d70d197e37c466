"""A consumer's own queue of samples: bounded, the newest win, the lost ones are counted."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Generic

from device.feeds.samples import S


class Tap(Generic[S]):
    """Samples of one source for one consumer."""

    def __init__(self, size: int, on_close: Callable[[Tap[S]], None]) -> None:
        self._samples: deque[S] = deque(maxlen=size)
        self._condition = threading.Condition()
        self._on_close = on_close
        self._closed = False
        self.dropped = 0
        """Samples that were pushed out by newer ones before anybody fetched them."""

    @property
    def waiting(self) -> int:
        """How many samples nobody has fetched yet."""
        return len(self._samples)

    def offer(self, sample: S) -> None:
        """Called by the feed."""
        with self._condition:
            if self._closed:
                return
            if len(self._samples) == self._samples.maxlen:
                self.dropped += 1
            self._samples.append(sample)
            self._condition.notify()

    def get(self, timeout_s: float) -> S | None:
        """The oldest sample still waiting, or None after ``timeout_s`` seconds or once closed."""
        deadline = time.monotonic() + timeout_s
        with self._condition:
            while not self._samples and not self._closed:
                remaining = deadline - time.monotonic()
                if remaining <= 0:
                    return None
                self._condition.wait(remaining)
            return self._samples.popleft() if self._samples else None

    def close(self) -> None:
        """No more samples. May be called twice."""
        with self._condition:
            self._closed = True
            self._samples.clear()
            self._condition.notify_all()
        self._on_close(self)


class Relay(Tap[S]):
    """Hands each sample on as it comes, in the thread that brings it: ``take`` must return at once."""

    def __init__(self, take: Callable[[S], object], on_close: Callable[[Tap[S]], None]) -> None:
        super().__init__(1, on_close)
        self._take = take

    def offer(self, sample: S) -> None:
        """Called by the feed."""
        if not self._closed:
            self._take(sample)
