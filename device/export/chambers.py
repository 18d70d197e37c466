"""The maps of the chambers at a pipe's ends: tables, a JSON graph and a scene of each."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from device.errors import Invalid
from device.export.base import Options
from device.export.pacp import table
from device.inspections.model import Inspection
from device.structure.export import map_bytes

_OBJECT = ("survey", "node", "object", "class", "belief", "north_m", "east_m", "depth_m", "sigma_m", "open", "pipes")


def chambers(inspection: Inspection, options: Options) -> dict[str, bytes]:
    """``chambers.csv`` with every object, and the map of each chamber as JSON graph and glTF. Raises Invalid without any."""
    if not inspection.structures:
        raise Invalid("There is no chamber in this inspection: map one at a node of its pipe first.")
    rows: list[dict[str, str]] = []
    files: dict[str, bytes] = {}
    for one in inspection.structures:
        rows += [_row(one, thing) for thing in one["objects"]]
        for kind in ("json", "glb"):
            if kind == "json" or one["pipes"]:
                files[f"chamber_{one['survey_id']}.{kind}"] = map_bytes(dict(one), kind)
    return {"chambers.csv": table(_OBJECT, rows), **files}


def node_name(one: Mapping[str, Any]) -> str:
    """What the chamber is called."""
    return "" if one.get("node") is None else str(one["node"]["name"])


def pipes_of(one: Mapping[str, Any], thing: Mapping[str, Any]) -> str:
    """The numbers of the pipes that an object sits on."""
    return " ".join(str(edge["pipe"]) for edge in one["edges"] if edge["object"] == thing["number"])


def _row(one: Mapping[str, Any], thing: Mapping[str, Any]) -> dict[str, str]:
    north, east, down = thing["position"]
    state = {True: "open", False: "closed", None: ""}[thing["open"]]
    values = (one["survey_id"], node_name(one), thing["number"], thing["class"], thing["belief"], north, east, down)
    return dict(zip(_OBJECT, map(str, (*values, thing["sigma_m"], state, pipes_of(one, thing))), strict=True))
