"""The thread that reads one source, with its ladder: reopen, reset, tell the operator, go on trying ever more slowly.

One ladder serves depth cameras, grabbers and encoders; what differs between them is in ``samples.py``.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, Literal, Protocol, TypeVar

from device.feeds.samples import S, Sampling, Source
from drivers.base import BadFrame, DriverError, EndOfRecording, FrameTimeout, RecordingBroken, SensorMissing

log = logging.getLogger(__name__)

T = TypeVar("T")
FeedState = Literal["starting", "up", "degraded", "lost", "resting"]

_BROKEN_PICTURE_S = 0.05


@dataclass(frozen=True)
class FeedTiming:
    """How patient a feed is, in seconds and counts."""

    read_s: float = 1.0
    """What the driver is given for one sample."""
    stale_s: float = 1.0
    """A good sample older than this makes the source "degraded"."""
    read_limit_s: float = 6.0
    """A read that takes longer is stuck."""
    open_limit_s: float = 40.0
    """Any other driver call (make, open, reset, close) that takes longer is stuck; the drivers bound theirs at 20 s."""
    faults_before_reopen: int = 3
    good_before_trust: int = 5
    """Good samples after which a reopened source starts at the foot of the ladder again."""
    openings_before_reset: int = 2
    back_off_s: tuple[float, ...] = (0.2, 0.5, 1.0, 2.0, 5.0, 10.0)
    repeats_before_frozen: int = 15
    empty_before_reopen: int = 60
    """Empty pictures are often the operator's hand on the window: be slower than with a silent camera."""
    abandoned_limit: int = 3
    """Threads left behind in stuck calls; beyond these no new one is started until one of them returns."""


class Frozen(BadFrame):
    """The source sends the same sample again and again."""


class Empty(BadFrame):
    """The source sends samples with nothing in them."""


class Garbled(BadFrame):
    """The source sends what it cannot have seen."""


class Sink(Protocol[S]):
    """Whom a reader reports to. Reports of a reader that is no longer wanted are ignored by it."""

    def wanted(self, reader: Reader[S]) -> bool: ...
    def needed(self) -> bool: ...
    def rest(self, reader: Reader[S]) -> None: ...
    def opened(self, reader: Reader[S]) -> None: ...
    def good_sample(self, reader: Reader[S], sample: S, lost_before: int) -> None: ...
    def bad_sample(self, reader: Reader[S], empty: bool = False) -> None: ...
    def become(self, reader: Reader[S], state: FeedState, message: str) -> None: ...


