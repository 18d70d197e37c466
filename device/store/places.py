"""Sites, nodes (manholes) and the pipes between them."""

from __future__ import annotations

import sqlite3
from collections.abc import Sequence
from dataclasses import asdict
from typing import Annotated, Any, Literal, TypeVar

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError

from device.config import sentence
from device.errors import Invalid, NotFound
from device.inspections import identifiers
from device.inspections.model import PipeRecord
from device.store.database import Database

_M = TypeVar("_M", bound=BaseModel)
_DEFAULT_SITE = 1

Material = Literal["PVC", "concrete", "clay", "PE", "PP", "GRP", "ductile iron", "unknown"]
Shape = Literal["circular", "egg", "oval", "other"]


def _name(text: str) -> str:
    text = text.strip()
    if not text:
        raise ValueError("it must not be empty")
    return text


Name = Annotated[str, Field(max_length=80), AfterValidator(_name)]


class _Pipe(BaseModel):
    """A pipe as the operator describes it: ``start_node`` is the upstream one, ``reference_dn`` the map's diameter in mm."""

    model_config = ConfigDict(extra="forbid")

    name: Name
    start_node: int | None = None
    end_node: int | None = None
    material: Material = "unknown"
    shape: Shape = "circular"
    reference_dn: Annotated[int, Field(ge=50, le=4000)] | None = None
    length_m: Annotated[float, Field(gt=0, lt=10_000, allow_inf_nan=False)] | None = None
    note: Annotated[str, Field(max_length=2000)] = ""


class _Site(BaseModel):
    model_config = ConfigDict(extra="forbid")

    name: Name
    crs: Annotated[int, Field(ge=1024, le=32767)] | None = None


class _Node(BaseModel):
    """A node; ``easting``, ``northing`` (in the site's reference system) and ``level`` in metres."""

    model_config = ConfigDict(extra="forbid")

    name: Name
    easting: Annotated[float, Field(allow_inf_nan=False)] | None = None
    northing: Annotated[float, Field(allow_inf_nan=False)] | None = None
    level: Annotated[float, Field(allow_inf_nan=False)] | None = None


_NODE = "SELECT nodes.id, nodes.name, sites.name AS site, easting, northing, level FROM nodes JOIN sites ON sites.id = site_id"


_PLACED = "SELECT 1 FROM nodes WHERE easting IS NOT NULL OR northing IS NOT NULL LIMIT 1"
_INSERT_PIPE = (
    "INSERT INTO pipes (name, start_node, end_node, material, shape, reference_dn, length_m, note)"
    " VALUES (:name, :start_node, :end_node, :material, :shape, :reference_dn, :length_m, :note)"
)


