"""The OpenAPI document of /api/v1: bodies from the pydantic models, the rest stated here (a test walks the URL map)."""

from functools import cache
from typing import Any

from pydantic import BaseModel
from pydantic.json_schema import models_json_schema

from web_ui import bodies

_OBJECT: dict[str, Any] = {"type": "object"}
_REF = "#/components/schemas/"


def _answer(description: str, schema: dict[str, Any] | None = None, mimetype: str = "application/json") -> dict[str, Any]:
    if schema is None:
        return {"description": description}
    return {"description": description, "content": {mimetype: {"schema": schema}}}


def _operation(
    summary: str,
    responses: dict[str, dict[str, Any]],
    *,
    body: type[BaseModel] | None = None,
    query: dict[str, str] | None = None,
    path: bool | tuple[str, ...] = False,
    errors: tuple[int, ...] = (),
) -> dict[str, Any]:
    operation: dict[str, Any] = {"summary": summary, "responses": dict(responses)}
    parameters: list[dict[str, Any]] = []
    for name in (("number",) if path else ()) if isinstance(path, bool) else path:
        parameters.append({"name": name, "in": "path", "required": True, "schema": {"type": "integer", "minimum": 1}})
    for name, kind in (query or {}).items():
        parameters.append({"name": name, "in": "query", "required": False, "schema": {"type": kind}})
    if parameters:
        operation["parameters"] = parameters
    if body is not None:
        schema = {"$ref": _REF + body.__name__}
        operation["requestBody"] = {"required": True, "content": {"application/json": {"schema": schema}}}
    for status in errors:
        operation["responses"][str(status)] = {"$ref": "#/components/responses/Error"}
    return operation


def _list(description: str) -> dict[str, dict[str, Any]]:
    return {"200": _answer(description, {"type": "array", "items": _OBJECT})}


def _one(description: str, status: str = "200") -> dict[str, dict[str, Any]]:
    return {status: _answer(description, _OBJECT)}


_DONE = {"204": _answer("Done.")}
_CHANGE = (400, 403, 413, 415, 422)
_BODIES: tuple[type[BaseModel], ...] = (
    bodies.PairBody,
    bodies.NodeBody,
    bodies.PipeBody,
    bodies.PipeChange,
    bodies.MeasureBody,
    bodies.DriveBody,
    bodies.MarkBody,
    bodies.EndBody,
    bodies.EncoderBody,
    bodies.ZeroBody,
    bodies.CalibrateBody,
    bodies.LandmarkChange,
    bodies.AnswerBody,
    bodies.ClockBody,
    bodies.Empty,
)


def _paths() -> dict[str, dict[str, Any]]:
    jpeg = {
        "200": _answer("The picture.", {"type": "string", "format": "binary"}, "image/jpeg"),
        "204": _answer("No picture now."),
    }
    kind = {"name": "kind", "in": "path", "required": True, "schema": {"enum": ["depth", "color"]}}
    stored = _operation(
        "The picture kept with the survey's chosen recording",
        {**jpeg, "204": _answer("No such picture was kept.")},
        path=True,
        errors=(404,),
    )
    stream = {"200": _answer("Events status, live, measurement, prompt and drive.", {"type": "string"}, "text/event-stream")}
    return {
        "/status": {"get": _operation("Cameras, survey, storage and clock", _one("The status."))},
        "/live": {"get": _operation("The live estimate of the best camera, or null", _one("The estimate."))},
        "/picture/{kind}.jpg": {
            "get": {
                **_operation("The newest picture", jpeg, query={"camera": "string"}),
                "parameters": [
                    kind,
                    {"name": "camera", "in": "query", "required": False, "schema": {"type": "string"}},
                ],
            }
        },
        "/cloud": {
            "get": _operation(
                "At most 3000 points in metres with the cylinder",
                _one("The cloud."),
                query={"survey_id": "integer"},
                errors=(404,),
            )
        },
        "/events": {"get": _operation("Live events, one stream per tab", stream, query={"tab": "string"}, errors=(422, 503))},
        "/nodes": {
            "get": _operation("All nodes", _list("The nodes.")),
            "post": _operation("Create a node", _one("The node.", "201"), body=bodies.NodeBody, errors=_CHANGE),
        },
        "/pipes": {
            "get": _operation("All pipes", _list("The pipes.")),
            "post": _operation("Create a pipe", _one("The pipe.", "201"), body=bodies.PipeBody, errors=(404, *_CHANGE)),
        },
        "/pipes/{number}": {
            "patch": _operation("Change a pipe", _one("The pipe."), body=bodies.PipeChange, path=True, errors=(404, *_CHANGE)),
            "delete": _operation("Delete a pipe", _DONE, body=bodies.Empty, path=True, errors=(404, 409, *_CHANGE)),
        },
        "/measure": {
            "post": _operation(
                "Start a measurement",
                _one("The survey's id.", "202"),
                body=bodies.MeasureBody,
                errors=(404, 409, 507, *_CHANGE),
            )
        },
        "/measure/cancel": {"post": _operation("Cancel the measurement", _DONE, body=bodies.Empty, errors=_CHANGE)},
        **_drive_paths(jpeg),
        **_door_paths(),
        "/surveys": {
            "get": _operation(
                "The newest surveys",
                _list("Summaries."),
                query={"pipe_id": "integer", "limit": "integer", "before": "integer"},
                errors=(422,),
            )
        },
        "/surveys/{number}": {
            "get": _operation("One survey", _one("The survey."), path=True, errors=(404,)),
            "delete": _operation(
                "Delete a survey; it can be restored", _DONE, body=bodies.Empty, path=True, errors=(404, 409, *_CHANGE)
            ),
        },
        "/surveys/{number}/picture/{kind}.jpg": {"get": {**stored, "parameters": [*stored["parameters"], kind]}},
        "/surveys/{number}/answer": {
            "post": _operation(
                "The operator's answers and verdict",
                _one("The survey."),
                body=bodies.AnswerBody,
                path=True,
                errors=(404, *_CHANGE),
            )
        },
        "/surveys/{number}/restore": {
            "post": _operation("Undo a deletion", _DONE, body=bodies.Empty, path=True, errors=(404, *_CHANGE))
        },
        "/clock": {"post": _operation("The browser offers its time", _DONE, body=bodies.ClockBody, errors=_CHANGE)},
        "/openapi.json": {"get": _operation("This document", {"200": _answer("OpenAPI 3.1.", _OBJECT)})},
    }


