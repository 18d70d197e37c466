"""One recording under way: a thread of its own behind a bounded queue, so that no survey ever waits for the disk.

What is written is on the disk within ``SYNC_S`` and the time that the disk takes. A full queue, a full disk or a broken card
costs samples, which are counted, or the recording, which says so; never the survey.
"""

from __future__ import annotations

import errno
import logging
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

from device.durable import make_folder
from device.recorder.names import Name
from device.recorder.policy import LOW_DISK, MB
from device.recorder.reader import HEAD_TOPIC
from device.recorder.samples import Picture, Sample, size_of
from device.recorder.schemas import messages
from device.recorder.writer import LogWriter
from drivers.depth.base import DepthFrame
from drivers.navigation.scans import Scan

log = logging.getLogger(__name__)

SYNC_S = 0.3
"""So often what has come is forced onto the disk: even if the disk takes its time, within the second that is promised."""
MOST_WAITING = 64 * MB
"""Pictures waiting for the disk, in bytes of memory; a card that halts for a second or two costs none."""
MOST_NOTES = 20_000
"""Readings and notes waiting: they are small, and a replay needs them all."""
PART_BYTES = 128 * MB
"""A long recording is many files: what is pruned is a part of it, and a damaged one is recovered in seconds."""

State = Literal["recording", "off", "stopped", "finished"]
FULL = "Recording has ended: the disk is full. The survey goes on."
BROKEN = "Recording has ended: the disk does not take it ({}). The survey goes on."


@dataclass(frozen=True)
class RecorderStatus:
    """``message`` says why nothing is recorded, where that is so. ``behind_s`` is how long the oldest sample has waited to be
    on the disk, ``worst_s`` the longest that any has."""

    state: State
    message: str
    files: tuple[str, ...]
    bytes: int
    written: int
    dropped: int
    behind_s: float
    worst_s: float

    def to_json(self) -> dict[str, Any]:
        """For the page."""
        return {**asdict(self), "files": list(self.files)}


@dataclass(frozen=True)
class _Waiting:
    topic: str
    sample: Sample
    sequence: int
    arrived_ns: int
    size: int


