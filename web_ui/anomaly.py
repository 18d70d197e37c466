"""The anomaly survey: its page and its part of the API."""

from typing import TYPE_CHECKING

from flask import Blueprint, Response, jsonify, render_template

from web_ui import bodies, site_bodies

if TYPE_CHECKING:
    from device.daemon import Device

_ID = f"<int(min=1, max={bodies.MAX_ID}):number>"
_API = "/api/v1/anomaly"
_SURVEY = f"/api/v1/surveys/{_ID}/anomaly"


def blueprint(device: "Device") -> Blueprint:
    """The routes, answering from `device`."""
    anomaly = Blueprint("anomaly", __name__)

    @anomaly.get("/anomaly")
    def page() -> str:
        return render_template(
            "anomaly.html",
            anomaly=device.anomaly.look(),
            pipes=device.places.pipes(),
            nodes=device.places.nodes(),
            chosen=bodies.read_query(bodies.MeasureQuery).pipe,
            materials=site_bodies.MATERIALS,
            shapes=site_bodies.SHAPES,
        )

    @anomaly.get(_API)
    def state() -> Response:
        return jsonify(device.anomaly.look())

    @anomaly.post(_API)
    def scan() -> tuple[Response, int]:
        body = bodies.read(bodies.ScanBody)
        return jsonify(device.anomaly.scan(body.pipe_id, body.chainage_m, body.pairs)), 202

    @anomaly.post(f"{_API}/cancel")
    def cancel() -> Response:
        bodies.read(bodies.Empty)
        device.anomaly.cancel()
        return Response(status=204)

    @anomaly.get(f"{_API}/picture.jpg")
    def picture() -> Response:
        return _picture(device.anomaly.picture(), "image/jpeg")

    @anomaly.get(_SURVEY)
    def found(number: int) -> Response:
        return jsonify(device.anomaly.found(number))

    @anomaly.get(f"{_SURVEY}/along")
    def along(number: int) -> Response:
        return jsonify(device.anomaly.along(number))

    @anomaly.get(f"{_SURVEY}/<any(reference, overlay):what>.jpg")
    def view(number: int, what: str) -> Response:
        return _picture(device.anomaly.view(number, what), "image/jpeg")

    @anomaly.get(f"{_SURVEY}/wall.png")
    def wall(number: int) -> Response:
        return _picture(device.anomaly.wall(number), "image/png")

    return anomaly


def _picture(data: bytes | None, kind: str) -> Response:
    return Response(status=204) if data is None else Response(data, mimetype=kind)
