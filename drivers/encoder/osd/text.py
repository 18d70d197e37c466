"""The distance in a line of burned-in text: found by its format, whatever else the line says."""

from __future__ import annotations

import re
import unicodedata
from dataclasses import dataclass
from typing import Literal

OsdUnit = Literal["m", "ft"]
METRES: dict[OsdUnit, float] = {"m": 1.0, "ft": 0.3048}

LOOK_ALIKES = str.maketrans("OoDQIl|!ZSBG", "000011112586")
"""Letters that an OCR takes for the digits of these fonts."""

_UNITS: dict[str, OsdUnit] = {
    "m": "m", "mtr": "m", "meter": "m", "metre": "m", "meters": "m", "metres": "m",
    "ft": "ft", "feet": "ft", "foot": "ft", "f": "ft", "'": "ft",
}  # fmt: skip
_LABEL = re.compile(
    r"\b(dist(ance|anz)?|entf(ernung)?|stat(ion)?|chainage|chain|meter(age|stand)?|position|pos|len(gth)?|l[aä]nge|afstand)\b|距离"
)
_DIGIT = r"[0-9OoDQIl|!ZSBG]"
_NUMBER = re.compile(
    rf"(?:(?P<sign>[+-])(?P<gap>[ ]?))?(?P<whole>{_DIGIT}{{1,5}})"
    rf"(?:[ ]?(?P<point>[.,])[ ]?(?P<part>{_DIGIT}{{1,3}}))?"
    r"[ ]?(?P<unit>(?i:meters?|metres?|mtr|m|feet|foot|ft|f|'))?"
    r"(?![A-Za-z0-9])"
)


@dataclass(frozen=True)
class Layout:
    """How a counter is written: ``whole`` digits before the point where it is padded with zeros (0 where it is not), ``part``
    digits after it, and the unit that its values are in."""

    whole: int
    part: int
    unit: OsdUnit

    @property
    def quantum(self) -> float:
        """The step of the last digit, metres."""
        return METRES[self.unit] * 10.0**-self.part


@dataclass(frozen=True)
class Found:
    """A distance in a text. ``digits`` are those of the number with its sign and without its point.

    ``likeness`` 0 to 1: how much the line looks like a distance and not like another number. ``mended``: letters were taken
    for digits.
    """

    metres: float
    layout: Layout
    digits: str
    likeness: float
    mended: bool = False


def plain(text: str) -> str:
    """The text with full-width signs, dashes and typographic quotes as their plain ones."""
    text = unicodedata.normalize("NFKC", text).strip()
    return re.sub("[‐‑‒–—―−]", "-", re.sub("[’′`´]", "'", text)).replace("。", ".").replace("·", ".")


def find_distance(text: str, unit: OsdUnit = "m") -> Found | None:
    """The number in ``text`` that looks most like a distance; ``unit`` is meant where the text names none.

    A number with decimals qualifies, a whole one only with a unit or with a label such as "Dist". Dates, times, and numbers
    with another unit (%, °, bar, mm) do not.
    """
    text = plain(text)
    found = [one for one in (_judge(text, match, unit) for match in _NUMBER.finditer(text)) if one is not None]
    return max(found, key=lambda one: one.likeness, default=None)


def _judge(text: str, match: re.Match[str], unit: OsdUnit) -> Found | None:
    before, after = text[: match.start()], text[match.end() :]
    whole, part = match["whole"], match["part"] or ""
    mended = not (whole + part).isdigit()
    letters = sum(not sign.isdigit() for sign in whole + part)
    if 2 * letters > len(whole + part) and len(whole + part) - letters < 2:
        return None
    if re.search(r"[^\W_]$", before) or (match["sign"] is None and re.search(r"(^|\W)[0-9]+[.,:/]$", before)):
        return None  # the tail of a word, a date, a time
    if after[:1] and after[:1] in ".,:/" and after[1:2].isalnum():
        return None  # the head of one
    if match["unit"] is None and re.match(r"\s?(%|°|\"|bar\b|mbar\b|[cm]m\b|in\b|deg|v\b|kg|pa\b|hz)", after, re.IGNORECASE):
        return None
    named = _UNITS[match["unit"].lower()] if match["unit"] else None
    labelled = _LABEL.search(before.lower()) is not None
    if not part and not named and not labelled:
        return None
    # a minus belongs to the number where nothing stands before it, or it is written to it: "Dist-1.2", "Dist - 1.2" have a dash
    negative = match["sign"] == "-" and (not before.strip() or (before[-1:] in " :=" and not match["gap"]))
    whole, part = whole.translate(LOOK_ALIKES), part.translate(LOOK_ALIKES)
    padded = len(whole) if len(whole) > 1 and whole[0] == "0" else 0
    layout = Layout(padded, len(part), named or unit)
    metres = float(f"{whole}.{part or 0}") * METRES[layout.unit] * (-1 if negative else 1)
    rest = len(re.sub(r"[\s:=]", "", _LABEL.sub("", (before + " " + after).lower())))
    # each weight is only an order of merit between the lines of one picture
    likeness = 0.4 + 0.25 * (named is not None) + 0.2 * labelled + 0.1 * (padded > 0) + 0.05 * (len(part) in (1, 2))
    likeness *= (len(match.group()) / (len(match.group()) + rest)) * (0.7 if mended else 1.0)
    return Found(metres + 0.0, layout, ("-" if negative else "") + whole + part, likeness, mended)
