"""A consumer's own queue of frames: bounded, the newest win, the lost ones are counted."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable

from drivers.depth.base import DepthFrame


class FrameTap:
    """Frames of one camera for one consumer."""

    def __init__(self, size: int, on_close: Callable[[FrameTap], None]) -> None:
        self._frames: deque[DepthFrame] = deque(maxlen=size)
        self._condition = threading.Condition()
        self._on_close = on_close
        self._closed = False
        self.dropped = 0
        """Frames that were pushed out by newer ones before anybody fetched them."""

    def offer(self, frame: DepthFrame) -> None:
        """Called by the feed."""
        with self._condition:
            if self._closed:
                return
            if len(self._frames) == self._frames.maxlen:
                self.dropped += 1
            self._frames.append(frame)
            self._condition.notify()

    def get(self, timeout_s: float) -> DepthFrame | None:
        """The oldest frame still waiting, or None after ``timeout_s`` seconds or once closed."""
        deadline = time.monotonic() + timeout_s
        with self._condition:
            while not self._frames and not self._closed:
                remaining = deadline - time.monotonic()
                if remaining <= 0:
                    return None
                self._condition.wait(remaining)
            return self._frames.popleft() if self._frames else None

    def close(self) -> None:
        """No more frames. May be called twice."""
        with self._condition:
            self._closed = True
            self._frames.clear()
            self._condition.notify_all()
        self._on_close(self)
