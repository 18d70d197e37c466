"""The anomaly survey and its findings."""

from typing import Any, Literal

from web_ui.answers.base import Answer
from web_ui.answers.box import Prompt
from web_ui.answers.site import Pipe


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
    """The anomaly survey: the scan under way, the camera, the live state; `chainage_m` is what the tether counts, null while
    it is silent; `on_crawler`: the camera is the crawler's, and that is where it stands. Two `plain_cameras` have to be
    calibrated."""

    available: bool
    plain_cameras: bool
    state: str
    survey_id: int | None
    frames_done: int
    frames_wanted: int
    pairs: int
    camera: dict[str, Any] | None
    live: AnomalyLook | None
    chainage_m: float | None
    on_crawler: bool


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


class AlongBand(Answer):
    """Some decimetres of pipe as all scans of them tell together; `surveys` are these scans."""

    from_m: float
    to_m: float
    score_mm: float | None
    outward_mm: float | None
    measured: float
    sees_mm2: float | None
    surveys: list[int]


class Stretch(Answer):
    """From where to where along the pipe."""

    from_m: float
    to_m: float


class Along(Answer):
    """What the scans of one go tell of a pipe together: each region and joint once (`seen_from` which surveys), `gaps` that
    none measured, `next_m` where the camera stands next, to fill the first gap or to go on."""

    from_m: float | None
    to_m: float | None
    surveys: list[int]
    bands: list[AlongBand]
    gaps: list[Stretch]
    regions: list[Region]
    joints: list[dict[str, Any]]
    next_m: float | None


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


class KnownLenses(Answer):
    """A calibration: errors of corners and rows (px), how far disparities may be off, and lengths (percent)."""

    board: str
    views: int
    reprojection_px: float
    epipolar_px: float
    offset_std_px: float
    scale_percent: float
    baseline_mm: float


class Calibration(Answer):
    """A calibration by a board: `covered` are the parts of each picture, row by row; `seen` is what becomes of the newest
    pictures, `next` what to show now; `calibrated` is in use, `found` what came out and can be saved."""

    state: Literal["idle", "gathering", "computing", "done", "failed", "saved"]
    message: str
    board: str | None
    calibrated: KnownLenses | None
    views: int
    views_wanted: int
    covered: dict[str, list[list[bool]]] | None
    covered_wanted: float
    tilts: dict[str, int]
    tilts_wanted: int
    seen: str
    next: str
    found: KnownLenses | None
