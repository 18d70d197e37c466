"""What can still be read of a recording, in the order in which it was written, whatever was cut off or flipped.

mcap's own readers stop at the first byte that is wrong. Here a damaged chunk costs itself: the next one is found by its header
and believed when its checksum agrees.
"""

from __future__ import annotations

import io
import mmap
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, DataEnd, Footer, Header, McapRecord, Message, Metadata, Schema
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import MCAP0_MAGIC
from zstandard import ZstdError

_HEAD = struct.Struct("<BQ")
_CHUNK = struct.Struct("<QQQII")
"""Start and end of its messages (ns), bytes uncompressed, checksum, length of the compression's name."""
_MARKS = (b"\x04\x00\x00\x00zstd", b"\x03\x00\x00\x00lz4")
_MARK_AT = _HEAD.size + _CHUNK.size - 4
_MOST_UNCOMPRESSED = 1 << 30
_MOST_SMALL = 1 << 24
_DAMAGE = (McapError, ZstdError, struct.error, ValueError, RuntimeError, MemoryError, OverflowError)


@dataclass(frozen=True)
class Whole:
    """A chunk whose checksum agrees: its definitions and messages."""

    records: list[McapRecord]


@dataclass(frozen=True)
class Damage:
    """Bytes that are nothing: where, and of a chunk the times (ns) that its messages are said to have."""

    offset: int
    start_ns: int | None = None
    end_ns: int | None = None


@dataclass(frozen=True)
class End:
    """The end of the file. ``clean``: index and checksums are there and agree."""

    clean: bool


Found = Whole | Damage | Attachment | Metadata | End


def scan(path: Path) -> Iterator[Found]:
    """Everything found, an ``End`` last. Raises OSError."""
    with path.open("rb") as file:
        if file.seek(0, io.SEEK_END) == 0:
            yield End(False)
            return
        with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
            yield from _walk(data)


def ends_well(path: Path) -> bool:
    """Whether the file has been closed: a quick look at its end alone. Raises OSError."""
    with path.open("rb") as file:
        size = file.seek(0, io.SEEK_END)
        length = len(MCAP0_MAGIC) + 20 + _HEAD.size
        if size < length + len(MCAP0_MAGIC):
            return False
        file.seek(size - length)
        tail = file.read()
    return tail.endswith(MCAP0_MAGIC) and _HEAD.unpack_from(tail) == (Opcode.FOOTER, 20)


def _walk(data: mmap.mmap) -> Iterator[Found]:
    at, size = len(MCAP0_MAGIC), len(data)
    sure = at
    crc, clean = zlib.crc32(data[:at]), data[:at] == MCAP0_MAGIC
    while at < size:
        record = _record_at(data, at)
        if record is None:
            clean = False
            yield _damage(data, at)
            at, passed = _next_chunk(data, sure, at)
            sure = at
            yield from passed
            continue
        end, found = record
        if isinstance(found, DataEnd):
            yield End(clean and found.data_section_crc == crc and _has_sound_summary(data, end))
            return
        crc = zlib.crc32(data[at:end], crc)
        if isinstance(found, Whole | Attachment):
            sure = end
        if found is not None:
            yield found
        at = end
    yield End(False)


def _record_at(data: mmap.mmap, at: int) -> tuple[int, Whole | Attachment | Metadata | DataEnd | None] | None:
    """Where the record at ``at`` ends and what it is (None for what is not needed); None where there is no sound record.

    Only chunks and attachments have checksums of their own; of the others at least the lengths agree.
    """
    if at + _HEAD.size > len(data):
        return None
    opcode, length = _HEAD.unpack_from(data, at)
    begin, end = at + _HEAD.size, at + _HEAD.size + length
    if end > len(data):
        return None
    try:
        if opcode == Opcode.CHUNK:
            chunk, end = _chunk(data, begin, end)
            return end, Whole(breakup_chunk(chunk, validate_crc=True))
        if opcode == Opcode.MESSAGE_INDEX:
            return (end, None) if struct.unpack_from("<I", data, begin + 2) == (length - 6,) else None
        if opcode == Opcode.ATTACHMENT:
            if struct.unpack_from("<I", data, end - 4) != (zlib.crc32(data[begin : end - 4]),):
                return None
            return end, Attachment.read(ReadDataStream(io.BytesIO(data[begin:end])))
        readers = {Opcode.HEADER: Header.read, Opcode.METADATA: Metadata.read, Opcode.DATA_END: DataEnd.read}
        if opcode not in readers or length > _MOST_SMALL:
            return None
        stream = ReadDataStream(io.BytesIO(data[begin:end]))
        record = readers[Opcode(opcode)](stream)
    except _DAMAGE:
        return None
    if stream.count != length:
        return None
    return end, record if isinstance(record, Metadata | DataEnd) else None


