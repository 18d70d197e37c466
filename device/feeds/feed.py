"""One source kept alive: samples as they come, the age of the last good one, and a watchdog over the thread that reads.

A driver call stuck in native code cannot be interrupted: its thread is left behind and another one starts with a new source
object, a few times at most. Everything short of that is the reader's own ladder (``reader.py``).
"""

from __future__ import annotations

import logging
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any, Generic

from device.feeds.reader import FeedState, FeedTiming, Reader
from device.feeds.samples import DEPTH, STEREO, TETHER, VIDEO, S, Sampling, Source
from device.feeds.tap import Relay, Tap
from drivers.depth.base import DepthFrame
from drivers.encoder.base import Reading
from drivers.grabber.base import VideoFrame
from drivers.stereo.base import StereoFrame

log = logging.getLogger(__name__)

_FPS_WINDOW_S = 2.0
_RESTING_SENTENCE = "Nobody is looking; it wakes when it is needed."
_LENT_SENTENCE = "It is being calibrated."


@dataclass(frozen=True)
class FeedStatus:
    """What is known of a source. ``age_s`` is the age of the last good sample (frame), None before the first one."""

    state: FeedState
    age_s: float | None
    fps: float
    frames: int
    drops: int
    reconnects: int
    bad_frames: int
    message: str


