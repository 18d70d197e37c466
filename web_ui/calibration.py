"""The calibration of two plain cameras by a board: its page and its part of the API."""

from typing import TYPE_CHECKING

from flask import Blueprint, Response, jsonify, render_template

from device.calibrating.board_paper import board_of, board_pdf
from web_ui import bodies

if TYPE_CHECKING:
    from device.daemon import Device

_API = "/api/v1/anomaly/calibration"


def blueprint(device: "Device") -> Blueprint:
    """The routes, answering from `device`."""
    calibration = Blueprint("calibration", __name__)

    @calibration.get("/anomaly/calibrate")
    def page() -> str:
        return render_template("calibrate.html", calibration=device.anomaly.calibration.state())

    @calibration.get(_API)
    def state() -> Response:
        return jsonify(device.anomaly.calibration.state())

    @calibration.post(_API)
    def begin() -> Response:
        body = bodies.read(bodies.BoardBody)
        device.anomaly.calibrate(body.kind, body.columns, body.rows, body.square_mm / 1000)
        return Response(status=204)

    @calibration.post(f"{_API}/<any(finish, cancel, save):what>")
    def steer(what: str) -> Response:
        bodies.read(bodies.Empty)
        session = device.anomaly.calibration
        {"finish": session.finish, "cancel": session.cancel, "save": session.save}[what]()
        return Response(status=204)

    @calibration.get(f"{_API}/<any(left, right):side>.jpg")
    def picture(side: str) -> Response:
        data = device.anomaly.calibration.picture(side)
        return Response(status=204) if data is None else Response(data, mimetype="image/jpeg")

    @calibration.get(f"{_API}/board.pdf")
    def board() -> Response:
        wanted = bodies.read_query(bodies.BoardQuery)
        data = board_pdf(board_of(wanted.kind, wanted.columns, wanted.rows, wanted.square_mm / 1000), "A4")
        return Response(data, mimetype="application/pdf")

    return calibration
