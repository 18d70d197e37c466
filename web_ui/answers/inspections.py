"""Inspections and their observations."""

from web_ui.answers.base import Answer


class JoinedSurvey(Answer):
    """A survey of an inspection."""

    survey_id: int
    station_m: float | None
    kind: str


class InspectionRow(Answer):
    """An inspection in the list."""

    id: int
    pipe_id: int
    operator: str
    date: str | None
    direction: str
    method: str
    length_m: float | None
    note: str
    created: str | None
    surveys: list[JoinedSurvey]
    edited: bool


class Observation(Answer):
    """A coded observation."""

    number: int
    station: float
    code: str
    ch1: str
    ch2: str
    q1: float | None
    q2: float | None
    clock_from: int | None
    clock_to: int | None
    continuous: str
    at_joint: bool
    remark: str
    photo: str
    source: str


class Inspection(InspectionRow):
    """One inspection as it would go out; `faults` are the rules that it breaks."""

    observations: list[Observation]
    photos: list[str]
    faults: list[str]


class Compared(Answer):
    """Two inspections; `grown` and `same` pair the older observation with the newer."""

    older: int
    newer: int
    new: list[Observation]
    gone: list[Observation]
    grown: list[list[Observation]]
    same: list[list[Observation]]


class ObservationCode(Answer):
    """A main code of EN 13508-2."""

    code: str
    text: str
    clock: str
    unit: str | None
    ch1: dict[str, str]
    ch2: dict[str, str]
