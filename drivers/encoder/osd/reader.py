"""Reads the distance that is burned into a CCTV picture: finds its line once, then recognises only that strip."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.encoder.osd.ocr import Ocr
from drivers.encoder.osd.text import Found, Layout, OsdUnit, find_distance

Box = tuple[int, int, int, int]
"""x, y, width, height in pixels."""

SURE = 0.985
"""Confidence above which the first look at a strip is believed. In cctv_run whole digits read with 0.99 and more, digits caught
while the counter turned with 0.82 to 0.97."""

FAITH = 0.5
"""Confidence below which a strip is not taken for text."""
ALONE = 0.8
"""Confidence that a strip must have where the other look at it, with more or less room, has no distance."""
LEAP_M = 2.0
"""Metres between two pictures that ask for a second look."""


@dataclass(frozen=True)
class OsdText:
    """What was read in one picture. ``distance`` in metres, None where no text has the format of one.

    ``text`` as the OCR read it, ``confidence`` 0 to 1, ``box`` where (None where nothing was found). ``layout`` how the counter
    is written. ``others``: further readings of the same line, metres, where its two fields differ because the counter turned
    between them: each of them was on the screen.
    """

    distance: float | None
    text: str = ""
    confidence: float = 0.0
    box: Box | None = None
    layout: Layout | None = None
    digits: str = ""
    others: tuple[float, ...] = ()


@dataclass
class _Place:
    """Where a distance stood, the last one, its decimals, and whether the room beside it is ``spoiled`` by the background."""

    box: Box
    distance: float = 0.0
    part: int = 0
    spoiled: bool = False

    def expects(self, seen: OsdText) -> bool:
        """Whether a first look needs no second one. Without room a sign that appears would be missed, so near zero it does."""
        if seen.distance is None or seen.layout is None or seen.confidence < SURE or seen.layout.part != self.part:
            return False
        return abs(seen.distance - self.distance) < LEAP_M and not (self.spoiled and abs(seen.distance) < LEAP_M)

    def fit(self, seen: OsdText) -> tuple[bool, float]:
        """How well a reading follows from the last one: the greater the better."""
        return seen.layout is not None and seen.layout.part == self.part, -abs((seen.distance or 0.0) - self.distance)


class OsdReader:
    """Reads picture after picture of one video and remembers where the distance stands.

    ``region`` (x, y, w, h) in pixels confines the search; None searches the whole picture. ``unit`` is meant where the text
    names none. ``look_again``: pictures between two searches while reading goes well. Raises SensorMissing where the extra
    ``osd`` is not installed.
    """

    def __init__(self, region: Box | None = None, unit: OsdUnit = "m", look_again: int = 1000) -> None:
        if region is not None and (len(region) != 4 or min(region[0], region[1]) < 0 or min(region[2], region[3]) < 4):
            raise ValueError(f"A region is x, y, width and height in pixels, at least 4 by 4; this is {region}.")
        self._region = region
        self._unit: OsdUnit = unit
        self._look_again = look_again
        self._places: list[_Place] = []
        self._patience = 0
        self._fruitless = 0
        self._read_since = 0
        self._ocr = Ocr()
        self.searches = 0
        """Searches of the whole picture (or region) so far."""
        self.lines: tuple[str, ...] = ()
        """All lines of the last search, for telling what was there instead of a distance."""

    @property
    def where(self) -> str:
        """Where it looks, for a sentence."""
        if self._region is None:
            return "anywhere in the picture"
        x, y, width, height = self._region
        return f"in the region {x},{y},{width},{height}"

    def read(self, image: NDArray[np.uint8], patient: bool = True) -> OsdText:
        """The distance in ``image`` (H, W, 3) BGR.

        The places where it stood before are looked at first; the whole picture is searched where it stands in none of them,
        ``patient``: less and less often while that finds nothing (after 1, 2, 4 .. 32 pictures).
        """
        unreadable = OsdText(None)
        if self._read_since < self._look_again:
            for place in self._places:
                seen = self._read_place(image, place)
                if seen.distance is not None:
                    self._remember(place, seen)
                    self._read_since += 1
                    self._fruitless = self._patience = 0
                    return seen
                if place is self._places[0]:
                    unreadable = seen
            if patient and self._patience > 0:
                self._patience -= 1
                return unreadable
        return self._search(image, unreadable)

    def _search(self, image: NDArray[np.uint8], unreadable: OsdText) -> OsdText:
        """Finds the line that looks most like a distance; ``unreadable``, the text of the last place, where there is none."""
        self.searches += 1
        self._read_since = 0
        best, merit = unreadable, 0.0
        lines = list(self._find_lines(image))
        self.lines = tuple(line.text for line in lines)
        for line in lines:
            found = find_distance(line.text, self._unit)
            if found is None or line.box is None or line.confidence < FAITH or found.likeness * line.confidence <= merit:
                continue
            seen = self._read_strip(_crop(image, line.box), line.box)
            best = seen if seen.distance is not None else self._with(line, found)
            merit = found.likeness * line.confidence
        if best.distance is None or best.box is None:
            self._fruitless = min(self._fruitless + 1, 6)
            self._patience = 2 ** (self._fruitless - 1)
            return best
        self._fruitless = self._patience = 0
        self._remember(_Place(best.box), best)
        return best

    def _find_lines(self, image: NDArray[np.uint8]) -> Iterator[OsdText]:
        x, y, width, height = self._region or (0, 0, image.shape[1], image.shape[0])
        part = image[y : y + height, x : x + width]
        if part.shape[0] < 4 or part.shape[1] < 4:
            return
        lines = self._ocr.lines(part)
        for text, confidence, (left, top, right, bottom) in lines:
            yield OsdText(None, text, confidence, (x + left, y + top, right - left, bottom - top))
        if not lines and self._region is not None:
            text, confidence = self._ocr.strip(part)
            yield OsdText(None, text, confidence, (x, y, part.shape[1], part.shape[0]))

    def _read_place(self, image: NDArray[np.uint8], place: _Place) -> OsdText:
        """The distance at a known place. It is read with room at both sides, for a number grows by a digit or a sign; where the
        background in that room is taken for digits, without."""
        crops = (_crop(image, place.box), _crop(image, place.box, room=0.7))
        first = self._read_strip(crops[0] if place.spoiled else crops[1], place.box)
        if place.expects(first):
            return first
        second = self._read_strip(crops[1] if place.spoiled else crops[0], place.box)
        tight, wide = (first, second) if place.spoiled else (second, first)
        if tight.distance is None or wide.distance is None:
            only = wide if tight.distance is None else tight
            return only if only.confidence >= ALONE else replace(only, distance=None)
        if wide.digits == "-" + tight.digits:
            return wide
        place.spoiled = place.fit(tight) > place.fit(wide)
        return tight if place.spoiled else wide

    def _read_strip(self, strip: NDArray[np.uint8], place: Box) -> OsdText:
        """The distance in a strip. A doubtful one is read again in the two fields of the interlaced picture, where a digit that
        turned between them is whole in each."""
        if strip.shape[0] < 4 or strip.shape[1] < 4:
            return OsdText(None)
        seen = self._recognise(strip, place)
        if (seen.distance is not None and seen.confidence >= SURE) or strip.shape[0] < 16:
            return seen
        size = strip.shape[1], strip.shape[0]
        fields = [self._recognise(cv2.resize(strip[first::2], size).astype(np.uint8), place) for first in (0, 1)]
        best = max((seen, *fields), key=lambda one: (one.distance is not None, one.confidence))
        others = dict.fromkeys(one.distance for one in fields if one.distance is not None and one.distance != best.distance)
        return replace(best, others=tuple(value for value in others if value is not None))

    def _recognise(self, strip: NDArray[np.uint8], place: Box) -> OsdText:
        text, confidence = self._ocr.strip(strip)
        found = find_distance(text, self._unit)
        line = OsdText(None, text, confidence, place)
        return line if found is None or confidence < FAITH else self._with(line, found)

    @staticmethod
    def _with(line: OsdText, found: Found) -> OsdText:
        confidence = line.confidence * (0.8 if found.mended else 1.0)
        return replace(line, distance=found.metres, layout=found.layout, digits=found.digits, confidence=confidence)

    def _remember(self, place: _Place, seen: OsdText) -> None:
        """The place of the last reading first, at most four: a counter moves between a few when text is shown over it."""
        place.distance, place.part = seen.distance or 0.0, seen.layout.part if seen.layout else 0
        self._places = [place, *(other for other in self._places if not _same(other.box, place.box))][:4]


def _crop(image: NDArray[np.uint8], place: Box, room: float = 0.0) -> NDArray[np.uint8]:
    """The strip, with ``room`` heights more to the right, half of it to the left. Detectors draw boxes higher than the letters,
    up to the lines above and below: a little is taken off."""
    x, y, width, height = place
    right, spare = math.ceil(room * height), round(0.1 * height)
    return np.ascontiguousarray(image[y + spare : y + height - spare, max(0, x - right // 2) : x + width + right])


def _same(one: Box, other: Box) -> bool:
    return abs(one[1] - other[1]) < 0.35 * max(one[3], other[3]) and abs(one[0] - other[0]) < max(one[3], other[3])
