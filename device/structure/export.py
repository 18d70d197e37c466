"""The semantic map, as ``told`` states it, as files for other programs: a JSON graph, PLY and glTF meshes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from device.durable import write_whole
from device.errors import Invalid
from device.json_text import dumps
from drivers.virtual.chamber.objects import solids_of
from drivers.virtual.chamber.solids import Box, Cylinder, Solid, Sphere

KINDS = (".json", ".ply", ".glb")
MIME = {"json": "application/json", "ply": "application/octet-stream", "glb": "model/gltf-binary"}
_Map = dict[str, Any]
_COLOURS = {
    "pipe": (150, 160, 170),
    "ball valve": (214, 39, 40),
    "elbow": (31, 119, 180),
    "tee": (44, 160, 44),
    "socket": (148, 103, 189),
    "butterfly valve": (255, 127, 14),
    "3-way valve": (227, 119, 194),
}


def check_export(path: Path) -> None:
    """Raises Invalid where there is no such format or no such folder."""
    if path.suffix.lower() not in KINDS:
        raise Invalid(f"The map is saved as {', '.join(KINDS)}, not as {path.suffix or path.name}.")
    if not path.parent.is_dir():
        raise Invalid(f"There is no folder {path.parent}.")


def export_map(told: _Map, path: Path) -> None:
    """Save the map. Raises Invalid where the file cannot be written."""
    check_export(path)
    try:
        write_whole(path, map_bytes(told, path.suffix.lower().removeprefix(".")))
    except OSError as error:
        raise Invalid(f"The map cannot be saved as {path}: {error.strerror}.") from error


def map_bytes(told: _Map, kind: str) -> bytes:
    """The map as "json", "ply" or "glb". Raises Invalid where there is nothing to draw."""
    if kind == "json":
        return dumps(graph_json(told)).encode()
    if not told["pipes"] and not told["objects"]:
        raise Invalid("The map is empty: there is nothing to draw.")
    return _mesh_bytes(told, kind)


def graph_json(told: _Map) -> _Map:
    """Nodes (objects) and pipes as links, in the node-link form that graph programs read (networkx, d3)."""
    nodes = [{"id": f"object {thing['number']}", "kind": "object", **thing} for thing in told["objects"]]
    nodes += [{"id": f"pipe {pipe['number']}", "kind": "pipe", **pipe} for pipe in told["pipes"]]
    links = [{"source": f"object {edge['object']}", "target": f"pipe {edge['pipe']}", **edge} for edge in told["edges"]]
    return {"directed": False, "multigraph": False, "graph": {"frame": "north, east, down (m)"}, "nodes": nodes, "links": links}


def _mesh_bytes(told: _Map, kind: str) -> bytes:
    import trimesh  # a third of a second, and nobody else needs it

    parts = []
    for pipe in told["pipes"]:
        mesh = trimesh.creation.cylinder(pipe["radius_m"], segment=[pipe["from"], pipe["to"]], sections=24)
        parts.append((f"pipe {pipe['number']}", mesh, _COLOURS["pipe"]))
    for thing in told["objects"]:
        pieces = [_mesh(solid, trimesh) for solid in _placed(thing)]
        parts.append((f"{thing['class']} {thing['number']}", trimesh.util.concatenate(pieces), _COLOURS[thing["class"]]))
    for _, mesh, colour in parts:
        mesh.visual.vertex_colors = np.array([*colour, 255], dtype=np.uint8)
    if kind == "ply":
        return bytes(trimesh.util.concatenate([mesh for _, mesh, _ in parts]).export(None, file_type="ply"))
    scene = trimesh.Scene()
    # glTF has y up: north, up, and south of east
    upright = np.array([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]], float)
    for name, mesh, _ in parts:
        scene.add_geometry(mesh, node_name=name, geom_name=name, transform=upright)
    return bytes(scene.export(None, file_type="glb"))


def _placed(thing: _Map) -> list[Solid]:
    """The solids of an object where it stands; turned as its pipes tell where nothing else does."""
    rotation = np.eye(3)
    if thing["orientation"] is not None:
        rotation = np.array(thing["orientation"]).T
    elif thing["pipes"]:
        x = np.array(thing["pipes"][0])
        y = np.cross(x, np.eye(3)[int(np.argmin(np.abs(x)))])
        y /= np.linalg.norm(y)
        rotation = np.column_stack([x, y, np.cross(x, y)])
    solids = solids_of(thing["class"], thing["open"] is not False)
    return [solid.moved(rotation, np.array(thing["position"])) for solid in solids]


def _mesh(solid: Solid, trimesh: Any) -> Any:
    if isinstance(solid, Cylinder):
        return trimesh.creation.cylinder(solid.radius, segment=[solid.start, solid.end], sections=24)
    if isinstance(solid, Sphere):
        return trimesh.creation.icosphere(2, solid.radius).apply_translation(solid.centre)
    assert isinstance(solid, Box)
    place = np.eye(4)
    place[:3, :3], place[:3, 3] = solid.rotation, solid.centre
    return trimesh.creation.box(2 * solid.half, place)
