"""A list of pipes as the utility gives it before going out: CSV, or GeoJSON lines with the nodes at their ends."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Mapping
from typing import Any, get_args

from device.errors import Invalid
from device.inspections.model import NodeRecord, PipeRecord
from device.store.places import Material, Shape

COLUMNS = ("name", "upstream", "downstream", "material", "shape", "dn", "length_m")
PLACES = ("upstream_easting", "upstream_northing", "downstream_easting", "downstream_northing")
_NEEDED = ("name", "upstream", "downstream")
_MOST = 100_000


def read_pipe_list(data: bytes, file_name: str) -> list[PipeRecord]:
    """The pipes of ``data``; ``file_name`` tells CSV from GeoJSON. Raises Invalid with the line that is wrong.

    CSV has the columns name, upstream, downstream, and may have material, shape, dn (mm), length_m and PLACES. A GeoJSON line
    has the same names as properties; its first point is the upstream node. Its coordinates are longitude and latitude.
    """
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = data.decode("latin-1")
    is_geojson = file_name.lower().endswith((".geojson", ".json"))
    found = _from_geojson(text) if is_geojson else _from_csv(text)
    if not found:
        raise Invalid("The list holds no pipe.")
    if len(found) > _MOST:
        raise Invalid(f"The list holds {len(found)} pipes, more than the {_MOST} that the box takes.")
    names = [pipe.name for pipe in found]
    twice = next((name for name in names if names.count(name) > 1), None) if len(set(names)) < len(names) else None
    if twice is not None:
        raise Invalid(f"The pipe {twice} stands in the list twice.")
    return found


def _from_csv(text: str) -> list[PipeRecord]:
    first = text.splitlines()[0] if text.strip() else ""
    rows = csv.DictReader(io.StringIO(text), delimiter=";" if first.count(";") > first.count(",") else ",")
    names = [(name or "").strip().lower() for name in rows.fieldnames or []]
    missing = [name for name in _NEEDED if name not in names]
    if missing:
        raise Invalid(f"The list lacks the column {missing[0]}: it needs {', '.join(_NEEDED)}.")
    rows.fieldnames = names
    return [_pipe(row, f"line {rows.line_num}") for row in rows if any((value or "").strip() for value in _texts(row))]


def _from_geojson(text: str) -> list[PipeRecord]:
    try:
        stated = json.loads(text)
        features = stated["features"]
        found = []
        for number, feature in enumerate(features, 1):
            if (feature.get("geometry") or {}).get("type") != "LineString":
                continue
            points = feature["geometry"]["coordinates"]
            places = dict(zip(PLACES, (points[0][0], points[0][1], points[-1][0], points[-1][1]), strict=True))
            found.append(_pipe({**(feature.get("properties") or {}), **places}, f"feature {number}"))
    except (ValueError, KeyError, TypeError, IndexError, AttributeError):
        raise Invalid("This is no GeoJSON: it must be a FeatureCollection of LineStrings.") from None
    return found


def _pipe(row: Mapping[str, Any], where: str) -> PipeRecord:
    text = {name: str(row.get(name) if row.get(name) is not None else "").strip() for name in (*COLUMNS, *PLACES)}
    for name in _NEEDED:
        if not text[name]:
            raise Invalid(f"The {name} is missing in {where}.")
    material, shape = text["material"] or "unknown", text["shape"] or "circular"
    if material not in get_args(Material):
        raise Invalid(f"The material {material} in {where} is not one of {', '.join(get_args(Material))}.")
    if shape not in get_args(Shape):
        raise Invalid(f"The shape {shape} in {where} is not one of {', '.join(get_args(Shape))}.")
    numbers = {name: _number(text[name], name, where) for name in ("dn", "length_m", *PLACES)}
    dn = numbers["dn"]
    return PipeRecord(
        text["name"],
        NodeRecord(text["upstream"], numbers["upstream_easting"], numbers["upstream_northing"]),
        NodeRecord(text["downstream"], numbers["downstream_easting"], numbers["downstream_northing"]),
        material,
        shape,
        None if dn is None else round(dn),
        numbers["length_m"],
    )


def _number(text: str, name: str, where: str) -> float | None:
    if not text:
        return None
    try:
        value = float(text.replace(",", "."))
    except ValueError:
        value = float("nan")
    if value != value or abs(value) == float("inf"):
        raise Invalid(f"The {name} in {where} is {text}, which is no number.")
    return value


def _texts(row: Mapping[str, Any]) -> list[str]:
    return [value for value in row.values() if isinstance(value, str)]
