"""The structure survey and its map."""

from typing import Any

from web_ui.answers.base import Answer
from web_ui.answers.box import Prompt


class Structure(Answer):
    """The structure survey under way and its sensors; `position` is north, east, down (m) of where it began."""

    available: bool
    state: str
    survey_id: int | None
    node_id: int | None
    seconds: float
    scans: int
    dropped: int
    late: int
    position: list[float] | None
    sigma_m: float | None
    pipes: int
    objects: int
    unsure: int
    consistent: bool
    sensors: list[dict[str, Any]]
    prompts: list[Prompt]


class StructureMap(Answer):
    """The semantic map of a chamber; `uncertain` is what should be looked at again, the most doubtful first."""

    survey_id: int
    kind: str
    state: str
    created: str | None
    clock_source: str
    node: dict[str, Any] | None
    pipes: list[dict[str, Any]]
    objects: list[dict[str, Any]]
    edges: list[dict[str, Any]]
    uncertain: list[dict[str, Any]]
    next_view: dict[str, Any] | None
    track: list[dict[str, Any]]
    consistent: bool
