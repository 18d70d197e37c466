"""A counter whose line is described in the configuration: a regular expression with one named group.

``distance`` is a length with a decimal point or comma; ``count`` a whole number. "DIST: 12.3 m" is read by
``DIST:\\s*(?P<distance>-?[\\d.]+)\\s*m``.
"""

from __future__ import annotations

import re

from drivers.encoder.numerals import number_and_step
from drivers.encoder.serial_line import LineEncoder, LineValue
from drivers.encoder.unwrap import Unwrapper

GROUPS = ("distance", "count")


def compiled(pattern: str) -> re.Pattern[str]:
    """The pattern, ready to use. Raises ValueError with a sentence where it is none or names no group, or both."""
    try:
        expression = re.compile(pattern, re.ASCII)
    except (re.error, RecursionError, OverflowError) as error:
        raise ValueError(f"The pattern of the counter's line is no regular expression: {error}.") from error
    named = [group for group in GROUPS if group in expression.groupindex]
    if len(named) != 1:
        raise ValueError("The pattern of the counter's line must name one group: (?P<distance>...) or (?P<count>...).")
    return expression


def parse_line(line: bytes, expression: re.Pattern[str], metres_per_unit: float = 1.0) -> LineValue | None:
    """What a line says that has the pattern anywhere in it, None where it has not or the group holds no number."""
    match = expression.search(line.decode("latin-1"))
    if match is None:
        return None
    found = match.groupdict()
    number = number_and_step(found.get("distance") or found.get("count") or "")
    if number is None:
        return None
    if "distance" in found:
        return LineValue(value=number[0] * metres_per_unit, unit="m", quantum=number[1] * metres_per_unit)
    return LineValue(value=number[0]) if number[1] == 1.0 else None


class PatternEncoder(LineEncoder):
    """A counter line after a pattern. ``metres_per_unit`` scales a ``distance`` that is not in metres; a ``count`` of ``bits``
    bits is unwrapped. Raises ValueError for a pattern that is none."""

    def __init__(
        self, port: str, pattern: str, baud: int = 9600, metres_per_unit: float = 1.0, bits: int = 32, name: str = "counter"
    ) -> None:
        super().__init__(port, baud, name)
        self._expression = compiled(pattern)
        self._metres_per_unit = metres_per_unit
        self._unwrapper = Unwrapper(bits)

    def parse(self, line: bytes) -> LineValue | None:
        """See ``parse_line``."""
        return parse_line(line, self._expression, self._metres_per_unit)

    def unwrapped(self, value: LineValue) -> float:
        """A distance as it is, a count without its overflows."""
        return value.value if value.unit == "m" else float(self._unwrapper.add(int(value.value)))
