"""Sites, nodes (manholes and other wells) and the pipes between them."""

from __future__ import annotations

import sqlite3
from typing import Annotated, Any, Literal, TypeVar

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError

from device.config import sentence
from device.errors import Invalid, NotFound
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
    """A pipe as the operator describes it; ``reference_dn`` is the nominal diameter on the map, in mm."""

    model_config = ConfigDict(extra="forbid")

    name: Name
    start_node: int | None = None
    end_node: int | None = None
    material: Material = "unknown"
    shape: Shape = "circular"
    reference_dn: Annotated[int, Field(ge=50, le=4000)] | None = None
    note: Annotated[str, Field(max_length=2000)] = ""


class _Node(BaseModel):
    name: Name


class Places:
    """Queries on sites, nodes and pipes. Everything returned is JSON-ready."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def nodes(self) -> list[dict[str, Any]]:
        """Every node: {"id", "name", "site"}, by name."""
        with self._database.read() as connection:
            rows = connection.execute(
                "SELECT nodes.id, nodes.name, sites.name AS site FROM nodes JOIN sites ON sites.id = site_id"
                " ORDER BY nodes.name"
            ).fetchall()
        return [dict(row) for row in rows]

    def create_node(self, name: str) -> dict[str, Any]:
        """A new node at the default site. Raises Invalid for an empty name or one that is taken."""
        node = _checked(_Node, {"name": name})
        try:
            with self._database.write() as connection:
                number = connection.execute(
                    "INSERT INTO nodes (site_id, name) VALUES (?, ?)", (_DEFAULT_SITE, node.name)
                ).lastrowid
                site = connection.execute("SELECT name FROM sites WHERE id = ?", (_DEFAULT_SITE,)).fetchone()[0]
        except sqlite3.IntegrityError:
            raise Invalid(f"There is already a well called {node.name}.") from None
        return {"id": number, "name": node.name, "site": site}

    def pipes(self) -> list[dict[str, Any]]:
        """Every pipe that is not deleted, by name."""
        with self._database.read() as connection:
            rows = connection.execute("SELECT * FROM pipes WHERE NOT deleted ORDER BY name, id").fetchall()
        return [pipe_json(row) for row in rows]

    def pipe(self, pipe_id: int) -> dict[str, Any]:
        """One pipe. Raises NotFound."""
        with self._database.read() as connection:
            row = connection.execute("SELECT * FROM pipes WHERE id = ? AND NOT deleted", (pipe_id,)).fetchone()
        if row is None:
            raise NotFound(f"There is no pipe number {pipe_id}.")
        return pipe_json(row)

    def create_pipe(self, data: dict[str, Any]) -> dict[str, Any]:
        """A new pipe from the fields of _Pipe. Raises Invalid."""
        pipe = _checked(_Pipe, data)
        try:
            with self._database.write() as connection:
                number = connection.execute(
                    "INSERT INTO pipes (name, start_node, end_node, material, shape, reference_dn, note)"
                    " VALUES (:name, :start_node, :end_node, :material, :shape, :reference_dn, :note)",
                    pipe.model_dump(),
                ).lastrowid
        except sqlite3.IntegrityError:
            raise Invalid("The pipe starts or ends at a well that does not exist.") from None
        return {"id": number, **pipe.model_dump()}

    def update_pipe(self, pipe_id: int, data: dict[str, Any]) -> dict[str, Any]:
        """Change the fields in ``data``, keep the others. Raises NotFound, Invalid."""
        before = self.pipe(pipe_id)
        before.pop("id")
        pipe = _checked(_Pipe, {**before, **data})
        try:
            with self._database.write() as connection:
                connection.execute(
                    "UPDATE pipes SET name = :name, start_node = :start_node, end_node = :end_node, material = :material,"
                    " shape = :shape, reference_dn = :reference_dn, note = :note WHERE id = :id",
                    {**pipe.model_dump(), "id": pipe_id},
                )
        except sqlite3.IntegrityError:
            raise Invalid("The pipe starts or ends at a well that does not exist.") from None
        return {"id": pipe_id, **pipe.model_dump()}

    def delete_pipe(self, pipe_id: int) -> None:
        """Take the pipe off the list; its surveys keep it. Raises NotFound."""
        self.pipe(pipe_id)
        with self._database.write() as connection:
            connection.execute("UPDATE pipes SET deleted = 1 WHERE id = ?", (pipe_id,))


def pipe_json(row: sqlite3.Row) -> dict[str, Any]:
    """A row of ``pipes`` as the page reads it."""
    fields = ("id", "name", "start_node", "end_node", "material", "shape", "reference_dn", "note")
    return {field: row[field] for field in fields}


def _checked(model: type[_M], data: dict[str, Any]) -> _M:
    try:
        return model.model_validate(data)
    except ValidationError as error:
        raise Invalid(sentence(error, "field")) from None
