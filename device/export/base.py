"""What all formats share."""

from __future__ import annotations

import re
from dataclasses import dataclass
from datetime import date

from device.errors import Invalid
from device.inspections.model import Inspection

_NOT_IN_XML = re.compile(r"[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


@dataclass(frozen=True)
class Options:
    """``language`` is "en" or "de"; ``imperial`` puts feet and inches beside metres; ``made`` is today, None where the box does
    not know the date; ``program`` names who wrote the file."""

    language: str = "en"
    imperial: bool = False
    made: date | None = None
    program: str = "borescout"


def printable(text: str) -> str:
    """``text`` without what no exchange file may hold (control characters), on one line."""
    return " ".join(_NOT_IN_XML.sub("", text).split())


def fitting(text: str, most: int, what: str) -> str:
    """``text`` where a format holds it. Raises Invalid: a name that is cut is another name."""
    text = printable(text)
    if not text:
        raise Invalid(f"{what} is empty: enter it, then export again.")
    if len(text) > most:
        raise Invalid(
            f"{what} “{text}” is longer than the {most} letters that the format holds: shorten it, then export again."
        )
    return text


def day(inspection: Inspection, options: Options) -> date:
    """The day of the inspection, or today. Raises Invalid where neither is known."""
    if inspection.date:
        return date.fromisoformat(inspection.date[:10])
    if options.made is not None:
        return options.made
    raise Invalid("The date of the inspection is not known: enter it, or open the page on a phone, which sets the clock.")
