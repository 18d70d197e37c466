"""The lamp as the rest of the house sees it: a level between 0 (off) and 1."""

from __future__ import annotations

from abc import ABC, abstractmethod


class Lamp(ABC):
    """One lamp that can be dimmed. A driver implements ``open``, ``_set`` and ``close``; it never overrides ``set``."""

    name: str = "lamp"

    @abstractmethod
    def open(self) -> None:
        """Take hold of it, dark. Raises SensorMissing where there is no such lamp or its software is not installed."""

    def set(self, level: float) -> None:
        """Shine at ``level`` of the full power. Raises ValueError outside 0 to 1, SensorLost where the lamp does not obey."""
        if not 0.0 <= level <= 1.0:
            raise ValueError(f"A lamp shines between 0 and 1, not {level}.")
        self._set(level)

    @abstractmethod
    def _set(self, level: float) -> None: ...

    @abstractmethod
    def close(self) -> None:
        """Dark, and let go of it. Never raises, may be called twice."""
