"""The JSON API under /api/v1: each route asks the device one thing."""

from typing import TYPE_CHECKING

from flask import Blueprint, Response, current_app, jsonify

from web_ui import bodies, openapi

if TYPE_CHECKING:
    from device.daemon import Device

_ID = f"<int(min=1, max={bodies.MAX_ID}):number>"
_LANDMARK = f"<int(min=1, max={bodies.MAX_ID}):landmark>"


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
        return _jpeg(device.picture(kind, bodies.read_query(bodies.PictureQuery).camera))

    @api.get("/cloud")
    def cloud() -> Response:
        return jsonify(device.cloud(bodies.read_query(bodies.CloudQuery).survey_id))

    @api.post("/measure")
    def measure() -> tuple[Response, int]:
        body = bodies.read(bodies.MeasureBody)
        return jsonify(device.measure(body.pipe_id, body.position, body.frames, body.survey_id)), 202

    @api.post("/measure/cancel")
    def cancel() -> Response:
        bodies.read(bodies.Empty)
        device.cancel()
        return Response(status=204)

    @api.get("/drive")
    def drive() -> Response:
        return jsonify(device.drive.state())

    @api.post("/drive")
    def start_drive() -> tuple[Response, int]:
        return jsonify(device.drive.begin(**bodies.read(bodies.DriveBody).model_dump())), 202

    @api.post("/drive/<any(pause, resume, cancel):what>")
    def steer_drive(what: str) -> Response:
        bodies.read(bodies.Empty)
        {"pause": device.drive.pause, "resume": device.drive.resume, "cancel": device.drive.cancel}[what]()
        return Response(status=204)

    @api.post("/drive/mark")
    def mark() -> tuple[Response, int]:
        body = bodies.read(bodies.MarkBody)
        return jsonify(device.drive.mark(body.label, body.clock, body.note)), 201

    @api.post("/drive/end")
    def end_drive() -> tuple[Response, int]:
        return jsonify(device.drive.end(bodies.read(bodies.EndBody).length_m)), 202

    @api.get("/drive/picture.jpg")
    def drive_picture() -> Response:
        wanted = bodies.read_query(bodies.DrivePictureQuery)
        return _jpeg(device.drive.picture(wanted.overlay, wanted.heatmap))

    @api.put("/encoder")
    def encoder() -> Response:
        return jsonify(device.drive.set_encoder(bodies.read(bodies.EncoderBody).model_dump(exclude_unset=True)))

    @api.post("/encoder/zero")
    def zero_encoder() -> Response:
        return jsonify(device.drive.zero_encoder(bodies.read(bodies.ZeroBody).chainage_m))

    @api.post("/encoder/calibrate")
    def calibrate_encoder() -> Response:
        body = bodies.read(bodies.CalibrateBody)
        return jsonify(device.drive.calibrate_encoder(body.point, body.length_m))

    @api.get(f"/surveys/{_ID}/map")
    def survey_map(number: int) -> Response:
        return jsonify(device.drive.map(number))

    @api.get(f"/surveys/{_ID}/landmarks/{_LANDMARK}/thumbnail.jpg")
    def thumbnail(number: int, landmark: int) -> Response:
        return _jpeg(device.drive.thumbnail(number, landmark, bodies.read_query(bodies.ThumbnailQuery).heatmap))

    @api.patch(f"/surveys/{_ID}/landmarks/{_LANDMARK}")
    def change_landmark(number: int, landmark: int) -> Response:
        change = bodies.read(bodies.LandmarkChange).model_dump(exclude_unset=True, by_alias=True)
        return jsonify(device.drive.change_landmark(number, landmark, change))

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
        return jsonify(openapi.document(current_app.url_map))

    return api


def _jpeg(picture: bytes | None) -> Response:
    return Response(status=204) if picture is None else Response(picture, mimetype="image/jpeg")
