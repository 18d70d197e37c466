"""What the API answers, for its document: the fields that are always there. More may come with them."""

from typing import Any, Literal

from pydantic import BaseModel, ConfigDict


class Answer(BaseModel):
    """A JSON object; fields that are not named here may be in it."""

    model_config = ConfigDict(extra="allow")


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


class Live(Answer):
    """The live estimate of the best camera."""

    camera: str
    frame: int
    age_s: float


class Cylinder(Answer):
    """The fitted cylinder: a point of its axis, the axis' direction, and the radius, in metres of the camera frame."""

    axis: list[float]
    point: list[float]
    radius: float


class Cloud(Answer):
    """At most 3000 points (m), with 1 for each that lies on the cylinder."""

    points: list[list[float]]
    inlier: list[int]
    cylinder: Cylinder | None


class Node(Answer):
    """A manhole or other node."""

    id: int
    name: str
    site: str
    easting: float | None
    northing: float | None
    level: float | None


class Judged(Answer):
    """An identifier: what forbids it, or null, and what to look at before it is kept."""

    name: str
    error: str | None
    warnings: list[str]


class Pipe(Answer):
    """A pipe between two nodes."""

    id: int
    name: str
    start_node: int | None
    end_node: int | None
    material: str
    shape: str
    reference_dn: int | None
    length_m: float | None
    note: str


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


class AnomalyLook(Answer):
    """The stereo camera's view at a glance: `matched` and `around` are shares, `right` and `down` where the camera stands in
    radii from the pipe's middle, `prompt` what to mend before a scan."""

    age_s: float
    level: Literal["good", "fair", "poor"]
    matched: float
    around: float
    right: float | None
    down: float | None
    radius_mm: float | None
    prompt: Prompt | None


class Anomaly(Answer):
    """The anomaly survey: the scan under way, the camera, the live state; `chainage_m` is what the tether counts."""

    available: bool
    state: str
    survey_id: int | None
    frames_done: int
    frames_wanted: int
    pairs: int
    camera: dict[str, Any] | None
    live: AnomalyLook | None
    chainage_m: float | None


class Region(Answer):
    """A part of the wall that deviates: `peak_mm` is negative inwards; `expected` at a joint; `seen_in` how many pairs."""

    area_mm2: float
    peak_mm: float | None
    z_m: float
    clock: float
    kind: str
    expected: bool
    confidence: float
    chainage_m: float | None


class AnomalyMap(Answer):
    """The unrolled wall in few cells: rows from near to far, angles from 9 o'clock over 12 to 9; null where not measured."""

    near_m: float
    far_m: float
    first_clock: float
    deviation_mm: list[list[float | None]]


class AnomalyFound(Answer):
    """What a scan found; `map` is null where it was refused."""

    survey_id: int
    kind: str
    state: str
    created: str | None
    pipe: Pipe | None
    map: AnomalyMap | None


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


class Party(Answer):
    """A paired device."""

    id: str
    name: str


class AskingParty(Party):
    """A paired device that asks for the control, and has it in `left_s` seconds without an answer."""

    left_s: float


class ControlState(Answer):
    """Who controls the box and who asks."""

    controller: Party | None
    request: AskingParty | None


class SessionState(Answer):
    """The own session: for who is paired also its `id`, `name`, `csrf`, and the state of the control."""

    paired: bool


class PairedSession(SessionState, ControlState):
    """The own session: `csrf` has to come with each change, as the header X-CSRF-Token."""

    id: str
    name: str
    csrf: str


class PairedDevice(Party):
    """One of those who are paired."""

    address: str
    controls: bool
    silent_s: float


class Reason(BaseModel):
    """A code for programs, a sentence for the operator."""

    code: str
    message: str


class Error(BaseModel):
    """Why not."""

    error: Reason


class Site(Answer):
    """The site; `crs` is the EPSG number of its nodes' coordinates."""

    id: int
    name: str
    crs: int | None


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


class Imported(Answer):
    """What became of a pipe list."""

    pipes: int
    nodes: int
    there: int
