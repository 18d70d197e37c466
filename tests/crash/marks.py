"""What was promised before a cut, and whether it was kept.

A workload marks ("offered", key, null) for each raw sample, which may be lost within a second. For findings and settings it
marks ("begin", key, content) before it changes what ``key`` stands for and ("shown", key, content) when it has been
told that the change is saved. After a cut each key must hold what was last shown, or what was begun since.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

from tests.crash.shim import Operation


@dataclass
class Promises:
    """What each key may hold now."""

    shown: dict[str, Any] = field(default_factory=dict)
    begun: dict[str, list[Any]] = field(default_factory=dict)
    offered: dict[str, int] = field(default_factory=dict)
    """Raw samples, and when (ns) they were handed over."""
    now_ns: int = 0
    """When the power went, at the latest."""
    present: set[str] = field(default_factory=set)
    """The raw samples that were there when it was last asked."""
    raw_lost_s: float = 0.0
    """Of all cuts so far, the longest time from the oldest raw sample that is gone to the cut."""

    stood_s: float = 0.0
    """The longest time between two raw samples, which come every 20 ms where the machine has time for it."""
    _offered_ns: int = 0

    def take(self, log: Iterable[Operation]) -> None:
        """Go on, over the marks of a further piece of the log."""
        for operation in log:
            if operation.op != "mark":
                continue
            mark = json.loads(operation.data)
            key, content = mark["key"], mark["content"]
            if mark["what"] == "begin":
                self.begun.setdefault(key, []).append(content)
            elif mark["what"] == "offered":
                self.stood_s = max(self.stood_s, (operation.ns - self._offered_ns) / 1e9 if self._offered_ns else 0.0)
                self.offered[key] = self._offered_ns = operation.ns
            elif mark["what"] == "shown":
                self.shown[key] = content
                self.begun.pop(key, None)

    def raw(self, found: set[str]) -> None:
        """These raw samples are there."""
        self.present = found
        gone = [ns for key, ns in self.offered.items() if key not in found]
        if gone:
            self.raw_lost_s = max(self.raw_lost_s, (self.now_ns - min(gone)) / 1e9)

    def settle(self) -> None:
        """What is gone is gone; what came through this cut has to come through the next one."""
        self._offered_ns = 0
        self.offered = {key: ns for key, ns in self.offered.items() if key in self.present}

    def broken(self, key: str, found: Any) -> str:
        """What is wrong with ``found`` (None: nothing there) under ``key``; empty where it is as promised."""
        allowed = [*self.begun.get(key, [])]
        if key in self.shown:
            allowed.append(self.shown[key])
        elif found is None:
            return ""
        if found in allowed:
            return ""
        if found is None:
            return f"{key}, shown as saved, is gone"
        return f"{key} holds {json.dumps(found)[:200]}, which was neither shown nor begun"
