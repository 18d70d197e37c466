"""The box: its sensors, its health, what it does by itself."""

from typing import Any, Literal

from web_ui.answers.base import Answer


class Sensor(Answer):
    """A camera: `age_s` is the age of its last good frame, null before the first."""

    name: str
    kind: str
    state: str
    age_s: float | None
    fps: float
    frames: int
    drops: int
    reconnects: int
    bad_frames: int
    message: str


class Prompt(Answer):
    """What the operator should know: `reason` is wrong, `remedy` helps."""

    code: str
    reason: str
    remedy: str


class Lamp(Answer):
    """`level` 0 to 1 as set or chosen, `shining` at this moment (null while it fails)."""

    name: str
    automatic: bool
    level: float
    shining: float | None
    resting: bool
    message: str


class SensorHealth(Answer):
    """One source end to end, from a depth camera to the tether's encoder."""

    role: str
    name: str
    state: str
    age_s: float | None
    fps: float
    drops: int
    bad: int
    reconnects: int


class Machine(Answer):
    """The computer; null for what it does not tell."""

    temperature_c: float | None
    power: dict[str, bool] | None
    memory_free_mb: int | None
    usb: list[dict[str, Any]]
    hotspot: Literal["up", "silent", "off", "unknown"]
    wifi_clients: int | None


class Health(Answer):
    """Everything about the box itself."""

    disk_free_mb: int
    disk_total_mb: int
    clock: Literal["rtc", "ntp", "browser", "none"]
    machine: Machine
    sensors: list[SensorHealth]
    hotspot_restored: int
    prompts: list[Prompt]


class SurveyProgress(Answer):
    """The measurement under way."""

    state: str
    survey_id: int | None
    frames_done: int
    frames_wanted: int
    position: str | None


class Storage(Answer):
    """Free space of the data folder, and a sentence where the database had to be set aside."""

    free_mb: int
    notice: str | None


class ClockState(Answer):
    """Where the box has its date from."""

    source: Literal["rtc", "ntp", "browser", "none"]


class Autonomy(Answer):
    """Logging by itself: `state` is off, waiting, surveying, aside or held; `holds` are sentences why none is begun; `news` is
    how much has happened since somebody read the journal."""

    on: bool
    state: str
    survey_id: int | None
    holds: list[str]
    news: int


class JournalEntry(Answer):
    """One line of the journal; `at` is null where nobody knew the date."""

    id: int
    what: str
    survey_id: int | None
    reason: str
    at: str | None
    at_s: float
    boot: str
    text: str


class Alone(Answer):
    """What happened while nobody looked, the newest last; it was read up to entry `looked_at`."""

    autonomy: Autonomy
    unsafe_shutdowns: int
    looked_at: int
    entries: list[JournalEntry]


class Status(Answer):
    """The box at this moment."""

    version: str
    uptime_s: float
    cameras: list[Sensor]
    survey: SurveyProgress
    storage: Storage
    clock: ClockState
    workers_replaced: int
