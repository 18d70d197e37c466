"""One MCAP file that a power cut cannot spoil: small chunks, each whole on the disk at a sync, definitions kept twice.

Nothing is held back in this process beyond the chunk under way; ``sync`` ends that chunk and returns once it is on the disk.
"""

from __future__ import annotations

import fcntl
import io
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import IO, cast

from mcap.writer import CompressionType, Writer

from device.durable import sync_folder
from device.json_text import dumps
from device.recorder.schemas import Message, Schema

CHUNK_BYTES = 256 * 1024
"""Of a chunk before it is compressed; a depth picture is more and has one of its own. What belongs to one sample is never in
two chunks."""
_NEVER = 1 << 62
HEAD = "recording.json"
DEFINITIONS = "definitions.mcap"
PROFILE = "borescout"


class LogFile:
    """A new file for writing that can be synced: what mcap's writer wants of a stream, without a buffer of its own.

    Locked as long as it is open, so that nobody prunes or recovers it meanwhile. Raises OSError wherever the disk does.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.size = 0
        self.synced = 0
        """Bytes that are on the disk for sure."""
        self._descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o640)
        fcntl.flock(self._descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        sync_folder(path.parent)

    def write(self, data: bytes) -> int:
        """All of it."""
        left = memoryview(data)
        while left:
            done = os.write(self._descriptor, left)
            self.size += done
            left = left[done:]
        return len(data)

    def tell(self) -> int:
        """Where the next byte goes."""
        return self.size

    def flush(self) -> None:
        """Nothing is held back."""

    def sync(self) -> None:
        """Return once everything written is on the disk."""
        if self.size > self.synced:
            os.fdatasync(self._descriptor)
            self.synced = self.size

    def cut_back(self) -> None:
        """Drop what was not synced: after a fault it may be half a chunk."""
        os.ftruncate(self._descriptor, self.synced)
        self.size = self.synced

    def close(self) -> None:
        """May be called twice."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1


class LogWriter:
    """Messages into one file. ``head`` is what a replay has to know, JSON-ready. Raises OSError wherever the disk does."""

    def __init__(self, path: Path, head: Mapping[str, object], stamp_ns: int) -> None:
        self.file = LogFile(path)
        self.calibrated: set[str] = set()
        self._stamp_ns = stamp_ns
        self._writer = new_writer(cast(IO[bytes], self.file))
        self._channels = Channels(self._writer)
        self._defined = self._pending = 0
        """Topics defined outside of the chunks; bytes of the chunk under way."""
        try:
            self._writer.start(PROFILE, library=PROFILE)
            self._writer.add_attachment(stamp_ns, stamp_ns, HEAD, "application/json", dumps(head).encode())
            self.file.sync()
        except OSError:
            self.give_up()
            raise

    def write(self, messages: Iterable[Message], log_ns: int, publish_ns: int, sequence: int) -> None:
        """The messages of one sample; they are durable after the next ``sync``."""
        for message in messages:
            channel = self._channels.number(message.topic, message.schema)
            self._writer.add_message(channel, log_ns, message.data, publish_ns, sequence & 0xFFFFFFFF)
            self._pending += len(message.data)
        if self._pending > CHUNK_BYTES:
            self._end_chunk()

    def sync(self) -> None:
        """End the chunk under way and return once it is on the disk."""
        if self._pending:
            self._end_chunk()
        self.file.sync()

    def _end_chunk(self) -> None:
        self._define()
        self._writer.flush()
        self._pending = 0

    def finish(self) -> None:
        """Write the index and close: the file is whole. After a fault it is closed as ``give_up`` does."""
        try:
            self.sync()
            self._writer.finish()
            self.file.sync()
        except OSError:
            self.give_up()
            raise
        self.file.close()

    def give_up(self) -> None:
        """After a fault: keep what is safely there, without an index; ``recovery`` makes one."""
        try:
            self.file.cut_back()
        except OSError:
            pass  # half a chunk stays behind the last whole one; recovery drops it
        finally:
            self.file.close()

    def _define(self) -> None:
        """A second copy of the definitions outside of the chunks: the chunk that they stand in may be damaged."""
        known = self._channels.known
        if len(known) > self._defined:
            self._defined = len(known)
            data = definitions_of(known)
            self._writer.add_attachment(self._stamp_ns, self._stamp_ns, DEFINITIONS, "application/octet-stream", data)


def new_writer(stream: IO[bytes]) -> Writer:
    """A writer that ends a chunk when it is told to, by ``flush``, and else not."""
    return Writer(stream, _NEVER, CompressionType.ZSTD, enable_data_crcs=True)


class Channels:
    """The channels of one file, defined when they are first used, in that order."""

    def __init__(self, writer: Writer) -> None:
        self.known: dict[str, Schema] = {}
        """By topic."""
        self._writer = writer
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}

    def number(self, topic: str, schema: Schema) -> int:
        """The channel of ``topic``."""
        if topic not in self._channels:
            if schema.name not in self._schemas:
                number = self._writer.register_schema(schema.name, schema.encoding, schema.definition)
                self._schemas[schema.name] = number
            self._channels[topic] = self._writer.register_channel(topic, schema.message_encoding, self._schemas[schema.name])
            self.known[topic] = schema
        return self._channels[topic]


def definitions_of(known: Mapping[str, Schema]) -> bytes:
    """Schemas and channels under their numbers, as a small file of their own."""
    buffer = io.BytesIO()
    writer = Writer(buffer, use_chunking=False)
    writer.start(PROFILE, library=PROFILE)
    channels = Channels(writer)
    for topic, schema in known.items():
        channels.number(topic, schema)
    writer.finish()
    return buffer.getvalue()