class Places:
    """Queries on sites, nodes and pipes. Everything returned is JSON-ready."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def site(self) -> dict[str, Any]:
        """The default site: {"id", "name", "crs"}, the last an EPSG number or None."""
        with self._database.read() as connection:
            return dict(connection.execute("SELECT id, name, crs FROM sites WHERE id = ?", (_DEFAULT_SITE,)).fetchone())

    def update_site(self, data: dict[str, Any]) -> dict[str, Any]:
        """Change the default site's name or reference system. Raises Invalid."""
        before = self.site()
        site = checked(_Site, {"name": before["name"], "crs": before["crs"], **data})
        with self._database.write() as connection:
            if before["crs"] not in (None, site.crs) and connection.execute(_PLACED).fetchone():
                raise Invalid(
                    f"Manholes have coordinates in EPSG:{before['crs']}: under another number they would lie somewhere else. "
                    "Take the coordinates away first."
                )
            connection.execute("UPDATE sites SET name = ?, crs = ? WHERE id = ?", (site.name, site.crs, _DEFAULT_SITE))
        return self.site()

    def nodes(self) -> list[dict[str, Any]]:
        """Every node: {"id", "name", "site", "easting", "northing", "level"}, by name."""
        with self._database.read() as connection:
            return [dict(row) for row in connection.execute(f"{_NODE} ORDER BY nodes.name").fetchall()]

    def node(self, node_id: int) -> dict[str, Any]:
        """One node. Raises NotFound."""
        with self._database.read() as connection:
            row = connection.execute(f"{_NODE} WHERE nodes.id = ?", (node_id,)).fetchone()
        if row is None:
            raise NotFound(f"There is no node number {node_id}.")
        return dict(row)

    def create_node(self, name: str, **place: float | None) -> dict[str, Any]:
        """A new node at the default site. Raises Invalid for an empty name or one that is taken."""
        node = _node(name, {"name": name, **place})
        try:
            with self._database.write() as connection:
                number = connection.execute(
                    "INSERT INTO nodes (site_id, name, easting, northing, level) VALUES (?, ?, ?, ?, ?)",
                    (_DEFAULT_SITE, node.name, node.easting, node.northing, node.level),
                ).lastrowid
        except sqlite3.IntegrityError:
            raise Invalid(f"There is already a manhole called {node.name}.") from None
        assert number is not None  # sqlite gives every inserted row a number
        return self.node(number)

    def update_node(self, node_id: int, data: dict[str, Any]) -> dict[str, Any]:
        """Change the fields in ``data``, keep the others. Raises NotFound, Invalid."""
        before = self.node(node_id)
        node = _node(before["name"], {**{name: before[name] for name in _Node.model_fields}, **data})
        try:
            with self._database.write() as connection:
                connection.execute(
                    "UPDATE nodes SET name = :name, easting = :easting, northing = :northing, level = :level WHERE id = :id",
                    {**node.model_dump(), "id": node_id},
                )
        except sqlite3.IntegrityError:
            raise Invalid(f"There is already a manhole called {node.name}.") from None
        return self.node(node_id)

    def delete_node(self, node_id: int) -> None:
        """Forget a manhole that nothing refers to. Raises NotFound, Invalid."""
        node = self.node(node_id)
        try:
            with self._database.write() as connection:
                connection.execute("DELETE FROM nodes WHERE id = ?", (node_id,))
        except sqlite3.IntegrityError:
            raise Invalid(f"{node['name']} stays: a pipe (or one that was deleted) or a survey belongs to it.") from None

    def judge_node(self, name: str, own: int | None = None) -> dict[str, Any]:
        """Whether ``name`` may be that of a manhole: {"name", "error", "warnings"}. ``own`` is the one that is renamed."""
        return asdict(identifiers.judge_node(name, {node["name"] for node in self.nodes() if node["id"] != own}))

    def judge_pipe(self, name: str, upstream: str, downstream: str, own: int | None = None) -> dict[str, Any]:
        """Whether ``name`` (empty: built from the manholes) may be that of a pipe: {"name", "error", "warnings"}."""
        nodes = {node["id"]: node["name"] for node in self.nodes()}
        others = {
            pipe["name"]: (nodes.get(pipe["start_node"], ""), nodes.get(pipe["end_node"], ""))
            for pipe in self.pipes()
            if pipe["id"] != own
        }
        return asdict(identifiers.judge_pipe(name, upstream, downstream, others, set(nodes.values())))

    def pipes(self, deleted: bool = False) -> list[dict[str, Any]]:
        """Every pipe that is not deleted, or every one that is, by name."""
        with self._database.read() as connection:
            rows = connection.execute("SELECT * FROM pipes WHERE deleted = ? ORDER BY name, id", (deleted,)).fetchall()
        return [pipe_json(row) for row in rows]

    def pipe(self, pipe_id: int, deleted: bool = False) -> dict[str, Any]:
        """One pipe; with ``deleted`` also one that was taken off the list. Raises NotFound."""
        with self._database.read() as connection:
            row = connection.execute("SELECT * FROM pipes WHERE id = ? AND deleted <= ?", (pipe_id, deleted)).fetchone()
        if row is None:
            raise NotFound(f"There is no pipe number {pipe_id}.")
        return pipe_json(row)

    def create_pipe(self, data: dict[str, Any]) -> dict[str, Any]:
        """A new pipe from the fields of _Pipe. Raises Invalid."""
        pipe = _pipe(data)
        try:
            with self._database.write() as connection:
                _refuse_taken(connection, pipe.name)
                number = connection.execute(
                    _INSERT_PIPE,
                    pipe.model_dump(),
                ).lastrowid
        except sqlite3.IntegrityError:
            raise Invalid("The pipe starts or ends at a manhole that does not exist.") from None
        return {"id": number, **pipe.model_dump()}

    def add_all(self, listed: Sequence[PipeRecord], crs: int | None) -> dict[str, Any]:
        """Add those of ``listed`` whose names are not taken, with their nodes, all of them or none; coordinates are in EPSG
        ``crs``. {"pipes": added, "nodes": added, "there": left as they were}. Raises Invalid."""
        added = {"pipes": 0, "nodes": 0, "there": 0}
        with self._database.write() as connection:
            if crs is not None:
                present = connection.execute("SELECT crs FROM sites WHERE id = ?", (_DEFAULT_SITE,)).fetchone()["crs"]
                if present not in (None, crs):
                    raise Invalid(f"The list is in EPSG:{crs}, the site in EPSG:{present}: convert the list first.")
                connection.execute("UPDATE sites SET crs = ? WHERE id = ?", (crs, _DEFAULT_SITE))
            taken = {row["name"] for row in connection.execute("SELECT name FROM pipes WHERE NOT deleted")}
            nodes = {row["name"]: row["id"] for row in connection.execute("SELECT id, name FROM nodes")}
            for pipe in listed:
                if pipe.name in taken:
                    added["there"] += 1
                    continue
                for node in (pipe.upstream, pipe.downstream):
                    if node.name not in nodes:
                        nodes[node.name] = connection.execute(
                            "INSERT INTO nodes (site_id, name, easting, northing, level) VALUES (?, ?, ?, ?, ?)",
                            (_DEFAULT_SITE, *_node(node.name, asdict(node)).model_dump().values()),
                        ).lastrowid
                        added["nodes"] += 1
                fields = _pipe(
                    {
                        "name": pipe.name,
                        "start_node": nodes[pipe.upstream.name],
                        "end_node": nodes[pipe.downstream.name],
                        "material": pipe.material,
                        "shape": pipe.shape,
                        "reference_dn": pipe.dn_mm,
                        "length_m": pipe.length,
                    }
                )
                connection.execute(_INSERT_PIPE, fields.model_dump())
                added["pipes"] += 1
        return added

    def update_pipe(self, pipe_id: int, data: dict[str, Any]) -> dict[str, Any]:
        """Change the fields in ``data``, keep the others. Raises NotFound, Invalid."""
        before = self.pipe(pipe_id)
        before.pop("id")
        pipe = _pipe({**before, **data})
        try:
            with self._database.write() as connection:
                if pipe.name != before["name"]:
                    _refuse_taken(connection, pipe.name)
                connection.execute(
                    "UPDATE pipes SET name = :name, start_node = :start_node, end_node = :end_node, material = :material,"
                    " shape = :shape, reference_dn = :reference_dn, length_m = :length_m, note = :note WHERE id = :id",
                    {**pipe.model_dump(), "id": pipe_id},
                )
        except sqlite3.IntegrityError:
            raise Invalid("The pipe starts or ends at a manhole that does not exist.") from None
        return {"id": pipe_id, **pipe.model_dump()}

    def delete_pipe(self, pipe_id: int) -> None:
        """Take the pipe off the list; its surveys keep it. Raises NotFound."""
        self.pipe(pipe_id)
        with self._database.write() as connection:
            connection.execute("UPDATE pipes SET deleted = 1 WHERE id = ?", (pipe_id,))

    def restore_pipe(self, pipe_id: int) -> dict[str, Any]:
        """Undo ``delete_pipe``. Raises NotFound, and Invalid where its name was given to another one meanwhile."""
        with self._database.write() as connection:
            row = connection.execute("SELECT name, deleted FROM pipes WHERE id = ?", (pipe_id,)).fetchone()
            if row is None:
                raise NotFound(f"There is no pipe number {pipe_id}.")
            if row["deleted"]:
                _refuse_taken(connection, row["name"])
                connection.execute("UPDATE pipes SET deleted = 0 WHERE id = ?", (pipe_id,))
        return self.pipe(pipe_id)


