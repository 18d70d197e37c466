"""What requests about the site may contain: its manholes and pipes."""

from typing import Annotated, get_args

from pydantic import BaseModel, ConfigDict, Field

from device.store.places import Material, Shape
from web_ui.bodies import Body, Id, Line, Name, Note

MATERIALS: tuple[str, ...] = get_args(Material)
SHAPES: tuple[str, ...] = get_args(Shape)

ReferenceDn = Annotated[int, Field(ge=50, le=4000, description="nominal diameter on the map, mm")]
PipeLength = Annotated[float, Field(gt=0, lt=10_000, allow_inf_nan=False, description="m")]
Coordinate = Annotated[float, Field(gt=-1e8, lt=1e8, allow_inf_nan=False)]
Epsg = Annotated[int, Field(ge=1024, le=32767, description="EPSG number of the coordinates")]


class NodeBody(Body):
    """A manhole or other node; its place in the site's reference system, m."""

    name: Name
    easting: Coordinate | None = None
    northing: Coordinate | None = None
    level: Coordinate | None = None


class NodeChange(Body):
    """The fields of a node to change; absent ones stay."""

    name: Name = Field(default="")
    easting: Coordinate | None = None
    northing: Coordinate | None = None
    level: Coordinate | None = None


class NodeQuery(BaseModel):
    """A manhole's name as it is typed; `own` is the manhole that is renamed."""

    model_config = ConfigDict(extra="ignore")

    name: Line = ""
    own: Id | None = None


class PipeBody(Body):
    """A new pipe between two nodes."""

    name: Name
    start_node: Id | None = None
    end_node: Id | None = None
    material: Material = "unknown"
    shape: Shape = "circular"
    reference_dn: ReferenceDn | None = None
    length_m: PipeLength | None = None
    note: Note = ""


class PipeChange(Body):
    """The fields of a pipe to change; absent ones stay."""

    name: Name = Field(default="")
    start_node: Id | None = None
    end_node: Id | None = None
    material: Material = "unknown"
    shape: Shape = "circular"
    reference_dn: ReferenceDn | None = None
    length_m: PipeLength | None = None
    note: Note = ""


class PipeQuery(BaseModel):
    """A pipe's name (empty: built from its manholes) and manholes as they are typed; `own` is the pipe that is edited."""

    model_config = ConfigDict(extra="ignore")

    name: Line = ""
    upstream: Line = ""
    downstream: Line = ""
    own: Id | None = None


class SiteChange(Body):
    """The fields of the site to change; absent ones stay."""

    name: Name = Field(default="")
    crs: Epsg | None = None


class PipeListBody(Body):
    """A pipe list; `file_name` tells CSV from GeoJSON by its ending."""

    text: Annotated[str, Field(min_length=1, max_length=60_000)]
    file_name: Line = "pipes.csv"
    crs: Epsg | None = None
