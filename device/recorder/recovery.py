"""Is a recording whole, and if not: a whole one of what can be read. The old file goes once the new one has been checked."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mcap.exceptions import McapError
from mcap.reader import make_reader
from mcap.writer import Writer

from device.durable import sync_folder
from device.recorder.reader import Definitions, definitions
from device.recorder.scan import Attachment, Damage, End, Message, Metadata, Whole, scan
from device.recorder.schemas import Schema
from device.recorder.writer import DEFINITIONS, PROFILE, Channels, definitions_of, new_writer

RECOVERED = "borescout.recovered"
_TEMPORARY = ".recovering"
_NOTHING = 64 * 1024
"""A file no longer than this in which nothing can be read has lost nothing: the cut came before the first sync."""


@dataclass(frozen=True)
class Report:
    """What is known of one file.

    ``ok``: whole as it stands, every checksum agrees. ``recovered``: it was not, or is not, and a whole one was made of what
    can be read (``check`` tries it beside the file). ``lost_seconds`` are those from the last readable sample before a damaged
    or torn chunk to the last one in it, or to the next readable one where its header is damaged too. ``state`` is whole,
    recovered, torn, damaged, unreadable or writing.
    """

    file: str
    ok: bool
    recovered: bool
    lost_seconds: float
    state: str
    messages: int
    damaged: int
    seconds: float
    bytes: int

    def to_json(self) -> dict[str, Any]:
        """For ``recordings check --json``."""
        return dict(vars(self))


class CannotRecover(Exception):
    """``str()`` is the sentence: no room, or nothing in it that can be read."""


def check(path: Path, try_recovery: bool = True) -> Report:
    """Look at a file without changing it; of one that is not whole, ``try_recovery`` makes a whole one beside it, checks that
    and takes it away again. Raises OSError where it cannot be read at all."""
    if in_use(path):
        return _report(path, _Sum(), "writing", ok=False)
    found = _sum(path)
    if found.clean:
        state = "recovered" if found.recovered else "whole"
        return _report(path, found, state, ok=True)
    state = "torn" if found.damaged <= found.torn else "damaged"
    if not found.readable(path):
        return _report(path, found, "unreadable", ok=False)
    if try_recovery:
        try:
            beside, _ = _rebuilt(path, found)
        except (CannotRecover, OSError):
            return _report(path, found, state, ok=False)
        beside.unlink()
    return _report(path, found, state, ok=False, recovered=try_recovery)


def recover(path: Path) -> Report:
    """Make ``path`` whole, if it is not. Raises CannotRecover, OSError; the file is then as it was."""
    with _owned(path):
        found = _sum(path)
        if found.clean:
            return _report(path, found, "recovered" if found.recovered else "whole", ok=True)
        if not found.readable(path):
            raise CannotRecover(f"Nothing in {path.name} can be read; it is left as it is.")
        try:
            beside, rebuilt = _rebuilt(path, found)
        except OSError as error:
            if error.errno == errno.ENOSPC:
                raise CannotRecover(f"There is no room to recover {path.name}; it is left as it is.") from None
            raise
        os.replace(beside, path)
        sync_folder(path.parent)
    return _report(path, rebuilt, "recovered", ok=True, size=path.stat().st_size)


def in_use(path: Path) -> bool:
    """Whether somebody is writing the file just now."""
    try:
        with _owned(path):
            return False
    except CannotRecover:
        return True


def remove_leftovers(folder: Path) -> None:
    """Half-made files of a recovery that was cut off itself."""
    for left in folder.glob(f"*{_TEMPORARY}"):
        left.unlink(missing_ok=True)


@dataclass
class _Sum:
    """A file added up. ``last_ns`` is the time of its newest message so far."""

    messages: int = 0
    damaged: int = 0
    torn: int = 0
    """Of the damaged places those after which nothing readable comes."""
    lost_ns: int = 0
    first_ns: int | None = None
    last_ns: int | None = None
    spans: int = 0
    chunks: int = 0
    recovered: dict[str, str] | None = None
    attachments: int = 0
    clean: bool = False

    def readable(self, path: Path) -> bool:
        """Whether there is anything to recover, or nothing that could have been lost."""
        return self.chunks > 0 or self.attachments > 0 or path.stat().st_size <= _NOTHING


def _sum(path: Path) -> _Sum:
    found = _Sum()
    hole: list[Damage] = []
    for part in scan(path):
        if isinstance(part, Damage):
            found.damaged += 1
            hole.append(part)
        elif isinstance(part, Whole):
            _add_chunk(found, part, hole)
            hole.clear()
        elif isinstance(part, Attachment):
            found.attachments += 1
        elif isinstance(part, Metadata) and part.name == RECOVERED:
            found.recovered = part.metadata
        elif isinstance(part, End):
            found.clean = part.clean
    found.torn = len(hole)
    found.lost_ns += _torn_ns(found, hole)
    if found.recovered is not None:
        with contextlib.suppress(KeyError, ValueError):
            found.lost_ns += round(float(found.recovered["lost_seconds"]) * 1e9)
    return found


def _add_chunk(found: _Sum, chunk: Whole, hole: list[Damage]) -> None:
    times = [record.log_time for record in chunk.records if isinstance(record, Message)]
    if not times:
        return
    if found.first_ns is None:
        found.first_ns = min(times)
    if found.last_ns is not None:
        step = max(times) - found.last_ns
        found.spans += max(0, step)
        if hole:
            told = [part.end_ns for part in hole if part.end_ns is not None and found.last_ns <= part.end_ns <= min(times)]
            found.lost_ns += max(0, max(told, default=min(times)) - found.last_ns)
    found.chunks += 1
    found.messages += len(times)
    found.last_ns = max(times) if found.last_ns is None else max(found.last_ns, max(times))


def _torn_ns(found: _Sum, hole: list[Damage]) -> int:
    """What the torn chunk at the end held: its header tells, or it was as long as the others are."""
    if not hole or found.last_ns is None:
        return 0
    usual = found.spans // max(1, found.chunks - 1)
    told = hole[0].end_ns
    plausible = told is not None and 0 <= told - found.last_ns <= max(10 * usual, 1_000_000_000)
    return told - found.last_ns if plausible and told is not None else usual


def _rebuilt(path: Path, found: _Sum) -> tuple[Path, _Sum]:
    """A whole file beside ``path`` with everything that can be read, and what it adds up to. Raises CannotRecover, OSError."""
    beside = path.with_name(path.name + _TEMPORARY)
    try:
        with beside.open("wb") as stream:
            _copy(path, new_writer(stream), found)
            stream.flush()
            os.fsync(stream.fileno())
        made = _sum(beside)
        if not made.clean or made.messages != found.messages or not _opens(beside, found.messages):
            raise CannotRecover(f"What was recovered of {path.name} does not read back; it is left as it is.")
    except BaseException:
        beside.unlink(missing_ok=True)
        raise
    return beside, made


def _copy(path: Path, writer: Writer, found: _Sum) -> None:
    writer.start(PROFILE, library=PROFILE)
    told = {"lost_seconds": f"{found.lost_ns / 1e9:.6f}", "damaged": str(found.damaged), "messages": str(found.messages)}
    writer.add_metadata(RECOVERED, told)
    known = definitions(path)
    channels = Channels(writer)
    stamp_ns = found.first_ns or 0
    for part in scan(path):
        if isinstance(part, Attachment) and part.name != DEFINITIONS:
            writer.add_attachment(part.create_time, part.log_time, part.name, part.media_type, part.data)
        elif isinstance(part, Metadata) and part.name != RECOVERED:
            writer.add_metadata(part.name, part.metadata)
        elif isinstance(part, Whole):
            known.learn(part.records)
            for record in part.records:
                if isinstance(record, Message):
                    number = channels.number(*_channel(known, record.channel_id))
                    writer.add_message(number, record.log_time, record.data, record.publish_time, record.sequence)
            writer.flush()
    data = definitions_of(channels.known)
    writer.add_attachment(stamp_ns, stamp_ns, DEFINITIONS, "application/octet-stream", data)
    writer.finish()


def _channel(known: Definitions, number: int) -> tuple[str, Schema]:
    """The topic and the schema of a channel."""
    channel = known.channels.get(number)
    if channel is None:  # defined in a damaged chunk only: its bytes are kept under its number
        return f"/unknown/{number}", Schema("unknown", "", b"")
    schema = known.schemas.get(channel.schema_id)
    return channel.topic, Schema("none", "", b"") if schema is None else Schema(schema.name, schema.encoding, schema.data)


def _opens(path: Path, messages: int) -> bool:
    """Whether mcap's own reader finds as many messages by the file's index."""
    try:
        with path.open("rb") as stream:
            return sum(1 for _ in make_reader(stream, validate_crcs=True).iter_messages()) == messages
    except (McapError, ValueError):
        return False


def _report(path: Path, found: _Sum, state: str, *, ok: bool, recovered: bool = False, size: int | None = None) -> Report:
    span = 0 if found.first_ns is None or found.last_ns is None else found.last_ns - found.first_ns
    return Report(
        file=path.name,
        ok=ok,
        recovered=recovered or found.recovered is not None,
        lost_seconds=round(found.lost_ns / 1e9, 3),
        state=state,
        messages=found.messages,
        damaged=found.damaged,
        seconds=round(span / 1e9, 3),
        bytes=path.stat().st_size if size is None else size,
    )


@contextmanager
def _owned(path: Path) -> Iterator[None]:
    """Nobody else writes or recovers the file meanwhile. Raises CannotRecover where somebody does."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise CannotRecover(f"The recording {path.name} is in use.") from None
        yield
    finally:
        os.close(descriptor)
