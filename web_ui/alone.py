"""The box while nobody looks: logging by itself on and off, and what happened meanwhile."""

from typing import TYPE_CHECKING

from flask import Blueprint, Response, jsonify, render_template

from web_ui import bodies

if TYPE_CHECKING:
    from device.daemon import Device


def blueprint(device: "Device") -> Blueprint:
    """The routes, answering from `device`."""
    alone = Blueprint("alone", __name__)

    @alone.get("/alone")
    def page() -> str:
        return render_template("alone.html", alone=device.unattended())

    @alone.get("/api/v1/alone")
    def told() -> Response:
        return jsonify(device.unattended())

    @alone.put("/api/v1/alone")
    def switch() -> Response:
        return jsonify(device.log_by_itself(bodies.read(bodies.AloneBody).on))

    @alone.post("/api/v1/alone/looked")
    def looked() -> Response:
        device.look_at_journal(bodies.read(bodies.LookedBody).entry)
        return Response(status=204)

    return alone
