"""The site: its manholes and pipes, their page and their part of the API."""

from typing import TYPE_CHECKING

from flask import Blueprint, Response, jsonify, render_template

from web_ui import bodies
from web_ui import site_bodies as wanted

if TYPE_CHECKING:
    from device.daemon import Device

_ID = f"<int(min=1, max={bodies.MAX_ID}):number>"
_API = "/api/v1"


def blueprint(device: "Device") -> Blueprint:
    """The routes, answering from `device`."""
    site = Blueprint("site", __name__)
    places = device.places

    @site.get("/site")
    def page() -> str:
        nodes = places.nodes()
        return render_template(
            "site.html",
            site=places.site(),
            nodes=nodes,
            names={node["id"]: node["name"] for node in nodes},
            pipes=places.pipes(),
            gone=places.pipes(deleted=True),
            deleted=bodies.read_query(bodies.DeletedQuery).deleted,
            materials=wanted.MATERIALS,
            shapes=wanted.SHAPES,
        )

    @site.get(f"{_API}/site")
    def described() -> Response:
        return jsonify(places.site())

    @site.patch(f"{_API}/site")
    def update_site() -> Response:
        return jsonify(places.update_site(bodies.read(wanted.SiteChange).model_dump(exclude_unset=True)))

    @site.get(f"{_API}/nodes")
    def nodes() -> Response:
        return jsonify(places.nodes())

    @site.post(f"{_API}/nodes")
    def create_node() -> tuple[Response, int]:
        return jsonify(places.create_node(**bodies.read(wanted.NodeBody).model_dump())), 201

    @site.get(f"{_API}/nodes/check")
    def check_node() -> Response:
        asked = bodies.read_query(wanted.NodeQuery)
        return jsonify(places.judge_node(asked.name, asked.own))

    @site.patch(f"{_API}/nodes/{_ID}")
    def update_node(number: int) -> Response:
        return jsonify(places.update_node(number, bodies.read(wanted.NodeChange).model_dump(exclude_unset=True)))

    @site.delete(f"{_API}/nodes/{_ID}")
    def delete_node(number: int) -> Response:
        bodies.read(bodies.Empty)
        places.delete_node(number)
        return Response(status=204)

    @site.get(f"{_API}/pipes")
    def pipes() -> Response:
        return jsonify(places.pipes())

    @site.post(f"{_API}/pipes")
    def create_pipe() -> tuple[Response, int]:
        return jsonify(places.create_pipe(bodies.read(wanted.PipeBody).model_dump())), 201

    @site.get(f"{_API}/pipes/check")
    def check_pipe() -> Response:
        asked = bodies.read_query(wanted.PipeQuery)
        return jsonify(places.judge_pipe(asked.name, asked.upstream, asked.downstream, asked.own))

    @site.patch(f"{_API}/pipes/{_ID}")
    def update_pipe(number: int) -> Response:
        return jsonify(places.update_pipe(number, bodies.read(wanted.PipeChange).model_dump(exclude_unset=True)))

    @site.delete(f"{_API}/pipes/{_ID}")
    def delete_pipe(number: int) -> Response:
        bodies.read(bodies.Empty)
        places.delete_pipe(number)
        return Response(status=204)

    @site.post(f"{_API}/pipes/{_ID}/restore")
    def restore_pipe(number: int) -> Response:
        bodies.read(bodies.Empty)
        return jsonify(places.restore_pipe(number))

    @site.post(f"{_API}/pipes/import")
    def import_pipes() -> tuple[Response, int]:
        body = bodies.read(wanted.PipeListBody)
        return jsonify(device.inspections.import_pipes(body.text.encode(), body.file_name, body.crs)), 201

    return site
