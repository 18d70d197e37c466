"""The OpenAPI document of the box: one line for each API route; paths, parameters and security are read from the application.

A new route gets a line in ROUTES (a test walks the URL map). Bodies and query strings are described by the models of
`web_ui.bodies` that check them, answers by those of `web_ui.answers`, and who may ask by `web_ui.access`.
"""

import re
from dataclasses import dataclass
from functools import cache
from typing import Any

from pydantic import BaseModel, TypeAdapter
from pydantic.json_schema import models_json_schema
from werkzeug.routing import Map, Rule

from web_ui import access, answers, bodies
from web_ui import inspection_bodies as wanted
from web_ui import site_bodies as sites

_PREFIX = "/api/v1"
_REF = "#/components/schemas/"
_PARAMETER = re.compile(r"<(?:(?P<kind>\w+)(?:\((?P<arguments>[^)]*)\))?:)?(?P<name>\w+)>")
_CHANGES = frozenset({"POST", "PUT", "PATCH", "DELETE"})
JPEG, PNG = "image/jpeg", "image/png"
EVENTS = "text/event-stream"
FILE = "application/octet-stream"
MCAP = "application/octet-stream"


@dataclass(frozen=True)
class Told:
    """What is told of a route. `answer` is a model, a type made of models, JPEG, PNG, EVENTS, MCAP, or None: 204, no body.

    `errors` are the statuses that the route adds to those that its kind has anyway (see `_errors`).
    """

    summary: str
    answer: Any
    body: type[BaseModel] | None = None
    query: type[BaseModel] | None = None
    status: int = 200
    errors: tuple[int, ...] = ()