def _drive_paths(jpeg: dict[str, Any]) -> dict[str, dict[str, Any]]:
    what = {"name": "what", "in": "path", "required": True, "schema": {"enum": ["pause", "resume", "cancel"]}}
    steer = _operation("Steer the drive; cancel forgets it", _DONE, body=bodies.Empty, errors=(409, *_CHANGE))
    encoder = _one("The encoder with its calibration.")
    landmark = ("number", "landmark")
    return {
        "/drive": {
            "get": _operation("The drive under way, the CCTV and the tether", _one("The drive.")),
            "post": _operation(
                "Start a drive", _one("The survey's id.", "202"), body=bodies.DriveBody, errors=(404, 409, 507, *_CHANGE)
            ),
        },
        "/drive/{what}": {"post": {**steer, "parameters": [what]}},
        "/drive/mark": {
            "post": _operation(
                "Mark a landmark by hand", _one("The landmark.", "201"), body=bodies.MarkBody, errors=(409, *_CHANGE)
            )
        },
        "/drive/end": {
            "post": _operation(
                "The end node is reached: smooth and store",
                _one("The survey's id.", "202"),
                body=bodies.EndBody,
                errors=(409, *_CHANGE),
            )
        },
        "/drive/picture.jpg": {"get": _operation("The CCTV picture", jpeg, query={"overlay": "boolean"}, errors=(422,))},
        "/encoder": {
            "put": _operation("Counts per metre and direction", encoder, body=bodies.EncoderBody, errors=(409, *_CHANGE))
        },
        "/encoder/zero": {
            "post": _operation("The crawler stands at this chainage", encoder, body=bodies.ZeroBody, errors=(409, *_CHANGE))
        },
        "/encoder/calibrate": {
            "post": _operation("Two-point calibration", encoder, body=bodies.CalibrateBody, errors=(409, *_CHANGE))
        },
        "/surveys/{number}/map": {"get": _operation("The map of a drive", _one("The map."), path=True, errors=(404,))},
        "/surveys/{number}/landmarks/{landmark}/thumbnail.jpg": {
            "get": _operation("A landmark's picture", jpeg, path=landmark, errors=(404,))
        },
        "/surveys/{number}/landmarks/{landmark}": {
            "patch": _operation(
                "Confirm, reject, correct or note; the measured values stay",
                _one("The landmark."),
                body=bodies.LandmarkChange,
                path=landmark,
                errors=(404, *_CHANGE),
            )
        },
    }


def _door_paths() -> dict[str, dict[str, Any]]:
    control = _one("Who controls the box and who asks.")
    asked = {
        "ask": "Ask for the control",
        "grant": "Hand the control over to who asked",
        "refuse": "Keep the control",
        "release": "Give the control up, or ask no longer",
    }
    session = {"name": "session", "in": "path", "required": True, "schema": {"type": "string", "minLength": 8, "maxLength": 8}}
    return {
        "/session": {
            "get": _operation("The own session", _one("The session.")),
            "post": _operation("Pair by PIN", _one("The session."), body=bodies.PairBody, errors=(429, *_CHANGE)),
            "delete": _operation("Unpair", _DONE, body=bodies.Empty, errors=_CHANGE),
        },
        "/sessions": {"get": _operation("Who is paired", _list("The paired devices."))},
        "/sessions/{session}": {
            "delete": {**_operation("Send somebody away", _DONE, body=bodies.Empty, errors=_CHANGE), "parameters": [session]}
        },
        **{
            f"/control/{verb}": {"post": _operation(summary, control, body=bodies.Empty, errors=(409, *_CHANGE))}
            for verb, summary in asked.items()
        },
    }


@cache
def document() -> dict[str, Any]:
    """The whole document, JSON-ready; nobody may change it."""
    _, schemas = models_json_schema([(model, "validation") for model in _BODIES], ref_template=_REF + "{model}")
    fields = {"code": {"type": "string"}, "message": {"type": "string", "description": "one sentence for the operator"}}
    error = {
        "type": "object",
        "properties": {"error": {"type": "object", "properties": fields, "required": list(fields)}},
        "required": ["error"],
    }
    return {
        "openapi": "3.1.0",
        "info": {
            "title": "borescout",
            "version": "1",
            "description": "The box's own API, on its own network.",
        },
        "servers": [{"url": "/api/v1"}],
        "paths": _paths(),
        "components": {
            "schemas": {**schemas["$defs"], "Error": error},
            "responses": {"Error": _answer("Why not, in one sentence.", {"$ref": _REF + "Error"})},
        },
    }
