"""Inspections: what the utility takes home, its pages and its part of the API."""

from typing import TYPE_CHECKING

from flask import Blueprint, Response, jsonify, render_template

from web_ui import bodies
from web_ui import inspection_bodies as wanted

if TYPE_CHECKING:
    from device.daemon import Device

_ID = f"<int(min=1, max={bodies.MAX_ID}):number>"
_SURVEY = f"<int(min=1, max={bodies.MAX_ID}):survey>"
_API = "/api/v1/inspections"


def blueprint(device: "Device") -> Blueprint:
    """The routes, answering from `device`."""
    inspecting = Blueprint("inspecting", __name__)

    @inspecting.get("/inspections")
    def page() -> str:
        query = bodies.read_query(wanted.InspectionQuery)
        deleted = bodies.read_query(bodies.DeletedQuery).deleted
        return render_template(
            "inspections.html",
            inspections=device.inspections.all(query.pipe_id),
            pipes=device.places.pipes(),
            chosen=query.pipe_id,
            deleted=deleted,
        )

    @inspecting.get(f"/inspections/{_ID}")
    def one_page(number: int) -> str:
        inspection = device.inspections.get(number)
        others = [one for one in device.inspections.all(inspection["pipe_id"]) if one["id"] != number]
        surveys = list(device.surveys(inspection["pipe_id"], 50, None))
        recorded = {one["survey_id"]: device.recordings.of(one["survey_id"])["files"] for one in inspection["surveys"]}
        return render_template(
            "inspection.html",
            inspection=inspection,
            others=others,
            surveys=surveys,
            raw={survey: files for survey, files in recorded.items() if files},
            codes=device.inspections.codes(),
            formats=wanted.FORMATS,
        )

    @inspecting.get(f"/inspections/{_ID}/compare")
    def compare_page(number: int) -> str:
        older = bodies.read_query(wanted.CompareQuery).older
        return render_template(
            "compare.html",
            found=device.inspections.compare(older, number),
            newer=device.inspections.get(number),
            older=device.inspections.get(older),
        )

    @inspecting.get(_API)
    def inspections() -> Response:
        return jsonify(device.inspections.all(bodies.read_query(wanted.InspectionQuery).pipe_id))

    @inspecting.post(_API)
    def begin() -> tuple[Response, int]:
        body = bodies.read(wanted.InspectionBody).model_dump(exclude_unset=True)
        return jsonify(device.inspections.begin(body.pop("pipe_id"), body)), 201

    @inspecting.get(f"{_API}/{_ID}")
    def inspection(number: int) -> Response:
        return jsonify(device.inspections.get(number))

    @inspecting.patch(f"{_API}/{_ID}")
    def update(number: int) -> Response:
        return jsonify(device.inspections.update(number, bodies.read(wanted.InspectionChange).model_dump(exclude_unset=True)))

    @inspecting.delete(f"{_API}/{_ID}")
    def delete(number: int) -> Response:
        bodies.read(bodies.Empty)
        device.inspections.delete(number)
        return Response(status=204)

    @inspecting.post(f"{_API}/{_ID}/restore")
    def restore(number: int) -> Response:
        bodies.read(bodies.Empty)
        return jsonify(device.inspections.restore(number))

    @inspecting.put(f"{_API}/{_ID}/surveys/{_SURVEY}")
    def join(number: int, survey: int) -> Response:
        return jsonify(device.inspections.join(number, survey, bodies.read(wanted.JoinBody).station_m))

    @inspecting.delete(f"{_API}/{_ID}/surveys/{_SURVEY}")
    def part(number: int, survey: int) -> Response:
        bodies.read(bodies.Empty)
        return jsonify(device.inspections.part(number, survey))

    @inspecting.put(f"{_API}/{_ID}/observations")
    def edit(number: int) -> Response:
        body = bodies.read(wanted.ObservationsBody)
        return jsonify(device.inspections.edit(number, [one.model_dump() for one in body.observations], body.by))

    @inspecting.post(f"{_API}/{_ID}/observations/undo")
    def undo(number: int) -> Response:
        bodies.read(bodies.Empty)
        return jsonify(device.inspections.undo(number))

    @inspecting.get(f"{_API}/{_ID}/compare")
    def compare(number: int) -> Response:
        return jsonify(device.inspections.compare(bodies.read_query(wanted.CompareQuery).older, number))

    @inspecting.get(f"{_API}/{_ID}/photos/<string(maxlength=120):name>")
    def photo(number: int, name: str) -> Response:
        jpeg = device.inspections.photo(number, name)
        if jpeg is None:
            return Response(status=204)
        return Response(jpeg, mimetype="image/jpeg", headers={"Cache-Control": "no-store"})

    @inspecting.get(f"{_API}/{_ID}/export/<any({', '.join(wanted.FORMATS)}):name>")
    def export(number: int, name: str) -> Response:
        query = bodies.read_query(wanted.ExportQuery)
        data, file, mime = device.inspections.export(number, name, query.language, query.imperial)
        heading = {"Content-Disposition": f'attachment; filename="{file}"', "Cache-Control": "no-store"}
        return Response(data, content_type=mime, headers=heading)

    @inspecting.get("/api/v1/observation-codes")
    def codes() -> Response:
        return jsonify(device.inspections.codes())

    return inspecting
