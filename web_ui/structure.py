"""Chambers: the page that maps one, the page of a map, and their part of the API."""

from typing import TYPE_CHECKING

from flask import Blueprint, Response, jsonify, render_template

from web_ui import bodies

if TYPE_CHECKING:
    from device.daemon import Device

_ID = f"<int(min=1, max={bodies.MAX_ID}):number>"
_API = "/api/v1"


def blueprint(device: "Device") -> Blueprint:
    """The routes, answering from `device`."""
    structure = Blueprint("structure", __name__)

    @structure.get("/structure")
    def page() -> str:
        query = bodies.read_query(bodies.StructureQuery)
        newest = next((one for one in device.surveys(None, 50, None) if one.get("kind") == "structure"), None)
        return render_template(
            "structure.html", structure=device.structure.state(), nodes=device.places.nodes(), chosen=query.node, newest=newest
        )

    @structure.get(f"{_API}/structure")
    def state() -> Response:
        return jsonify(device.structure.state())

    @structure.post(f"{_API}/structure")
    def begin() -> tuple[Response, int]:
        return jsonify(device.structure.begin(bodies.read(bodies.StructureBody).node_id)), 202

    @structure.post(f"{_API}/structure/end")
    def end() -> tuple[Response, int]:
        bodies.read(bodies.Empty)
        return jsonify(device.structure.end()), 202

    @structure.post(f"{_API}/structure/cancel")
    def cancel() -> Response:
        bodies.read(bodies.Empty)
        device.structure.cancel()
        return Response(status=204)

    @structure.get(f"{_API}/surveys/{_ID}/structure")
    def survey_map(number: int) -> Response:
        return jsonify(device.structure.map(number))

    @structure.get(f"{_API}/surveys/{_ID}/structure/map.<any(json, ply, glb):kind>")
    def file(number: int, kind: str) -> Response:
        data, name, mime = device.structure.file(number, kind)
        heading = {"Content-Disposition": f'attachment; filename="{name}"', "Cache-Control": "no-store"}
        return Response(data, content_type=mime, headers=heading)

    return structure
