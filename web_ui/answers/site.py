"""Manholes and pipes."""

from web_ui.answers.base import Answer


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


class Imported(Answer):
    """What became of a pipe list."""

    pipes: int
    nodes: int
    there: int


class Site(Answer):
    """The site; `crs` is the EPSG number of its nodes' coordinates."""

    id: int
    name: str
    crs: int | None
