"""The raw data of surveys: what there is of it, and its files to take away."""

from typing import TYPE_CHECKING

from flask import Blueprint, Response, jsonify, send_file

from web_ui import bodies

if TYPE_CHECKING:
    from device.daemon import Device

_ID = f"<int(min=1, max={bodies.MAX_ID}):number>"
_FILE = "<int(min=1, max=99):take>/<int(min=1, max=999):part>"


def blueprint(device: "Device") -> Blueprint:
    """The routes, answering from `device`."""
    recordings = Blueprint("recordings", __name__, url_prefix="/api/v1/surveys")

    @recordings.get(f"/{_ID}/recordings")
    def listed(number: int) -> Response:
        return jsonify(device.recordings.of(number))

    @recordings.get(f"/{_ID}/recordings/{_FILE}")
    def file(number: int, take: int, part: int) -> Response:
        path = device.recordings.file(number, take, part)
        return send_file(path, mimetype="application/octet-stream", as_attachment=True, download_name=path.name)

    return recordings
