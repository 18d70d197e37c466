"""What comes in over HTTP, checked before the device sees it."""

from typing import Annotated, Literal, TypeVar

from flask import request
from pydantic import AfterValidator, BaseModel, ConfigDict, Field

MAX_ID = 2**53 - 1  # the largest whole number JavaScript and SQLite both hold exactly

Position = Literal["entrance", "top", "middle"]
Verdict = Literal["accept", "retry"]
Direction = Literal["downstream", "upstream"]
Decision = Literal["confirmed", "rejected"]
Id = Annotated[int, Field(ge=1, le=MAX_ID)]


def one_line(text: str) -> str:
    """``text`` without spaces around it. Raises ValueError where it is more than a line."""
    text = text.strip()
    if not text.isprintable():
        raise ValueError("must be one line without control characters")
    return text


def _name(text: str) -> str:
    text = one_line(text)
    if not text:
        raise ValueError("must not be empty")
    return text


def _note(text: str) -> str:
    text = text.replace("\r\n", "\n").strip()
    if not all(character.isprintable() or character in "\n\t" for character in text):
        raise ValueError("must not hold control characters")
    return text


Name = Annotated[str, Field(max_length=80), AfterValidator(_name)]
Line = Annotated[str, Field(max_length=80), AfterValidator(one_line)]
Note = Annotated[str, Field(max_length=2000), AfterValidator(_note)]
Chainage = Annotated[float, Field(ge=-1000, le=100_000, allow_inf_nan=False, description="m along the pipe")]
Length = Annotated[float, Field(gt=0, le=100_000, allow_inf_nan=False, description="m")]
Clock = Annotated[float, Field(gt=0, le=12, description="clock position, 12 at the crown")]


class Body(BaseModel):
    """A JSON object: exact types, no unknown fields."""

    model_config = ConfigDict(extra="forbid", strict=True)


class PairBody(Body):
    """The PIN on the label, and what to call the one who pairs."""

    pin: Annotated[str, Field(pattern=r"^[0-9]{6}$", description="six digits")]
    name: Annotated[str, Field(max_length=40), AfterValidator(one_line)] = ""


class MeasureBody(Body):
    """Start a measurement; `survey_id` makes it the second position of that survey."""

    pipe_id: Id | None = None
    position: Position | None = None
    frames: Annotated[int, Field(ge=1, le=500)] | None = None
    survey_id: Id | None = None


class ScanBody(Body):
    """Scan the present view of the stereo camera: which pipe, where in it the camera stands, how many pairs."""

    pipe_id: Id | None = None
    chainage_m: Chainage | None = None
    pairs: Annotated[int, Field(ge=1, le=20)] | None = None


class BoardBody(Body):
    """The board that two plain cameras are calibrated with: how many squares across and down, how wide each is on the paper."""

    kind: Literal["charuco", "chessboard"] = "charuco"
    columns: Annotated[int, Field(ge=4, le=40)] = 9
    rows: Annotated[int, Field(ge=4, le=40)] = 6
    square_mm: Annotated[float, Field(ge=2, le=500, allow_inf_nan=False)] = 30.0


class DriveBody(Body):
    """Start a drive: which pipe, which way, its interior radius where it is known, the chainage it begins at."""

    pipe_id: Id | None = None
    direction: Direction = "downstream"
    radius_m: Annotated[float, Field(ge=0.02, le=5)] | None = None
    start_chainage_m: Chainage | None = None


class StructureBody(Body):
    """Map a chamber: the node that it is, where it is known."""

    node_id: Id | None = None


class MarkBody(Body):
    """A landmark that the operator sees where the crawler is now; the clock position where it is known."""

    label: Name
    clock: Clock | None = None
    note: Note = ""


class EndBody(Body):
    """The crawler is at the end node; `length_m` is the pipe's length from node to node where it is known."""

    length_m: Length | None = None


class EncoderBody(Body):
    """How the tether's counts become metres; absent fields stay."""

    counts_per_metre: Annotated[float, Field(gt=0, le=1e9)] = 1.0
    direction: Literal[1, -1] = 1


