"""The Flask application in front of one device."""

from collections.abc import Collection
from typing import TYPE_CHECKING, Any

from flask import Flask
from flask.json.provider import DefaultJSONProvider

from device.json_text import dumps
from web_ui import (
    alone,
    anomaly,
    api,
    box,
    calibration,
    captive,
    events,
    faults,
    guards,
    inspecting,
    pages,
    recordings,
    session,
    site,
    structure,
)

if TYPE_CHECKING:
    from device.daemon import Device


class _PlainJson(DefaultJSONProvider):
    """Answers in the device's own JSON: no NaN or infinity, which browsers refuse to read."""

    def dumps(self, obj: Any, **kwargs: Any) -> str:
        return dumps(obj)


def create_app(device: "Device", *, allowed_hosts: Collection[str] = (), stream_cap: int = events.STREAM_CAP) -> Flask:
    """The pages and the API of `device`.

    `allowed_hosts` are names by which the box may be called, besides its own and its addresses; `stream_cap` bounds the live
    streams open at a time. The caller keeps the device and closes it.
    """
    app = Flask(__name__)
    app.json = _PlainJson(app)
    app.config["MAX_CONTENT_LENGTH"] = guards.MAX_BODY_BYTES
    app.jinja_env.trim_blocks = True
    app.jinja_env.lstrip_blocks = True
    faults.install(app)
    guards.install(app, device.access, allowed_hosts)
    app.register_blueprint(session.blueprint(device.access))
    app.register_blueprint(api.blueprint(device))
    app.register_blueprint(events.blueprint(device, stream_cap))
    app.register_blueprint(recordings.blueprint(device))
    app.register_blueprint(pages.blueprint(device))
    app.register_blueprint(box.blueprint(device))
    app.register_blueprint(alone.blueprint(device))
    app.register_blueprint(anomaly.blueprint(device))
    app.register_blueprint(calibration.blueprint(device))
    app.register_blueprint(inspecting.blueprint(device))
    app.register_blueprint(site.blueprint(device))
    app.register_blueprint(structure.blueprint(device))
    app.register_blueprint(captive.blueprint())
    return app