def _chunk(data: mmap.mmap, begin: int, end: int) -> tuple[Chunk, int]:
    """The chunk and where it ends by its own account: it states its length twice, and either may be what was flipped. Raises
    ValueError where it cannot be one: a flipped length must not ask for all the memory there is."""
    stream = ReadDataStream(io.BytesIO(data[begin:end]))
    chunk: Chunk = Chunk.read(stream)
    if chunk.uncompressed_size > _MOST_UNCOMPRESSED:
        raise ValueError("the chunk's header is damaged")
    return chunk, begin + stream.count


def _next_chunk(data: mmap.mmap, sure: int, bad: int) -> tuple[int, list[Damage]]:
    """Where the next sound chunk begins, or the end of the data, and the unsound ones on the way behind ``bad``. It may lie
    before ``bad``, behind what is ``sure``: the length of the record in between may be what was flipped."""
    at = sure
    passed: list[Damage] = []
    while True:
        hits = [hit for hit in (data.find(mark, at + _MARK_AT) for mark in _MARKS) if hit >= 0]
        if not hits:
            return _end_of_data(data, bad + 1), passed
        start = min(hits) - _MARK_AT
        if data[start] == Opcode.CHUNK:
            if _record_at(data, start) is not None:
                return start, passed
            if start > bad:
                passed.append(_damage(data, start))
        at = start + 1


def _end_of_data(data: mmap.mmap, at: int) -> int:
    """The end of the data section as the footer tells it, where there is one behind ``at``; else the end of the file."""
    size = len(data)
    footer = size - len(MCAP0_MAGIC) - 20 - _HEAD.size
    if footer > at and _HEAD.unpack_from(data, footer) == (Opcode.FOOTER, 20):
        (summary,) = struct.unpack_from("<Q", data, footer + _HEAD.size)
        data_end = summary - 4 - _HEAD.size
        if at <= data_end < footer and data[data_end] == Opcode.DATA_END:
            return int(data_end)
    return size


def _damage(data: mmap.mmap, at: int) -> Damage:
    """What the header of a chunk that cannot be read still says of its times."""
    if at + _HEAD.size + _CHUNK.size <= len(data) and data[at] == Opcode.CHUNK:
        start_ns, end_ns, _, _, _ = _CHUNK.unpack_from(data, at + _HEAD.size)
        return Damage(at, start_ns, end_ns)
    return Damage(at)


def _has_sound_summary(data: mmap.mmap, at: int) -> bool:
    """Whether index and footer follow, with the checksum that the footer states."""
    tail = data[at:]
    footer_at = len(tail) - len(MCAP0_MAGIC) - 20 - _HEAD.size
    if footer_at < 0 or not tail.endswith(MCAP0_MAGIC):
        return False
    try:
        records = list(StreamReader(io.BytesIO(MCAP0_MAGIC + tail)).records)
    except _DAMAGE:
        return False
    footer = records[-1]
    if not isinstance(footer, Footer) or footer.summary_start not in (0, at):
        return False
    begin = 0 if footer.summary_start else footer_at
    return footer.summary_crc == zlib.crc32(tail[begin : footer_at + _HEAD.size + 16])


__all__ = ["Attachment", "Channel", "Damage", "End", "Found", "Message", "Metadata", "Schema", "Whole", "ends_well", "scan"]
