"""The JSON API under /api/v1: each route asks the device one thing."""

from typing import TYPE_CHECKING

from flask import Blueprint, Response, jsonify, request

from web_ui import bodies, openapi

if TYPE_CHECKING:
    from device.daemon import Device

_ID = f"<int(min=1, max={bodies.MAX_ID}):number>"


def blueprint(device: "Device") -> Blueprint:
    """The API's routes, answering from `device`."""
    api = Blueprint("api", __name__, url_prefix="/api/v1")

    @api.get("/status")
    def status() -> Response:
        return jsonify(device.status())

    @api.get("/live")
    def live() -> Response:
        return jsonify(device.live())

    @api.get("/picture/<any(depth, color):kind>.jpg")
    def picture(kind: str) -> Response:
        return _jpeg(device.picture(kind, request.args.get("camera") or None))

    @api.get("/cloud")
    def cloud() -> Response:
        return jsonify(device.cloud(bodies.read_query(bodies.CloudQuery).survey_id))

    @api.get("/nodes")
    def nodes() -> Response:
        return jsonify(device.nodes())

    @api.post("/nodes")
    def create_node() -> tuple[Response, int]:
        return jsonify(device.create_node(bodies.read(bodies.NodeBody).name)), 201

    @api.get("/pipes")
    def pipes() -> Response:
        return jsonify(device.pipes())

    @api.post("/pipes")
    def create_pipe() -> tuple[Response, int]:
        return jsonify(device.create_pipe(bodies.read(bodies.PipeBody).model_dump())), 201

    @api.patch(f"/pipes/{_ID}")
    def update_pipe(number: int) -> Response:
        change = bodies.read(bodies.PipeChange).model_dump(exclude_unset=True)
        return jsonify(device.update_pipe(number, change))

    @api.delete(f"/pipes/{_ID}")
    def delete_pipe(number: int) -> Response:
        bodies.read(bodies.Empty)
        device.delete_pipe(number)
        return Response(status=204)

    @api.post("/measure")
    def measure() -> tuple[Response, int]:
        body = bodies.read(bodies.MeasureBody)
        return jsonify(device.measure(body.pipe_id, body.position, body.frames, body.survey_id)), 202

    @api.post("/measure/cancel")
    def cancel() -> Response:
        bodies.read(bodies.Empty)
        device.cancel()
        return Response(status=204)

    @api.get("/surveys")
    def surveys() -> Response:
        query = bodies.read_query(bodies.SurveyQuery)
        return jsonify(device.surveys(query.pipe_id, query.limit, query.before))

    @api.get(f"/surveys/{_ID}")
    def survey(number: int) -> Response:
        return jsonify(device.survey(number))

    @api.get(f"/surveys/{_ID}/picture/<any(depth, color):kind>.jpg")
    def survey_picture(number: int, kind: str) -> Response:
        return _jpeg(device.survey_picture(number, kind))

    @api.post(f"/surveys/{_ID}/answer")
    def answer(number: int) -> Response:
        return jsonify(device.answer(number, bodies.read(bodies.AnswerBody).model_dump()))

    @api.delete(f"/surveys/{_ID}")
    def delete_survey(number: int) -> Response:
        bodies.read(bodies.Empty)
        device.delete_survey(number)
        return Response(status=204)

    @api.post(f"/surveys/{_ID}/restore")
    def restore_survey(number: int) -> Response:
        bodies.read(bodies.Empty)
        device.restore_survey(number)
        return Response(status=204)

    @api.post("/clock")
    def clock() -> Response:
        device.set_clock(bodies.read(bodies.ClockBody).epoch_ms)
        return Response(status=204)

    @api.get("/openapi.json")
    def document() -> Response:
        return jsonify(openapi.document())

    return api


def _jpeg(picture: bytes | None) -> Response:
    return Response(status=204) if picture is None else Response(picture, mimetype="image/jpeg")