def _node(called: str, data: dict[str, Any]) -> _Node:
    node = checked(_Node, data)
    if (node.easting is None) != (node.northing is None):
        raise Invalid(f"The manhole {called.strip()} has half a place: easting and northing, both or neither.")
    return node


def _pipe(data: dict[str, Any]) -> _Pipe:
    pipe = checked(_Pipe, data)
    if pipe.start_node is not None and pipe.start_node == pipe.end_node:
        raise Invalid(f"The pipe {pipe.name} would begin and end at the same manhole.")
    return pipe


def _refuse_taken(connection: sqlite3.Connection, name: str) -> None:
    if connection.execute("SELECT 1 FROM pipes WHERE name = ? AND NOT deleted", (name,)).fetchone():
        raise Invalid(f"There is already a pipe called {name}.")


def pipe_json(row: sqlite3.Row) -> dict[str, Any]:
    """A row of ``pipes`` as the page reads it."""
    fields = ("id", "name", "start_node", "end_node", "material", "shape", "reference_dn", "length_m", "note")
    return {field: row[field] for field in fields}


def checked(model: type[_M], data: dict[str, Any]) -> _M:
    """``data`` as ``model``. Raises Invalid with a sentence."""
    try:
        return model.model_validate(data)
    except ValidationError as error:
        raise Invalid(sentence(error, "field")) from None
