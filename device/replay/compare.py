"""Two findings side by side: equal bit by bit, or what differs, and whether that is more than another machine may cause."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from device.json_text import dumps

TOLERANCES = {"_mm": 0.5, "_m": 0.02, "clock": 0.1, "_s": 0.1}
"""By the end of a value's name, in its own unit: what other versions of the libraries or another processor may cause. The
resolution of the tether is 1 cm at best, the tolerance of a liner is millimetres."""
RELATIVE = 0.02
"""Of all other numbers."""


@dataclass(frozen=True)
class Difference:
    """One value that is not the same: where it stands, then and now."""

    where: str
    logged: Any
    replayed: Any
    tolerable: bool


def plain_json(value: Any) -> Any:
    """As it comes out of a JSON text: tuples are lists, no number is a numpy one."""
    return json.loads(dumps(value))


def differences(logged: Any, replayed: Any) -> list[Difference]:
    """All of them, in the order of the logged one; empty where they are equal bit by bit."""
    return list(_walk("", "", logged, replayed))


def _walk(where: str, name: str, then: Any, now: Any) -> Iterator[Difference]:
    if isinstance(then, dict) and isinstance(now, dict):
        for key in [*then, *(key for key in now if key not in then)]:
            place = f"{where}.{key}" if where else key
            if key in then and key in now:
                yield from _walk(place, key, then[key], now[key])
            else:
                yield Difference(place, then.get(key), now.get(key), False)
    elif isinstance(then, list) and isinstance(now, list) and len(then) == len(now):
        for number, pair in enumerate(zip(then, now, strict=True)):
            yield from _walk(f"{where}[{number}]", name, *pair)
    elif repr(then) != repr(now):  # the shortest text that means this very number: -0.0 is not 0.0, and 1 is not 1.0
        yield Difference(where, then, now, _tolerable(name, then, now))


def _tolerable(name: str, then: Any, now: Any) -> bool:
    if any(isinstance(value, bool) or not isinstance(value, int | float) for value in (then, now)):
        return False
    allowed = next((value for end, value in TOLERANCES.items() if name.endswith(end)), RELATIVE * max(abs(then), abs(now)))
    return math.isclose(then, now, rel_tol=0.0, abs_tol=allowed)
