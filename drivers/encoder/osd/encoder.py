"""The burned-in distance as an encoder: pictures in, readings out; and the verdict whether a video has one at all."""

from __future__ import annotations

import threading
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import islice

from drivers.base import BadFrame, FrameTimeout
from drivers.encoder.base import Encoder, Reading
from drivers.encoder.osd.filter import Filtered, FilterSettings, OsdFilter, Reset
from drivers.encoder.osd.reader import OsdReader
from drivers.grabber.base import VideoFrame

REMEDY = "Give the place of the distance with --osd X,Y,W,H, or the distances with --distance-csv FILE."


class NoDistance(BadFrame):
    """No distance can be read in a video."""


class OsdEncoder(Encoder):
    """An encoder that is fed with pictures: ``feed`` from the grabber's side, ``read`` from the encoder's.

    The newest picture wins; ``dropped`` counts those that were replaced before they were read. A reading is in metres as the
    counter shows them; where the operator reset it, ``resets`` says so and the values go on from there. ``rejected`` counts
    pictures without a believable distance.
    """

    name = "burned-in distance"

    def __init__(self, reader: OsdReader | None = None, settings: FilterSettings | None = None) -> None:
        self.dropped = 0
        self.last: Filtered | None = None
        """What became of the picture read last."""
        self.resets: list[Reset] = []
        """The leaps between readings since ``open``, oldest first, each since when the counter shows it."""
        self._reader = reader
        self._filter = OsdFilter(settings)
        self._given: Filtered | None = None
        self._waiting: VideoFrame | None = None
        self._changed = threading.Condition()

    def feed(self, frame: VideoFrame) -> None:
        """The next picture. Returns at once."""
        with self._changed:
            self.dropped += self._waiting is not None
            self._waiting = frame
            self._changed.notify()

    def _open(self) -> None:
        self._reader = self._reader or OsdReader()
        self._filter = OsdFilter(self._filter.settings)
        self.dropped, self.last, self._given, self.notice, self.resets = 0, None, None, "", []

    def _read(self, timeout_s: float) -> Reading:
        """Raises FrameTimeout where no picture was fed in the time, BadFrame where it shows no believable distance."""
        with self._changed:
            if not self._changed.wait_for(lambda: self._waiting is not None, timeout_s) or self._waiting is None:
                raise FrameTimeout(f"The {self.name} was given no picture in {timeout_s:.3g} s.")
            frame, self._waiting = self._waiting, None
        if self._reader is None:
            raise BadFrame(f"The {self.name} is not open.")
        if self.last is not None and frame.time_s <= self.last.time_s:
            self.rejected += 1
            raise BadFrame(f"The picture of {frame.time_s:.2f} s came after that of {self.last.time_s:.2f} s.")
        text = self._reader.read(frame.image)
        told = self._filter.add(frame.time_s, text)
        self.last = told
        quantum = self._filter.quantum
        if told.distance is None or quantum is None:
            self.rejected += 1
            what = "does not follow from the distances before" if told.status == "rejected" else "is no distance"
            raise BadFrame(f'The text "{text.text}" in the picture of {frame.time_s:.2f} s {what}.')
        self._tell_leap(told, quantum)
        return Reading(told.distance, frame.monotonic_ns, unit="m", quantum=quantum, media_s=frame.media_s)

    def _tell_leap(self, told: Filtered, quantum: float) -> None:
        before, self._given = self._given, told
        if before is None or before.distance is None or told.distance is None:
            return
        reach = self._filter.settings.reach(told.time_s - before.time_s, quantum)
        if told.segment > before.segment:
            reset = self._filter.resets()[-1]
        elif abs(told.distance - before.distance) > reach:  # the filter has thought better of what it said before
            reset = Reset(told.time_s, before.distance, told.distance)
        else:
            return
        self.resets.append(reset)
        self.notice = f"The counter leapt from {reset.before:.2f} m to {reset.after:.2f} m at {reset.time_s:.1f} s."

    def close(self) -> None:
        with self._changed:
            self._waiting = None


@dataclass(frozen=True)
class OsdSeries:
    """The distances of a whole recording: what became of every picture, the believed ones as readings, the counter's leaps."""

    told: tuple[Filtered, ...]
    readings: tuple[Reading, ...]
    resets: tuple[Reset, ...]


def read_series(frames: Iterable[VideoFrame], reader: OsdReader, settings: FilterSettings | None = None) -> OsdSeries:
    """Read a recording to its end and decide each distance from those before and after it: ``OsdEncoder`` only knows those
    before. ``frames`` in the order of their times."""
    sieve = OsdFilter(settings)
    taken: list[tuple[int, float | None]] = []
    for frame in frames:
        sieve.add(frame.time_s, reader.read(frame.image))
        taken.append((frame.monotonic_ns, frame.media_s))
    told = tuple(sieve.smoothed())
    quantum = sieve.quantum or 0.0
    readings = tuple(
        Reading(one.distance, monotonic_ns, unit="m", quantum=quantum, media_s=media_s)
        for one, (monotonic_ns, media_s) in zip(told, taken, strict=True)
        if one.distance is not None
    )
    return OsdSeries(told, readings, tuple(sieve.resets()))


def _is_text(line: str) -> bool:
    """Whether there is a letter or a digit as distances are written with: stains on a wall are read as Chinese at most."""
    return any(char.isascii() and char.isalnum() for char in line)


def require_distance(frames: Iterable[VideoFrame], reader: OsdReader, look_at: int = 12, share: float = 0.5) -> float:
    """The share of the first ``look_at`` pictures that show a distance. Raises NoDistance where that is less than ``share``,
    with a sentence that says where it looked, what it saw, and what to do."""
    looked = readable = with_text = 0
    examples: dict[str, None] = {}
    source = ""
    for frame in islice(frames, look_at):
        source = source or frame.source
        looked += 1
        searches = reader.searches
        seen = reader.read(frame.image, patient=False)
        lines = [line for line in (reader.lines if reader.searches > searches else (seen.text,)) if _is_text(line)]
        readable += seen.distance is not None
        with_text += bool(lines)
        if seen.distance is None:
            examples.update(dict.fromkeys(lines))
    if looked and readable >= share * looked:
        return readable / looked
    name = f"the video {source}" if source else "the video"
    if not looked:
        raise NoDistance(f"No distance can be read in {name}: it has no pictures.")
    if not with_text:
        saw = "none of them shows text"
    elif not readable:
        such = ", ".join(f'"{line}"' for line in list(examples)[:3])
        saw = f"{with_text} of them show text, such as {such}, but none that is written like a distance"
    else:
        saw = f"only {readable} of them show a distance"
    raise NoDistance(
        f"No distance can be read in {name}: looked {reader.where} in the first {looked} pictures, {saw}. {REMEDY}"
    )
