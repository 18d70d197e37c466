"""Waiting for what another thread, process or page is about to do."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any


def wait_until(condition: Callable[[], Any], within_s: float = 20.0) -> None:
    """Fails where it does not happen. (In a browser use this, not the page's own polling: the page's policy forbids `eval`.)"""
    deadline = time.monotonic() + within_s
    while not condition():
        assert time.monotonic() < deadline, "it did not happen in time"
        time.sleep(0.005)
