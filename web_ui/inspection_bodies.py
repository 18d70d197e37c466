"""What comes in over HTTP about inspections, checked before the device sees it."""

from datetime import datetime
from typing import Annotated, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from device.export.formats import NAMES
from web_ui.bodies import MAX_ID, Body, Direction, Id, Line, Note, one_line

FORMATS = ("pdf", "zip", *(name for name in NAMES if name not in ("pdf", "zip")))
"""In the order of the page: what most people want first."""
Operator = Annotated[str, Field(max_length=40), AfterValidator(one_line)]
Method = Literal["crawler", "rod", "pushrod", "manhole"]
Station = Annotated[float, Field(ge=0, lt=1000, allow_inf_nan=False, description="m from the start node")]
Hour = Annotated[int, Field(ge=1, le=12, description="clock position")]
Amount = Annotated[float, Field(ge=0, lt=10_000, allow_inf_nan=False)]
Coordinate = Annotated[float, Field(gt=-1e8, lt=1e8, allow_inf_nan=False)]
Epsg = Annotated[int, Field(ge=1024, le=32767, description="EPSG number of the coordinates")]


def _iso_date(text: str) -> str:
    datetime.fromisoformat(text)
    return text


Moment = Annotated[str, Field(max_length=40, description="ISO 8601"), AfterValidator(_iso_date)]


class InspectionChange(Body):
    """What an inspection is called by; absent fields stay."""

    operator: Operator = ""
    date: Moment | None = None
    direction: Direction = "downstream"
    method: Method = "crawler"
    length_m: Station | None = Field(default=None, gt=0)
    note: Note = ""


class InspectionBody(InspectionChange):
    """A new inspection of a pipe."""

    pipe_id: Id


class JoinBody(Body):
    """Where in the pipe a survey of one place was made."""

    station_m: Station | None = None


class ObservationBody(Body):
    """One coded observation (EN 13508-2)."""

    station: Station
    code: Annotated[str, Field(pattern=r"^[A-Z]{3}$")]
    ch1: Annotated[str, Field(pattern=r"^[A-Z]{0,2}$")] = ""
    ch2: Annotated[str, Field(pattern=r"^[A-Z]{0,2}$")] = ""
    q1: Amount | None = None
    q2: Amount | None = None
    clock_from: Hour | None = None
    clock_to: Hour | None = None
    continuous: Annotated[str, Field(pattern=r"^([AB][1-9][0-9]?)?$")] = ""
    at_joint: bool = False
    remark: Annotated[str, Field(max_length=500), AfterValidator(one_line)] = ""
    photo: Line = ""
    source: Line = ""
    number: Annotated[int, Field(ge=0, le=MAX_ID)] = 0


class ObservationsBody(Body):
    """All observations of an inspection, as they shall be from now on."""

    observations: Annotated[list[ObservationBody], Field(max_length=2000)]
    by: Operator = ""


class InspectionQuery(BaseModel):
    """Of one pipe only."""

    model_config = ConfigDict(extra="ignore")

    pipe_id: Id | None = None


class CompareQuery(BaseModel):
    """The inspection to compare with."""

    model_config = ConfigDict(extra="ignore")

    older: Id


class ExportQuery(BaseModel):
    """Language of texts, and feet instead of metres."""

    model_config = ConfigDict(extra="ignore")

    language: Literal["en", "de"] = "en"
    imperial: bool = False
