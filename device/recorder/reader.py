"""A recording as a replay needs it: its head, and its samples in the order in which they were written, over all its files."""

from __future__ import annotations

import io
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mcap.stream_reader import StreamReader

from device.errors import Invalid
from device.recorder.names import parts_of
from device.recorder.samples import Sample
from device.recorder.scan import Attachment, Channel, Message, Schema, Whole, scan
from device.recorder.schemas import Gathering
from device.recorder.writer import DEFINITIONS, HEAD

HEAD_TOPIC = "/recording"
"""The head once more, as the first message: the attachment that holds it may be damaged."""


@dataclass(frozen=True)
class Entry:
    """One sample of a topic; ``sequence`` counts what the topic was given, also what was dropped."""

    topic: str
    sample: Sample
    sequence: int
    log_ns: int


@dataclass(frozen=True)
class Definitions:
    """Channels and schemas by their numbers."""

    channels: dict[int, Channel]
    schemas: dict[int, Schema]

    def learn(self, records: Sequence[Any]) -> None:
        """Take in those among ``records``."""
        for record in records:
            if isinstance(record, Channel):
                self.channels[record.id] = record
            elif isinstance(record, Schema):
                self.schemas[record.id] = record


def definitions(path: Path) -> Definitions:
    """Of the attachments first: they are there even where the first chunk is damaged."""
    found = Definitions({}, {})
    for part in scan(path):
        if isinstance(part, Attachment) and part.name == DEFINITIONS:
            found.learn(list(StreamReader(io.BytesIO(part.data)).records))
    return found


@dataclass(frozen=True)
class Recording:
    """``head`` is what was known before; ``files`` are its parts in order."""

    head: dict[str, Any]
    files: tuple[Path, ...]

    def entries(self) -> Iterator[Entry]:
        """Every sample that can be read."""
        gathering = Gathering()
        for path in self.files:
            known = definitions(path)
            for found in scan(path):
                if not isinstance(found, Whole):
                    continue
                known.learn(found.records)
                for message in found.records:
                    if isinstance(message, Message):
                        yield from _entry(message, known, gathering)


def open_recording(path: Path) -> Recording:
    """The recording that the file ``path`` is a part of. Raises Invalid with one sentence."""
    if not path.is_file():
        raise Invalid(f"There is no recording {path}.")
    files = parts_of(path)
    try:
        head = _head(files[0])
    except OSError as error:
        raise Invalid(f"The recording {path} cannot be read: {error.strerror}.") from None
    if head is None:
        raise Invalid(f"The file {path} is no recording of borescout, or its beginning is lost.")
    return Recording(head, files)


def _head(path: Path) -> dict[str, Any] | None:
    known = definitions(path)
    gathering = Gathering()
    for found in scan(path):
        if isinstance(found, Attachment) and found.name == HEAD:
            attached: dict[str, Any] = json.loads(found.data)
            return attached
        if isinstance(found, Whole):
            known.learn(found.records)
            for message in found.records:
                for entry in _entry(message, known, gathering) if isinstance(message, Message) else ():
                    if entry.topic == HEAD_TOPIC and isinstance(entry.sample, dict):
                        return entry.sample
    return None


def _entry(message: Message, known: Definitions, gathering: Gathering) -> Iterator[Entry]:
    channel = known.channels.get(message.channel_id)
    schema = None if channel is None else known.schemas.get(channel.schema_id)
    if channel is None or schema is None:
        return
    whole = gathering.add(channel.topic, schema.name, message.sequence, message.data)
    if whole is not None:
        yield Entry(*whole, message.sequence, message.log_time)