class Reader(Generic[S]):
    """One thread with one source object, made by ``make`` inside it.

    Once it is no longer wanted it closes its source and ends; while nobody needs it the source stays closed. While a driver
    call holds it, ``stuck`` says so after the limit.
    ``recorded``: repeated or empty pictures are how the recording is, and nothing to recover from.
    """

    def __init__(
        self,
        name: str,
        make: Callable[[], Source[S]],
        sampling: Sampling[S],
        recorded: bool,
        timing: FeedTiming,
        sink: Sink[S],
        stop: threading.Event,
    ) -> None:
        self.name = name
        self.call = ""
        """The driver call under way."""
        self._make = make
        self._sampling = sampling
        self._recorded = recorded
        self._timing = timing
        self._sink = sink
        self._stop = stop
        self._source: Source[S] | None = None
        self._call_since: float | None = None
        self._call_limit = 0.0
        self._number: int | None = None
        self._samples_to_prove = 0
        self._fingerprint: int | None = None
        self._repeats = self._empties = self._garbled = 0
        self._missing = False
        self.thread = threading.Thread(target=self._run, name=f"reader of {name}", daemon=True)

    def stuck(self) -> bool:
        """Whether a driver call has been under way for longer than it may."""
        since = self._call_since
        return since is not None and time.monotonic() - since > self._call_limit

    def _run(self) -> None:
        openings = 0  # in a row, without enough good samples
        while self._sink.wanted(self):
            if not self._sink.needed():
                self._sink.rest(self)
                continue
            tired = False
            try:
                self._climb(openings)
                self._open()
                good = 0
                while self._sink.wanted(self) and self._sink.needed():
                    good += self._read_until_fault()
                    if good >= self._timing.good_before_trust:
                        openings = 0
                tired = True  # nobody needs it just now, or ever again
            except EndOfRecording as end:
                # a recording in place of a camera is played again and again
                self._sink.become(self, "degraded", _sentence(end))
            except Empty as fault:
                self._sink.become(self, "degraded", str(fault))
            except DriverError as fault:
                self._missing = isinstance(fault, SensorMissing)
                beyond_help = self._missing or openings >= self._timing.openings_before_reset
                self._sink.become(self, "lost" if beyond_help else "degraded", _sentence(fault) or self._sampling.words.silent)
            except Exception:  # a driver's own bug or its native code: it costs a reopening, never the daemon
                if openings == 0:  # the trace once; how often it happens again is in the count of reconnects
                    log.exception("%s: its driver failed in an unexpected way", self.name)
                self._sink.become(self, "lost", self._sampling.words.silent)
            self._close()
            if tired:
                continue
            if self._sink.wanted(self):
                self._stop.wait(self._timing.back_off_s[min(openings, len(self._timing.back_off_s) - 1)])
            openings += 1

    def _climb(self, openings: int) -> None:
        """The second rung: every other opening beyond the first few begins with a reset of the hardware."""
        beyond = openings - self._timing.openings_before_reset
        if self._source is not None and not self._missing and beyond >= 0 and beyond % 2 == 0:
            log.log(logging.DEBUG if beyond else logging.WARNING, "%s: resetting the hardware", self.name)
            self._timed("reset", self._timing.open_limit_s, self._source.reset)

    def _open(self) -> None:
        if self._source is None:
            self._source = self._timed("make", self._timing.open_limit_s, self._make)
        self._timed("open", self._timing.open_limit_s, self._source.open)
        self._garbled = 0
        self._number = None  # but not the fingerprint: a source that shows the old picture after reopening is still frozen
        self._repeats = self._empties = 0
        self._sink.opened(self)
        if self._source.notice:
            log.warning("%s: %s", self.name, self._source.notice)

    def _close(self) -> None:
        if self._source is None:
            return
        try:
            self._timed("close", self._timing.open_limit_s, self._source.close)
        except Exception:  # close() promises not to raise; a driver that breaks the promise must not end this thread
            log.exception("%s: its driver failed while closing", self.name)

    def _read_until_fault(self) -> bool:
        """Read until a good sample has come (True), or raise when faults have added up to a reason to reopen."""
        assert self._source is not None  # opened just before
        source = self._source
        for faults_left in reversed(range(self._timing.faults_before_reopen)):
            if not self._sink.wanted(self):
                return False
            try:
                sample = self._timed("read", self._timing.read_limit_s, lambda: source.read(self._timing.read_s))
            except RecordingBroken as fault:
                # one picture of a recording: the next read goes on behind it, while reopening would begin all over again
                self._sink.bad_sample(self)
                self._sink.become(self, "degraded", _sentence(fault))
                self._stop.wait(_BROKEN_PICTURE_S)
                return False
            except (FrameTimeout, BadFrame) as fault:
                if isinstance(fault, BadFrame):
                    self._sink.bad_sample(self)
                self._sink.become(self, "degraded", _sentence(fault) or self._sampling.words.silent)
                if faults_left == 0:
                    raise
                continue
            return self._judge(sample)
        return False

    def _judge(self, sample: S) -> bool:
        """Hand a good sample on. Raises Frozen or Empty after too many that are none."""
        rules = self._sampling
        number = rules.number(sample)
        lost_before = 0 if self._number is None or number is None else max(0, number - self._number - 1)
        if not self._recorded:
            fingerprint = None if rules.fingerprint is None else rules.fingerprint(sample)
            empty = rules.empty(sample)
            same = fingerprint is not None and (
                fingerprint == self._fingerprint or (number is not None and number == self._number)
            )
            repeated = same and not empty
            self._fingerprint = fingerprint
            self._number = number
            self._empties = self._empties + 1 if empty else 0
            self._repeats = self._repeats + 1 if repeated else 0
            if not empty and rules.garbled(sample):
                self._garbled += 1
                self._sink.bad_sample(self)
                if self._garbled >= self._timing.repeats_before_frozen:
                    raise Garbled(rules.words.garbled)
                return False
            self._garbled = 0
            if empty or repeated:
                self._sink.bad_sample(self, empty)
                if self._repeats >= self._timing.repeats_before_frozen:
                    self._samples_to_prove = 2
                    raise Frozen(rules.words.frozen)
                if self._empties >= self._timing.empty_before_reopen:
                    raise Empty(rules.words.empty)
                return False
            self._samples_to_prove = max(0, self._samples_to_prove - 1)
            if self._samples_to_prove:
                return False  # one new picture after a freeze may be the next frozen one: a second proves that it moves
        self._number = number
        self._sink.good_sample(self, sample, lost_before)
        return True

    def _timed(self, what: str, limit_s: float, call: Callable[[], T]) -> T:
        self.call, self._call_limit, self._call_since = what, limit_s, time.monotonic()
        try:
            return call()
        finally:
            self._call_since = None


def _sentence(fault: DriverError) -> str:
    """What the driver says, as a sentence for the operator."""
    text = str(fault).strip()
    return text if not text or text.endswith((".", "!", "?")) else f"{text}."
