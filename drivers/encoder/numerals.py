"""Numbers as counters write them."""

from __future__ import annotations

import math
import re

_NUMBER = re.compile(r"[+-]?(\d+(?:[.,](\d*))?|[.,](\d+))", re.ASCII)


def number_and_step(text: str) -> tuple[float, float] | None:
    """The value of a decimal number and the step of its last digit: "-00004.8" is (-4.8, 0.1). None where it is none.

    A decimal comma counts as a point. No exponents, no infinities.
    """
    match = _NUMBER.fullmatch(text.strip(" "))
    if match is None:
        return None
    value = float(match.group(0).replace(",", "."))
    if not math.isfinite(value):
        return None
    digits = match.group(2) or match.group(3) or ""
    return value, 10.0 ** -len(digits)
