"""The box itself: its health and its lamp, one page and their part of the API."""

from typing import TYPE_CHECKING

from flask import Blueprint, Response, jsonify, render_template

from web_ui import bodies

if TYPE_CHECKING:
    from device.daemon import Device


def blueprint(device: "Device") -> Blueprint:
    """The routes, answering from `device`."""
    box = Blueprint("box", __name__)

    @box.get("/health")
    def page() -> str:
        return render_template("health.html", health=device.health(), lamp=device.status()["lamp"])

    @box.get("/api/v1/health")
    def health() -> Response:
        return jsonify(device.health())

    @box.get("/api/v1/lamp")
    def lamp() -> Response:
        return jsonify(device.lamp())

    @box.put("/api/v1/lamp")
    def set_lamp() -> Response:
        body = bodies.read(bodies.LampBody)
        return jsonify(device.set_lamp(body.level, body.automatic))

    return box
