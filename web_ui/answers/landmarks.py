"""The landmarks survey and its map."""

from typing import Any, Literal

from web_ui.answers.base import Answer
from web_ui.answers.site import Pipe


class Encoder(Answer):
    """The tether encoder with its calibration."""

    name: str
    state: str
    age_s: float | None
    message: str
    counts_per_metre: float
    direction: Literal[1, -1]


class Drive(Answer):
    """The drive under way, the CCTV and the tether."""

    available: bool
    state: str
    survey_id: int | None
    pipe_id: int | None
    direction: str
    chainage_m: float | None
    sigma_m: float | None
    speed_mps: float | None
    seconds: float
    frames: int
    dropped: int
    fps: float
    grabber: dict[str, Any] | None
    encoder: Encoder | None
    prompts: list[dict[str, Any]]
    counts: dict[str, int]


class Landmark(Answer):
    """Something that lies in the pipe: as measured, and what people said of it."""

    id: int
    chainage_m: float | None
    status: str


class Map(Answer):
    """The map of a drive."""

    survey_id: int
    kind: str
    state: str
    created: str | None
    pipe: Pipe | None
    landmarks: list[Landmark]
    rings: list[Any]
    faults: list[dict[str, Any]]