class LampBody(Body):
    """How bright the lamp should be, or that the pictures say it; a level alone turns the automatic off."""

    level: Annotated[float, Field(ge=0, le=1, allow_inf_nan=False)] | None = None
    automatic: bool | None = None


class AloneBody(Body):
    """Log by itself, or not."""

    on: bool


class LookedBody(Body):
    """Somebody has read the journal up to this entry."""

    entry: Annotated[int, Field(ge=0, le=MAX_ID)]


class ZeroBody(Body):
    """The crawler stands at this chainage now."""

    chainage_m: Chainage = 0.0


class CalibrateBody(Body):
    """Two-point calibration: once at the start, once at the end with the length between the two."""

    point: Literal["start", "end"]
    length_m: Length | None = None


class LandmarkChange(Body):
    """What somebody says of a landmark; absent fields stay as they were said, null takes a word back."""

    decision: Decision | None = None
    label: Annotated[Name | None, Field(alias="class")] = None
    chainage_m: Chainage | None = None
    clock: Clock | None = None
    note: Note = ""
    by: Line = ""


class AnswerBody(Body):
    """What the operator says about a survey: the three visual questions and the verdict."""

    image_good: bool | None = None
    cloud_is_pipe: bool | None = None
    fit_aligned: bool | None = None
    verdict: Verdict | None = None
    by: Line = ""
    note: Note = ""


class ClockBody(Body):
    """The browser's time, milliseconds since 1970 (UTC), between 2020 and 2100."""

    epoch_ms: Annotated[int, Field(ge=1_577_836_800_000, lt=4_102_444_800_000)]


class Empty(Body):
    """No fields."""


class SurveyQuery(BaseModel):
    """Filter and page of the history; query strings are text, so numbers are converted."""

    model_config = ConfigDict(extra="ignore")

    pipe_id: Id | None = None
    limit: Annotated[int, Field(ge=1, le=200)] = 50
    before: Id | None = None


class BoardQuery(BoardBody):
    """The board to print."""

    model_config = ConfigDict(extra="ignore", strict=False)


class PictureQuery(BaseModel):
    """The camera whose picture is wanted; without one, the first that has a picture."""

    model_config = ConfigDict(extra="ignore")

    camera: Annotated[str, Field(max_length=200)] | None = None


class EventsQuery(BaseModel):
    """The name of the tab, so that a new stream takes the place of the tab's old one."""

    model_config = ConfigDict(extra="ignore")

    tab: Annotated[str, Field(pattern=r"^[A-Za-z0-9-]{1,40}$")] = ""


class CloudQuery(BaseModel):
    """The survey whose cloud is wanted; without one, the live cloud."""

    model_config = ConfigDict(extra="ignore")

    survey_id: Id | None = None


class DrivePictureQuery(BaseModel):
    """Whether the projected grid and the tracked landmarks are drawn into the picture; the class of the heatmap over it."""

    model_config = ConfigDict(extra="ignore")

    overlay: bool = False
    heatmap: Annotated[str, Field(max_length=80)] | None = None


class ThumbnailQuery(BaseModel):
    """The class of the heatmap over a landmark's picture; none without it."""

    model_config = ConfigDict(extra="ignore")

    heatmap: Annotated[str, Field(max_length=80)] | None = None


class StructureQuery(BaseModel):
    """The structure page opened for one node."""

    model_config = ConfigDict(extra="ignore")

    node: Id | None = None


class MeasureQuery(BaseModel):
    """The measuring page opened for one pipe, or for the second position of a survey."""

    model_config = ConfigDict(extra="ignore")

    pipe: Id | None = None
    second: Id | None = None


class DeletedQuery(BaseModel):
    """The history opened just after a deletion, which it offers to undo."""

    model_config = ConfigDict(extra="ignore")

    deleted: Id | None = None


B = TypeVar("B", bound=BaseModel)


def read(model: type[B]) -> B:
    """The request's body as `model`; an empty body is an empty object.

    Raises pydantic.ValidationError, answered with status 422 and one sentence.
    """
    return model.model_validate_json(request.get_data(cache=False) or b"{}")


def read_query(model: type[B]) -> B:
    """The query string as `model`; empty parameters (an unset filter in a form) count as absent."""
    return model.model_validate({key: value for key, value in request.args.items() if value})