class Feed(Generic[S]):
    """Reads one source in a thread of its own and hands the samples on.

    ``make`` builds the source; it is called again after a stuck call, since the old object can no longer be trusted.
    ``recorded`` says that the samples come from a recording, where repeated or empty pictures are how it was.
    ``on_demand``: the source is costly and only open while there is a tap, or for a while after ``wake``.
    ``on_change`` is called, from any thread, when the state or its sentence changes.
    """

    def __init__(
        self,
        name: str,
        kind: str,
        make: Callable[[], Source[S]],
        sampling: Sampling[S],
        *,
        recorded: bool = False,
        on_demand: bool = False,
        timing: FeedTiming | None = None,
        on_change: Callable[[], None] = lambda: None,
    ) -> None:
        self.name = name
        self.kind = kind
        self.recorded = recorded
        self.on_turn: Callable[[], None] = lambda: None
        """Called with each turn of the watchdog: as long as it turns, somebody looks after the source."""
        self._make = make
        self._sampling = sampling
        self._on_demand = on_demand
        self._awake_until = 0.0
        self._woken = threading.Event()
        self._rested = False
        self._lent = False
        self._timing = timing or FeedTiming()
        self._on_change = on_change
        self._lock = threading.Lock()
        self._stop = threading.Event()
        self._taps: list[Tap[S]] = []
        self._latest: S | None = None
        self._blind = False
        self._arrivals: deque[float] = deque(maxlen=100)
        self._state: FeedState = "starting"
        self._message = sampling.words.starting
        self._frames = self._drops = self._bad = self._openings = 0
        self._abandoned: list[Reader[S]] = []
        self._reader: Reader[S] | None = None
        self._watchdog = threading.Thread(target=self._watch, name=f"watchdog of {name}", daemon=True)

    def start(self) -> None:
        """Begin to read. Returns at once, whether there is a source or not."""
        self._begin_reader()
        self._watchdog.start()

    def close(self, wait_s: float = 3.0) -> None:
        """Stop reading; a reader stuck in native code is left behind after ``wait_s`` seconds. May be called twice."""
        self._stop.set()
        self._woken.set()
        for tap in list(self._taps):
            tap.close()
        reader = self._reader
        if reader is None:
            return
        self._watchdog.join(wait_s)
        reader.thread.join(wait_s)
        if reader.thread.is_alive():
            log.warning("%s: still inside a driver call (%s) while stopping, left behind", self.name, reader.call)

    @property
    def latest(self) -> S | None:
        """The newest good sample."""
        return self._latest

    @property
    def blind(self) -> bool:
        """Whether the source works and sees nothing: its last sample was empty."""
        return self._blind

    def tap(self, size: int) -> Tap[S]:
        """Every good sample from now on, through a queue of ``size`` in which the newest win. Close it after use."""
        return self.attach(Tap(size, self.detach))

    def follow(self, take: Callable[[S], object]) -> Tap[S]:
        """Every good sample from now on, handed to ``take`` in the reader's thread. Close it after use."""
        return self.attach(Relay(take, self.detach))

    def attach(self, tap: Tap[S]) -> Tap[S]:
        """Another kind of tap, made with ``detach`` as its ``on_close``."""
        with self._lock:
            self._taps.append(tap)
        self._woken.set()
        return tap

    def wake(self, seconds: float) -> None:
        """Be awake for so long, where the source is only read on demand."""
        self._awake_until = max(self._awake_until, time.monotonic() + seconds)
        self._woken.set()

    @property
    def tapped(self) -> bool:
        """Whether somebody takes its samples just now."""
        return bool(self._taps)

    def lend(self, lent: bool) -> None:
        """While it is lent somebody else may open the source: it is closed here, whoever wants samples."""
        self._lent = lent
        self._woken.set()

    def at_rest(self, within_s: float) -> bool:
        """Whether the source is closed, as it is while nobody needs it, at the latest after so many seconds."""
        deadline = time.monotonic() + within_s
        while self._state != "resting" and time.monotonic() < deadline:
            time.sleep(0.02)
        return self._state == "resting"

    def status(self) -> FeedStatus:
        """The state of this moment."""
        now = time.monotonic()
        with self._lock:
            latest, state, message = self._latest, self._state, self._message
            drops = self._drops + sum(tap.dropped for tap in self._taps)
            recent = [moment for moment in self._arrivals if now - moment < _FPS_WINDOW_S]
        age_s = None if latest is None else max(0.0, now - latest.monotonic_ns / 1e9)
        if state == "up" and age_s is not None and age_s > self._timing.stale_s:
            state, message = "degraded", self._sampling.words.stale.format(age_s)
        return FeedStatus(
            state=state,
            age_s=age_s,
            fps=(len(recent) - 1) / (recent[-1] - recent[0]) if len(recent) > 1 and recent[-1] > recent[0] else 0.0,
            frames=self._frames,
            drops=drops,
            reconnects=max(0, self._openings - 1),
            bad_frames=self._bad,
            message=message,
        )

    def to_json(self) -> dict[str, Any]:
        """Its name, its kind and its state of this moment, as the page reads them."""
        status = self.status()
        age_s = None if status.age_s is None else round(status.age_s, 2)
        return {"name": self.name, "kind": self.kind, **asdict(status), "age_s": age_s, "fps": round(status.fps, 1)}

    # What the reader reports (reader.Sink). One that was left behind may still come back from its call: nobody listens.

    def wanted(self, reader: Reader[S]) -> bool:
        """Whether this reader is still the one in charge."""
        return reader is self._reader and not self._stop.is_set()

    def needed(self) -> bool:
        """Whether anybody wants the source to be read just now."""
        return not self._lent and (not self._on_demand or bool(self._taps) or time.monotonic() < self._awake_until)

    def rest(self, reader: Reader[S]) -> None:
        """Wait until somebody needs the source, or it is no longer wanted."""
        self.become(reader, "resting", _LENT_SENTENCE if self._lent else _RESTING_SENTENCE)
        self._rested = self._openings > 0
        while self.wanted(reader) and not self.needed():
            self._woken.wait(1.0)
            self._woken.clear()
        self.become(reader, "starting", self._sampling.words.starting)

    def opened(self, reader: Reader[S]) -> None:
        """The source was opened."""
        with self._lock:
            if self.wanted(reader) and not self._rested:
                self._openings += 1
            self._rested = False

    def good_sample(self, reader: Reader[S], sample: S, lost_before: int) -> None:
        """A good sample came, after ``lost_before`` that the sensor counted and nobody saw."""
        with self._lock:
            if not self.wanted(reader):
                return
            self._latest = sample
            self._blind = False
            self._frames += 1
            self._drops += lost_before
            self._arrivals.append(time.monotonic())
            taps = list(self._taps)
        for tap in taps:
            tap.offer(sample)
        self.become(reader, "up", "")

    def bad_sample(self, reader: Reader[S], empty: bool = False) -> None:
        """A sample came that is none; ``empty``: it is one, but there is nothing in it."""
        with self._lock:
            if self.wanted(reader):
                self._bad += 1
                self._blind = empty

    def become(self, reader: Reader[S], state: FeedState, message: str) -> None:
        """The source is in another state, or for another reason."""
        with self._lock:
            if not self.wanted(reader) or (state, message) == (self._state, self._message):
                return
            self._state, self._message = state, message
        level = logging.INFO if state in ("up", "resting", "starting") else logging.WARNING
        log.log(level, "%s %s is %s%s", self._sampling.words.noun, self.name, state, f": {message}" if message else "")
        self._on_change()

    def detach(self, tap: Tap[S]) -> None:
        """A tap that was closed."""
        with self._lock:
            if tap in self._taps:
                self._taps.remove(tap)
                self._drops += tap.dropped

    def _begin_reader(self) -> None:
        self._reader = Reader(self.name, self._make, self._sampling, self.recorded, self._timing, self, self._stop)
        self._reader.thread.start()

    def _watch(self) -> None:
        while not self._stop.wait(min(0.2, self._timing.read_limit_s / 4)):
            self.on_turn()
            self._abandoned = [reader for reader in self._abandoned if reader.thread.is_alive()]
            reader = self._reader
            if reader is None:
                continue
            if reader.thread.is_alive():
                if not reader.stuck():
                    continue
                self.become(reader, "lost", self._sampling.words.stuck)
                if len(self._abandoned) >= self._timing.abandoned_limit:
                    continue
                log.error("%s: its driver does not return from %s, starting anew", self.name, reader.call)
                self._abandoned.append(reader)
            self._begin_reader()


