"""The semantic map as files for other programs: a JSON graph, PLY and glTF meshes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from device.durable import write_whole
from device.errors import Invalid
from device.json_text import dumps
from device.structure_json import map_json
from drivers.virtual.chamber.objects import solids_of
from drivers.virtual.chamber.solids import Box, Cylinder, Solid, Sphere
from estimators.structure.graph import MapObject, StructureMap
from estimators.structure.types import CLASSES

KINDS = (".json", ".ply", ".glb")
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


def export_map(found: StructureMap, path: Path) -> None:
    """Save the map. Raises Invalid where the file cannot be written."""
    check_export(path)
    kind = path.suffix.lower()
    data = dumps(graph_json(found)).encode() if kind == ".json" else _mesh_bytes(found, kind.removeprefix("."))
    try:
        write_whole(path, data)
    except OSError as error:
        raise Invalid(f"The map cannot be saved as {path}: {error.strerror}.") from error


def graph_json(found: StructureMap) -> dict[str, Any]:
    """Nodes (objects) and pipes as links, in the node-link form that graph programs read (networkx, d3)."""
    told = map_json(found)
    nodes = [{"id": f"object {thing['number']}", "kind": "object", **thing} for thing in told["objects"]]
    nodes += [{"id": f"pipe {pipe['number']}", "kind": "pipe", **pipe} for pipe in told["pipes"]]
    links = [{"source": f"object {edge['object']}", "target": f"pipe {edge['pipe']}", **edge} for edge in told["edges"]]
    return {"directed": False, "multigraph": False, "graph": {"frame": "north, east, down (m)"}, "nodes": nodes, "links": links}


def _mesh_bytes(found: StructureMap, kind: str) -> bytes:
    import trimesh  # a third of a second, and nobody else needs it

    parts = []
    for pipe in found.pipes:
        mesh = trimesh.creation.cylinder(pipe.radius, segment=[pipe.start, pipe.end], sections=24)
        parts.append((f"pipe {pipe.number}", mesh, _COLOURS["pipe"]))
    for thing in found.objects:
        label = CLASSES[thing.label]
        pieces = [_mesh(solid, trimesh) for solid in _placed(thing, label)]
        parts.append((f"{label} {thing.number}", trimesh.util.concatenate(pieces), _COLOURS[label]))
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


def _placed(thing: MapObject, label: str) -> list[Solid]:
    rotation = np.eye(3) if thing.orientation is None else thing.orientation
    if thing.orientation is None and len(thing.pipes):
        x = thing.pipes[0]
        y = np.cross(x, np.eye(3)[int(np.argmin(np.abs(x)))])
        y /= np.linalg.norm(y)
        rotation = np.column_stack([x, y, np.cross(x, y)])
    is_open = thing.handle is None or thing.handle.is_open is not False
    return [solid.moved(rotation, thing.position) for solid in solids_of(label, is_open)]


def _mesh(solid: Solid, trimesh: Any) -> Any:
    if isinstance(solid, Cylinder):
        return trimesh.creation.cylinder(solid.radius, segment=[solid.start, solid.end], sections=24)
    if isinstance(solid, Sphere):
        return trimesh.creation.icosphere(2, solid.radius).apply_translation(solid.centre)
    assert isinstance(solid, Box)
    place = np.eye(4)
    place[:3, :3], place[:3, 3] = solid.rotation, solid.centre
    return trimesh.creation.box(2 * solid.half, place)