ROUTES: dict[str, Told] = {
    "session.state": Told("The own session", answers.access.PairedSession | answers.access.SessionState),
    "session.pair": Told(
        "Pair by PIN; the cookie is the session", answers.access.PairedSession, bodies.PairBody, errors=(403, 429)
    ),
    "session.leave": Told("Unpair", None, bodies.Empty),
    "session.devices": Told("Who is paired", list[answers.access.PairedDevice]),
    "session.send_away": Told("End somebody's session", None, bodies.Empty),
    "session.ask": Told("Ask for the control", answers.access.ControlState, bodies.Empty, errors=(409,)),
    "session.grant": Told("Hand the control over to who asked", answers.access.ControlState, bodies.Empty),
    "session.refuse": Told("Keep the control", answers.access.ControlState, bodies.Empty),
    "session.release": Told("Give the control up, or ask no longer", answers.access.ControlState, bodies.Empty),
    "api.status": Told("Cameras, survey, storage and clock", answers.box.Status),
    "api.live": Told("The live estimate of the best camera, or null", answers.diameter.Live | None),
    "api.picture": Told("The newest picture", JPEG, query=bodies.PictureQuery),
    "api.cloud": Told(
        "The point cloud of this moment or of a survey", answers.diameter.Cloud, query=bodies.CloudQuery, errors=(404,)
    ),
    "api.measure": Told("Start a measurement", answers.surveys.Begun, bodies.MeasureBody, status=202, errors=(404, 409, 507)),
    "api.cancel": Told("Cancel the measurement", None, bodies.Empty),
    "api.drive": Told("The drive under way, the CCTV and the tether", answers.landmarks.Drive),
    "api.start_drive": Told("Start a drive", answers.surveys.Begun, bodies.DriveBody, status=202, errors=(404, 409, 507)),
    "api.steer_drive": Told("Steer the drive; cancel forgets it", None, bodies.Empty, errors=(409,)),
    "api.mark": Told("Mark a landmark by hand", answers.landmarks.Landmark, bodies.MarkBody, status=201, errors=(409, 507)),
    "api.end_drive": Told(
        "The end node is reached: smooth and store", answers.surveys.Begun, bodies.EndBody, status=202, errors=(409,)
    ),
    "api.drive_picture": Told("The CCTV picture", JPEG, query=bodies.DrivePictureQuery),
    "api.encoder": Told("Counts per metre and direction", answers.landmarks.Encoder, bodies.EncoderBody, errors=(409,)),
    "api.zero_encoder": Told("The crawler stands at this chainage", answers.landmarks.Encoder, bodies.ZeroBody, errors=(409,)),
    "api.calibrate_encoder": Told("Two-point calibration", answers.landmarks.Encoder, bodies.CalibrateBody, errors=(409,)),
    "api.survey_map": Told("The map of a drive", answers.landmarks.Map),
    "api.thumbnail": Told("A landmark's picture", JPEG, query=bodies.ThumbnailQuery),
    "api.change_landmark": Told(
        "Confirm, reject, correct or note; the measured values stay", answers.landmarks.Landmark, bodies.LandmarkChange
    ),
    "api.surveys": Told("The newest surveys", list[answers.surveys.Summary], query=bodies.SurveyQuery),
    "api.survey": Told("One survey", answers.surveys.Survey),
    "api.survey_picture": Told("The picture kept with the survey's chosen recording", JPEG),
    "api.answer": Told("The operator's answers and verdict", answers.surveys.Survey, bodies.AnswerBody),
    "recordings.listed": Told("What raw data there is of a survey", answers.surveys.Recordings),
    "recordings.file": Told("A file of a survey's raw data (MCAP)", MCAP),
    "api.delete_survey": Told("Delete a survey; it can be restored", None, bodies.Empty, errors=(409,)),
    "api.restore_survey": Told("Undo a deletion", None, bodies.Empty),
    "api.clock": Told("The browser offers its time", None, bodies.ClockBody),
    "box.health": Told("Everything about the box itself, and what the operator should know of it", answers.box.Health),
    "box.lamp": Told("The lamp", answers.box.Lamp, errors=(404,)),
    "box.set_lamp": Told("How bright the lamp is, or that it is automatic", answers.box.Lamp, bodies.LampBody, errors=(404,)),
    "alone.told": Told("Logging by itself, and the journal of what happened", answers.box.Alone),
    "alone.switch": Told("Log by itself, or not", answers.box.Autonomy, bodies.AloneBody, errors=(507,)),
    "alone.looked": Told("Somebody has read the journal up to an entry", None, bodies.LookedBody, errors=(507,)),
    "anomaly.state": Told("The anomaly survey and its camera; whoever asks wakes it", answers.anomaly.Anomaly),
    "anomaly.scan": Told(
        "Scan the present view of the stereo camera", answers.surveys.Begun, bodies.ScanBody, status=202, errors=(404, 409, 507)
    ),
    "anomaly.cancel": Told("Cancel the scan", None, bodies.Empty),
    "anomaly.picture": Told("The newest picture of the stereo camera", JPEG),
    "anomaly.found": Told("What a scan found", answers.anomaly.AnomalyFound),
    "anomaly.along": Told("What the scans of one go tell of the pipe together", answers.anomaly.Along),
    "anomaly.view": Told("The reference picture of a scan, without or with the deviations", JPEG),
    "anomaly.wall": Told("The unrolled wall of a scan in colours", PNG),
    "calibration.state": Told("The calibration of two plain cameras", answers.anomaly.Calibration, errors=(404,)),
    "calibration.begin": Told("Begin to look for a board", None, bodies.BoardBody, errors=(404, 409)),
    "calibration.steer": Told(
        "Calibrate with what was shown, forget it, or use what came out", None, bodies.Empty, errors=(404,)
    ),
    "calibration.picture": Told("What a camera sees of the board", JPEG, errors=(404,)),
    "calibration.board": Told("A board to print at 100 %", FILE, query=bodies.BoardQuery),
    "inspecting.inspections": Told("All inspections", list[answers.inspections.InspectionRow], query=wanted.InspectionQuery),
    "inspecting.begin": Told(
        "Begin an inspection; it takes the pipe's surveys that belong to none",
        answers.inspections.Inspection,
        wanted.InspectionBody,
        status=201,
        errors=(404,),
    ),
    "inspecting.inspection": Told("One inspection as it would go out", answers.inspections.Inspection, errors=(422,)),
    "inspecting.update": Told(
        "Change what an inspection is called by", answers.inspections.Inspection, wanted.InspectionChange
    ),
    "inspecting.delete": Told("Delete an inspection; it can be restored, its surveys stay", None, bodies.Empty),
    "inspecting.restore": Told("Undo a deletion", answers.inspections.Inspection, bodies.Empty),
    "inspecting.join": Told("A survey belongs to an inspection", answers.inspections.Inspection, wanted.JoinBody),
    "inspecting.part": Told("A survey belongs to it no longer", answers.inspections.Inspection, bodies.Empty),
    "inspecting.edit": Told("The observations as they shall be", answers.inspections.Inspection, wanted.ObservationsBody),
    "inspecting.undo": Told("Take the last edit of the observations back", answers.inspections.Inspection, bodies.Empty),
    "inspecting.compare": Told(
        "What is new, gone, grown and the same", answers.inspections.Compared, query=wanted.CompareQuery, errors=(422,)
    ),
    "inspecting.photo": Told("A photo of an inspection", JPEG, errors=(422,)),
    "inspecting.export": Told("A file to take home", FILE, query=wanted.ExportQuery),
    "inspecting.codes": Told("The observation codes", list[answers.inspections.ObservationCode]),
    "site.described": Told("Name and reference system of the site", answers.site.Site),
    "site.update_site": Told("Change the site's name or reference system", answers.site.Site, sites.SiteChange),
    "site.nodes": Told("All nodes", list[answers.site.Node]),
    "site.create_node": Told("Create a node", answers.site.Node, sites.NodeBody, status=201),
    "site.check_node": Told("May a node be called so?", answers.site.Judged, query=sites.NodeQuery),
    "site.update_node": Told("Change a node", answers.site.Node, sites.NodeChange),
    "site.delete_node": Told("Delete a node that nothing refers to", None, bodies.Empty),
    "site.pipes": Told("All pipes", list[answers.site.Pipe]),
    "site.create_pipe": Told("Create a pipe", answers.site.Pipe, sites.PipeBody, status=201, errors=(404,)),
    "site.check_pipe": Told("May a pipe be called so?", answers.site.Judged, query=sites.PipeQuery),
    "site.update_pipe": Told("Change a pipe", answers.site.Pipe, sites.PipeChange),
    "site.delete_pipe": Told("Delete a pipe; it can be restored", None, bodies.Empty, errors=(409,)),
    "site.restore_pipe": Told("Undo a deletion", answers.site.Pipe, bodies.Empty),
    "site.import_pipes": Told("Add the pipes of a list", answers.site.Imported, sites.PipeListBody, status=201),
    "structure.state": Told("The structure survey under way and its sensors", answers.structure.Structure),
    "structure.begin": Told("Map a chamber", answers.surveys.Begun, bodies.StructureBody, status=202, errors=(404, 409, 507)),
    "structure.end": Told("All has been seen: keep the map", answers.surveys.Begun, bodies.Empty, status=202, errors=(409,)),
    "structure.cancel": Told("Forget the structure survey under way", None, bodies.Empty),
    "structure.survey_map": Told("The map of a chamber", answers.structure.StructureMap),
    "structure.file": Told("The map as a JSON graph, PLY or glTF", FILE, errors=(422,)),
    "api.document": Told("This document", dict[str, Any]),
    "events.stream": Told(
        "Events status, live, measurement, prompt, drive, structure, anomaly and control, one stream per tab",
        EVENTS,
        query=bodies.EventsQuery,
        errors=(503,),
    ),
}