class Recorder:
    """Records one survey from ``open`` to ``close``; ``write`` may be called from any thread and returns at once.

    ``head`` is what a replay has to know before the first sample, JSON-ready. ``offset_ns`` turns the monotonic clock into the
    time that is shown (0 while the date is unknown). ``may_go_on`` is asked after each sync, with the file being written: it
    prunes, and False ends the recording. ``on_change`` is called, from any thread, when the state changes, ``on_end`` once
    nothing more will be written.
    """

    def __init__(
        self,
        folder: Path,
        name: Name,
        head: Mapping[str, object],
        *,
        offset_ns: int = 0,
        part_bytes: int = PART_BYTES,
        may_go_on: Callable[[], bool] = lambda: True,
        on_change: Callable[[], None] = lambda: None,
        on_end: Callable[[Recorder], None] = lambda recorder: None,
    ) -> None:
        self.folder = folder
        self.name = name
        self.head = {**head, "offset_ns": offset_ns}
        self._offset_ns = offset_ns
        self._part_bytes = part_bytes
        self._may_go_on = may_go_on
        self._on_change = on_change
        self._on_end = on_end
        self._condition = threading.Condition()
        self._queue: deque[_Waiting] = deque()
        self._waiting_bytes = 0
        self._sequences: Counter[str] = Counter()
        self._dropped = self._written = self._bytes = 0
        self._worst_ns = 0
        self._oldest_unsynced_ns: int | None = None
        self._files: list[str] = []
        self._state: State = "off"
        self._message = ""
        self._closing = self._discard = self._lost = False
        self._log: LogWriter | None = None
        self._thread = threading.Thread(target=self._run, name=f"recorder of survey {name.survey}", daemon=True)

    def open(self) -> Recorder:
        """Begin. A disk that does not take it leaves the recorder off, with its reason."""
        try:
            if self._may_go_on():
                self._begin_part(self.name)
                self._state = "recording"
                self.write(HEAD_TOPIC, dict(self.head))
                self._thread.start()
            else:
                self._lost, self._message = True, LOW_DISK
        except OSError as error:
            self._lost, self._message = True, _sentence(error)
            log.error("survey %d is not recorded: %s", self.name.survey, error)
        self._on_change()
        if not self.recording:
            self._on_end(self)
        return self

    def turned_off(self, reason: str) -> Recorder:
        """In place of ``open``: nothing is recorded, for this reason."""
        self._message = reason
        self._on_end(self)
        return self

    @property
    def recording(self) -> bool:
        """Whether what is written still goes anywhere."""
        return self._state == "recording"

    @property
    def lost(self) -> bool:
        """Whether somebody should be told that nothing is recorded: it was not turned off on purpose."""
        return self._lost

    def write(self, topic: str, sample: Sample) -> bool:
        """Hand over a sample; False where it is not recorded: the queue is full, or nothing is recorded any more."""
        now = time.monotonic_ns()
        size = size_of(sample)
        large = isinstance(sample, DepthFrame | Picture | Scan)
        with self._condition:
            sequence = self._sequences[topic]
            self._sequences[topic] += 1
            if self._state != "recording" or self._closing:
                return False
            if (large and self._waiting_bytes + size > MOST_WAITING) or len(self._queue) >= MOST_NOTES:
                self._dropped += 1
                return False
            self._queue.append(_Waiting(topic, sample, sequence, now, size))
            self._waiting_bytes += size
            self._condition.notify()
        return True

    def close(self, discard: bool = False, wait_s: float = 10.0) -> None:
        """Write what waits, make the file whole. ``discard``: nobody wants it. May be called twice."""
        with self._condition:
            self._closing = True
            self._discard = self._discard or discard
            self._condition.notify()
        if self._thread.is_alive() and self._thread is not threading.current_thread():
            self._thread.join(wait_s)
        if self._discard and not self._thread.is_alive():
            self._remove_files()

    def status(self) -> RecorderStatus:
        """The state of this moment."""
        with self._condition:
            oldest = [waiting.arrived_ns for waiting in list(self._queue)[:1]]
            if self._oldest_unsynced_ns is not None:
                oldest.append(self._oldest_unsynced_ns)
            behind_ns = time.monotonic_ns() - min(oldest) if oldest else 0
            current = 0 if self._log is None else self._log.file.size
            return RecorderStatus(
                self._state,
                self._message,
                tuple(self._files),
                self._bytes + current,
                self._written,
                self._dropped,
                round(behind_ns / 1e9, 3),
                round(max(self._worst_ns, behind_ns) / 1e9, 3),
            )

    # The recorder's own thread

    def _run(self) -> None:
        try:
            self._work()
            self._finish("finished", "")
        except OSError as error:
            log.error("survey %d is no longer recorded: %s", self.name.survey, error)
            self._give_up(_sentence(error))
        except Exception:  # a bug of the recorder costs the recording
            log.exception("survey %d is no longer recorded", self.name.survey)
            self._give_up(BROKEN.format("an error in the program"))
        self._on_change()
        if self._discard:
            self._remove_files()
        else:
            self._on_end(self)

    def _work(self) -> None:
        due = time.monotonic() + SYNC_S
        while True:
            waiting = self._next(max(0.0, due - time.monotonic()))
            if waiting is not None:
                self._put(waiting)
            elif self._closing:
                return
            if time.monotonic() >= due:
                self._sync()
                due = time.monotonic() + SYNC_S
                if not self._may_go_on():
                    self._finish("stopped", LOW_DISK)
                    return

    def _next(self, wait_s: float) -> _Waiting | None:
        with self._condition:
            if not self._queue and not self._closing:
                self._condition.wait(wait_s)
            if not self._queue or self._discard:
                return None
            waiting = self._queue.popleft()
            self._waiting_bytes -= waiting.size
            if self._oldest_unsynced_ns is None:
                self._oldest_unsynced_ns = waiting.arrived_ns
            return waiting

    def _put(self, waiting: _Waiting) -> None:
        assert self._log is not None  # it is open as long as this thread works
        moment = getattr(waiting.sample, "monotonic_ns", waiting.arrived_ns)
        stamp, logged = moment + self._offset_ns, waiting.arrived_ns + self._offset_ns
        parts = messages(waiting.topic, waiting.sample, stamp, self._log.calibrated)
        self._log.write(parts, logged, stamp, waiting.sequence)
        self._written += 1

    def _sync(self) -> None:
        assert self._log is not None  # it is open as long as this thread works
        self._log.sync()
        oldest = self._oldest_unsynced_ns
        if oldest is not None:
            self._worst_ns = max(self._worst_ns, time.monotonic_ns() - oldest)
            self._oldest_unsynced_ns = None
        if self._log.file.size > self._part_bytes:
            full, self._log = self._log, None
            full.finish()
            self._bytes += full.file.size
            self._begin_part(Name(self.name.survey, self.name.take, self.name.part + len(self._files)))

    def _begin_part(self, name: Name) -> None:
        make_folder(self.folder)
        self._log = LogWriter(self.folder / str(name), self.head, time.monotonic_ns() + self._offset_ns)
        self._files.append(str(name))

    def _finish(self, state: State, message: str) -> None:
        current, self._log = self._log, None
        if current is not None:
            current.finish()
            self._bytes += current.file.size
            self._become(state, message)

    def _remove_files(self) -> None:
        for file in self._files:
            (self.folder / file).unlink(missing_ok=True)

    def _give_up(self, message: str) -> None:
        current, self._log = self._log, None
        if current is not None:
            current.give_up()
            self._bytes += current.file.size
        self._become("stopped", message)

    def _become(self, state: State, message: str) -> None:
        with self._condition:
            self._state, self._message = state, message
            self._lost = state == "stopped"
            self._dropped += len(self._queue)
            self._queue.clear()
            self._waiting_bytes = 0
            self._oldest_unsynced_ns = None


def _sentence(error: OSError) -> str:
    full = error.errno in (errno.ENOSPC, errno.EDQUOT)
    return FULL if full else BROKEN.format(error.strerror or type(error).__name__)
