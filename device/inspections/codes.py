"""The table of observation codes (``device/data/observations/codes.json``): what codes mean, and which class becomes which."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any, Literal

Clock = Literal["none", "one", "range"]


@dataclass(frozen=True)
class Code:
    """A main code: its text in English and German, how it lies around the pipe, the unit of its first quantification ("mm",
    "%" or None), allowed characterisations, its counterparts, and what the entry was checked against."""

    code: str
    en: str
    de: str
    clock: Clock
    q1: str | None
    ch1: dict[str, str]
    ch2: dict[str, str]
    mscc5: str
    pacp: str
    verified: tuple[str, ...]

    def text(self, language: str) -> str:
        """In "en" or "de"."""
        return self.de if language == "de" else self.en


@cache
def codes() -> dict[str, Code]:
    """Every code by its letters."""
    return {
        name: Code(
            name,
            entry["en"],
            entry["de"],
            entry["clock"],
            entry["q1"],
            entry.get("ch1", {}),
            entry.get("ch2", {}),
            entry["mscc5"],
            entry["pacp"],
            tuple(entry["verified"]),
        )
        for name, entry in _table()["codes"].items()
    }


@cache
def of_class(label: str) -> dict[str, Any] | None:
    """The code and characterisations that a landmark of the class ``label`` gets; None for a class without one."""
    found: dict[str, Any] | None = _table()["classes"].get(label)
    return found


@cache
def _table() -> dict[str, Any]:
    text = files("device.data").joinpath("observations/codes.json").read_text(encoding="utf-8")
    table: dict[str, Any] = json.loads(text)
    return table