def document(routes: Map) -> dict[str, Any]:
    """The whole document, JSON-ready, of an application with these routes."""
    paths: dict[str, dict[str, Any]] = {}
    for rule in sorted(routes.iter_rules(), key=lambda rule: rule.rule):
        path = _PARAMETER.sub(lambda found: f"{{{found['name']}}}", rule.rule)
        for method in sorted((rule.methods or set()) - {"HEAD", "OPTIONS"}):
            paths.setdefault(path, {})[method.lower()] = _operation(rule, method)
    return {
        "openapi": "3.1.0",
        "info": {
            "title": "borescout",
            "version": "1",
            "description": "The box's own API, on its own network. Pair with POST /api/v1/session: the answer's cookie is the"
            " session, its `csrf` goes with each change as X-CSRF-Token. One device controls the box, the others only read.",
        },
        "servers": [{"url": "/"}],
        "paths": paths,
        "components": {
            "schemas": _schemas(),
            "responses": {"Error": _json("Why not, in one sentence.", {"$ref": _REF + "Error"})},
            "securitySchemes": {
                "session": {"type": "apiKey", "in": "cookie", "name": "borescout"},
                "csrf": {"type": "apiKey", "in": "header", "name": "X-CSRF-Token"},
            },
        },
    }


def _operation(rule: Rule, method: str) -> dict[str, Any]:
    private = {"session": [], "csrf": []} if method in _CHANGES else {"session": []}
    security = [] if rule.endpoint in access.PUBLIC else [private]
    if not rule.rule.startswith(_PREFIX):
        return {"operationId": f"{rule.endpoint} {rule.rule}", "security": security, **_page(rule)}
    told = ROUTES[rule.endpoint]
    operation: dict[str, Any] = {
        "operationId": rule.endpoint,
        "summary": told.summary,
        "security": security,
        "responses": _success(told),
    }
    parameters = _path_parameters(rule) + _query_parameters(told.query)
    if parameters:
        operation["parameters"] = parameters
    if told.body is not None:
        schema = {"$ref": _REF + told.body.__name__}
        operation["requestBody"] = {"required": True, "content": {"application/json": {"schema": schema}}}
    for status in sorted(_errors(rule, method, told)):
        operation["responses"][str(status)] = {"$ref": "#/components/responses/Error"}
    return operation


