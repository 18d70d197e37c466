"""What was promised before a cut, and whether it was kept.

A workload marks ("begin", key, content) before it changes what ``key`` stands for and ("shown", key, content) when it has been
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

    def take(self, marks: Iterable[Operation]) -> None:
        """Go on, over further marks."""
        for operation in marks:
            mark = json.loads(operation.data)
            key, content = mark["key"], mark["content"]
            if mark["what"] == "begin":
                self.begun.setdefault(key, []).append(content)
            elif mark["what"] == "shown":
                self.shown[key] = content
                self.begun.pop(key, None)

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
