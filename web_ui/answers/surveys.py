"""Surveys of every kind, and their raw data."""

from typing import Any

from web_ui.answers.base import Answer
from web_ui.answers.site import Pipe


class Begun(Answer):
    """What was begun is stored under this number."""

    survey_id: int


class DnClass(Answer):
    """A DN class with its probability."""

    name: str
    probability: float


class Summary(Answer):
    """A survey in the history."""

    id: int
    kind: str
    created: str | None
    clock_source: str
    pipe_id: int | None
    pipe: str | None
    state: str
    diameter_mm: float | None
    interval_mm: list[float] | None
    dn: DnClass | None
    final_verdict: str | None
    verdict_by: str | None
    reasons: list[str]


class Survey(Answer):
    """One survey with its recordings and result."""

    id: int
    kind: str
    created: str | None
    clock_source: str
    pipe: Pipe | None
    state: str
    recordings: list[dict[str, Any]]
    result: dict[str, Any] | None
    operator: dict[str, Any] | None
    final_verdict: str | None
    verdict_by: str | None


class RecordingFile(Answer):
    """One file of raw data; `take` and `part` are in its address."""

    take: int
    part: int
    file: str
    bytes: int


class Recordings(Answer):
    """Raw data of a survey: `state` is recording, kept, gone or none; `message` says why there is none, or not all of it."""

    state: str
    message: str
    dropped: int
    files: list[RecordingFile]