def _errors(rule: Rule, method: str, told: Told) -> set[int]:
    """A foreign host name or page; no session; a change that is not allowed or not understood; what is not there."""
    errors = {400, 403, *told.errors}
    if rule.endpoint not in access.PUBLIC:
        errors.add(401)
    if method in _CHANGES:
        errors |= {413, 415, 422}
    if told.query is not None:
        errors.add(422)
    if rule.arguments:
        errors.add(404)
    return errors


def _success(told: Told) -> dict[str, Any]:
    if told.answer is None:
        return {"204": {"description": "Done."}}
    if told.answer in (JPEG, PNG):
        picture = {"description": "The picture.", "content": {told.answer: {"schema": {"type": "string", "format": "binary"}}}}
        return {"200": picture, "204": {"description": "There is no picture."}}
    if told.answer == MCAP:
        return {"200": {"description": "The file.", "content": {MCAP: {"schema": {"type": "string", "format": "binary"}}}}}
    if told.answer == FILE:
        return {"200": {"description": "The file.", "content": {"*/*": {"schema": {"type": "string", "format": "binary"}}}}}
    if told.answer == EVENTS:
        return {"200": {"description": "The stream.", "content": {EVENTS: {"schema": {"type": "string"}}}}}
    return {str(told.status): _json(told.summary + ".", TypeAdapter(told.answer).json_schema(ref_template=_REF + "{model}"))}


def _json(description: str, schema: dict[str, Any]) -> dict[str, Any]:
    schema.pop("$defs", None)  # they are among the components
    return {"description": description, "content": {"application/json": {"schema": schema}}}


def _page(rule: Rule) -> dict[str, Any]:
    """A page of the browser, a script, a picture: whatever it is, it is no part of the API."""
    kind = "text/html" if rule.endpoint.startswith("pages.") and "." not in rule.rule else "*/*"
    content = {kind: {"schema": {"type": "string"}}}
    page: dict[str, Any] = {
        "summary": f"For browsers: {rule.rule}",
        "responses": {
            "2XX": {"description": "The page or file.", "content": content},
            "4XX": {"description": "Why not, as a page.", "content": {"text/html": {"schema": {"type": "string"}}}},
        },
    }
    parameters = _path_parameters(rule)
    return {**page, "parameters": parameters} if parameters else page


def _path_parameters(rule: Rule) -> list[dict[str, Any]]:
    found = []
    for match in _PARAMETER.finditer(rule.rule):
        arguments = match["arguments"] or ""
        limits = {key: int(number) for key, number in re.findall(r"(\w+)=(\d+)", arguments)}
        schema: dict[str, Any] = {"type": "string", "minLength": 1}
        if match["kind"] == "int":
            schema = {"type": "integer", "minimum": limits.get("min", 0), "maximum": limits.get("max", bodies.MAX_ID)}
        elif match["kind"] == "any":
            schema = {"type": "string", "enum": [word.strip(" \"'") for word in arguments.split(",")]}
        elif "length" in limits:
            schema |= {"minLength": limits["length"], "maxLength": limits["length"]}
        found.append({"name": match["name"], "in": "path", "required": True, "schema": schema})
    return found


def _query_parameters(query: type[BaseModel] | None) -> list[dict[str, Any]]:
    if query is None:
        return []
    found = []
    for name, schema in query.model_json_schema()["properties"].items():
        kinds = [kind for kind in schema.pop("anyOf", ()) if kind != {"type": "null"}]  # a query has no null
        shown = {
            key: value for key, value in {**schema, **(kinds[0] if kinds else {})}.items() if key not in ("title", "default")
        }
        found.append({"name": name, "in": "query", "required": False, "schema": shown})
    return found


@cache
def _schemas() -> dict[str, Any]:
    """Every model that a route names, with those inside it."""
    made: dict[str, Any] = {}
    for told in ROUTES.values():
        if told.answer not in (None, JPEG, PNG, EVENTS, MCAP):
            schema = TypeAdapter(told.answer).json_schema(mode="serialization", ref_template=_REF + "{model}")
            made |= schema.get("$defs", {})
            if isinstance(told.answer, type) and issubclass(told.answer, BaseModel):
                made[told.answer.__name__] = {key: value for key, value in schema.items() if key != "$defs"}
    bodies_told = {told.body for told in ROUTES.values() if told.body is not None}
    models = sorted({*bodies_told, answers.errors.Error}, key=lambda model: model.__name__)
    _, described = models_json_schema([(model, "validation") for model in models], ref_template=_REF + "{model}")
    return made | described["$defs"]
