"""The pages: server-rendered, with modules that bring them to life."""

from typing import TYPE_CHECKING

from flask import Blueprint, render_template, send_from_directory
from flask.typing import ResponseReturnValue

from web_ui import bodies, site_bodies, wording

if TYPE_CHECKING:
    from device.daemon import Device

_PAGE = 50


def blueprint(device: "Device") -> Blueprint:
    """The pages' routes, answering from `device`."""
    pages = Blueprint("pages", __name__)
    pages.add_app_template_filter(wording.millimetres, "mm")
    pages.add_app_template_filter(wording.percent, "percent")
    pages.add_app_template_filter(wording.when, "when")
    pages.add_app_template_filter(wording.position, "position")
    pages.add_app_template_filter(wording.reason, "reason")
    pages.add_app_template_filter(wording.pipe_name, "pipe_name")
    pages.add_app_template_filter(wording.journal_icon, "journal_icon")
    pages.add_app_template_filter(wording.metres, "metres")
    pages.add_app_template_filter(wording.megabytes, "megabytes")
    pages.add_app_template_filter(wording.span_m, "span_m")
    pages.add_app_template_filter(wording.duration, "duration")

    @pages.get("/")
    def measure() -> str:
        query = bodies.read_query(bodies.MeasureQuery)
        second = device.survey(query.second) if query.second is not None else None
        return render_template(
            "measure.html",
            pipes=device.places.pipes(),
            nodes=device.places.nodes(),
            chosen=query.pipe,
            second=second,
            materials=site_bodies.MATERIALS,
            shapes=site_bodies.SHAPES,
        )

    @pages.get("/drive")
    def drive() -> str:
        newest = next(iter(device.surveys(None, 1, None)), None)
        return render_template(
            "drive.html",
            drive=device.drive.state(),
            lamp=device.status()["lamp"],
            pipes=device.places.pipes(),
            nodes=device.places.nodes(),
            chosen=bodies.read_query(bodies.MeasureQuery).pipe,
            cut_off=newest if newest is not None and newest.get("state") == "interrupted" else None,
            classes=wording.CLASSES,
            materials=site_bodies.MATERIALS,
            shapes=site_bodies.SHAPES,
        )

    @pages.get("/surveys")
    def history() -> str:
        query = bodies.read_query(bodies.SurveyQuery)
        deleted = bodies.read_query(bodies.DeletedQuery).deleted
        rows = device.surveys(query.pipe_id, _PAGE + 1, query.before)
        older = rows[_PAGE - 1]["id"] if len(rows) > _PAGE else None
        return render_template(
            "history.html",
            surveys=rows[:_PAGE],
            pipes=device.places.pipes(),
            chosen=query.pipe_id,
            older=older,
            newest=query.before is None,
            deleted=deleted,
        )

    @pages.get(f"/surveys/<int(min=1, max={bodies.MAX_ID}):number>")
    def result(number: int) -> str:
        survey, recording = device.survey(number), device.recordings.of(number)
        if survey["kind"] == "anomaly":
            along = device.anomaly.along(number)
            return render_template("anomaly_result.html", survey=survey, along=along, recording=recording)
        if survey["kind"] == "landmarks":
            drive = device.drive.map(number)
            return render_template("map.html", survey=survey, map=drive, classes=wording.CLASSES, recording=recording)
        if survey["kind"] == "structure":
            found = device.structure.map(number)
            return render_template("structure_map.html", survey=survey, map=found, recording=recording)
        kept = next((kind for kind in ("color", "depth") if device.survey_picture(number, kind) is not None), None)
        return render_template("result.html", survey=survey, picture=kept, questions=wording.QUESTIONS, recording=recording)

    @pages.get("/pair")
    def pair() -> str:
        return render_template("pair.html")

    @pages.get("/favicon.ico")
    def favicon() -> ResponseReturnValue:
        return send_from_directory("static", "favicon.svg", mimetype="image/svg+xml", max_age=86400)

    @pages.get("/robots.txt")
    def robots() -> ResponseReturnValue:
        return "User-agent: *\nDisallow: /\n", 200, {"Content-Type": "text/plain; charset=utf-8"}

    return pages