class CameraFeed(Feed[DepthFrame]):
    """A depth camera kept alive."""

    def __init__(
        self,
        name: str,
        kind: str,
        make: Callable[[], Source[DepthFrame]],
        *,
        recorded: bool = False,
        timing: FeedTiming | None = None,
        on_change: Callable[[], None] = lambda: None,
    ) -> None:
        super().__init__(name, kind, make, DEPTH, recorded=recorded, timing=timing, on_change=on_change)


class GrabberFeed(Feed[VideoFrame]):
    """A CCTV grabber kept alive."""

    def __init__(
        self,
        name: str,
        kind: str,
        make: Callable[[], Source[VideoFrame]],
        *,
        recorded: bool = False,
        on_demand: bool = False,
        timing: FeedTiming | None = None,
        on_change: Callable[[], None] = lambda: None,
    ) -> None:
        super().__init__(name, kind, make, VIDEO, recorded=recorded, on_demand=on_demand, timing=timing, on_change=on_change)


class StereoFeed(Feed[StereoFrame]):
    """A stereo camera kept alive, and only read while somebody looks or scans."""

    def __init__(
        self,
        name: str,
        kind: str,
        make: Callable[[], Source[StereoFrame]],
        *,
        recorded: bool = False,
        timing: FeedTiming | None = None,
        on_change: Callable[[], None] = lambda: None,
    ) -> None:
        super().__init__(name, kind, make, STEREO, recorded=recorded, on_demand=True, timing=timing, on_change=on_change)


class EncoderFeed(Feed[Reading]):
    """A tether encoder kept alive. An unchanged value is no fault: the crawler stands."""

    def __init__(
        self,
        name: str,
        kind: str,
        make: Callable[[], Source[Reading]],
        *,
        recorded: bool = False,
        on_demand: bool = False,
        timing: FeedTiming | None = None,
        on_change: Callable[[], None] = lambda: None,
    ) -> None:
        super().__init__(name, kind, make, TETHER, recorded=recorded, on_demand=on_demand, timing=timing, on_change=on_change)
