"""A counter of so many bits, seen without its overflows."""

from __future__ import annotations


class Unwrapper:
    """Follows a counter of ``bits`` bits by the shorter way round: right while it moves less than half its range between
    two readings. The first reading is taken as two's complement."""

    def __init__(self, bits: int = 32) -> None:
        self._range = 1 << bits
        self._value: int | None = None

    def add(self, raw: int) -> int:
        """The count without overflows."""
        if self._value is None:
            self._value = self._signed(raw)
        else:
            self._value += self._signed(raw - self._value)
        return self._value

    def _signed(self, number: int) -> int:
        half = self._range // 2
        return (number + half) % self._range - half
