"""What the disk is for: findings first, then the newest raw data. Pure rules; ``shelf.py`` carries them out.

Going down: below ``keep_free`` the oldest recordings go, one after the other; where all of them together would not give
``stop_free`` they stay, recording ends cleanly, and what is free is for findings; below ``findings_free`` they go for those.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

MB = 1_000_000
LOW_DISK = "Recording is off: the disk is nearly full, what is left is kept for findings."


@dataclass(frozen=True)
class DiskPolicy:
    """Bytes. ``most_raw`` bounds all recordings together, None for as much as fits."""

    keep_free: int = 1000 * MB
    stop_free: int = 300 * MB
    findings_free: int = 100 * MB
    most_raw: int | None = None

    def __post_init__(self) -> None:
        if not 0 <= self.findings_free <= self.stop_free <= self.keep_free:
            raise ValueError("findings_free, stop_free and keep_free must grow in this order")


@dataclass(frozen=True)
class Stored:
    """One recording on the disk; ``in_use``: it is being written, or read by a replay."""

    path: Path
    size: int
    in_use: bool = False


@dataclass(frozen=True)
class Decision:
    """``remove`` these, oldest first; ``may_record`` once they are gone."""

    remove: tuple[Path, ...]
    may_record: bool


def decide(free: int, stored: Sequence[Stored], policy: DiskPolicy) -> Decision:
    """What to do with ``free`` bytes left and ``stored`` recordings, oldest first. Whoever is being written stays."""
    removable = sum(one.size for one in stored if not one.in_use)
    over = 0 if policy.most_raw is None else sum(one.size for one in stored) - policy.most_raw
    helps = free + removable >= policy.stop_free or free < policy.findings_free
    short = max(policy.keep_free - free if helps else 0, over)
    remove: list[Path] = []
    gained = 0
    for one in stored:
        if gained >= short:
            break
        if not one.in_use:
            remove.append(one.path)
            gained += one.size
    return Decision(tuple(remove), free + gained >= policy.stop_free)
