"""Pairing, the session and the control of the box, under /api/v1."""

import math
import re
from typing import TYPE_CHECKING

from flask import Blueprint, Response, g, jsonify, request

from device.access.sessions import LIFE_S
from device.errors import TooSoon, WrongPin
from web_ui import bodies, faults, guards

if TYPE_CHECKING:
    from device.access import Access, Session

_SESSION = "<string(length=8):session>"
# In this order: an Android phone also says Linux, an iPad says Macintosh or iPad.
_KINDS = (
    ("iPhone", "iPhone"),
    ("iPad", "iPad"),
    ("Android", "Android phone"),
    ("CrOS", "Chromebook"),
    ("Windows", "Windows computer"),
    ("Macintosh", "Mac"),
    ("Linux", "Linux computer"),
)


def blueprint(door: "Access") -> Blueprint:
    """The routes of the door."""
    session = Blueprint("session", __name__, url_prefix="/api/v1")

    @session.get("/session")
    def state() -> Response:
        return jsonify(_mine(door, g.session, _token()))

    @session.post("/session")
    def pair() -> Response:
        body = bodies.read(bodies.PairBody)
        address = request.remote_addr or "unknown"
        try:
            paired = door.pair(body.pin, address, body.name or _kind(address), _token())
        except (WrongPin, TooSoon) as error:
            response = faults.answer(403 if isinstance(error, WrongPin) else 429, str(error), error.code)
            if error.wait_s > 0:
                response.headers["Retry-After"] = str(math.ceil(error.wait_s))
            return response
        response = jsonify(_mine(door, paired.session, paired.token))
        response.set_cookie(guards.COOKIE, paired.token, max_age=int(LIFE_S), path="/", httponly=True, samesite="Strict")
        return response

    @session.delete("/session")
    def leave() -> Response:
        bodies.read(bodies.Empty)
        door.end(g.session.id)
        response = Response(status=204)
        response.delete_cookie(guards.COOKIE, path="/", httponly=True, samesite="Strict")
        return response

    @session.get("/sessions")
    def devices() -> Response:
        return jsonify(door.devices())

    @session.delete(f"/sessions/{_SESSION}")
    def send_away(session: str) -> Response:
        bodies.read(bodies.Empty)
        door.end(session)
        return Response(status=204)

    @session.post("/control/ask")
    def ask() -> Response:
        bodies.read(bodies.Empty)
        return jsonify(door.ask(g.session))

    @session.post("/control/grant")
    def grant() -> Response:
        bodies.read(bodies.Empty)
        return jsonify(door.grant(g.session))

    @session.post("/control/refuse")
    def refuse() -> Response:
        bodies.read(bodies.Empty)
        return jsonify(door.refuse(g.session))

    @session.post("/control/release")
    def release() -> Response:
        bodies.read(bodies.Empty)
        return jsonify(door.release(g.session))

    return session


def _token() -> str:
    return request.cookies.get(guards.COOKIE, "")


def _mine(door: "Access", session: "Session | None", token: str) -> dict[str, object]:
    """What somebody may know of the own session."""
    if session is None:
        return {"paired": False}
    return {"paired": True, "id": session.id, "name": session.name, "csrf": door.csrf(token), **door.state()}


def _kind(address: str) -> str:
    """What to call who did not say: "iPhone 23", after the last part of its address."""
    agent = request.headers.get("User-Agent", "")
    kind = next((name for sign, name in _KINDS if sign in agent), "Device")
    last = re.split(r"[.:]", address)[-1]
    return f"{kind} {last}".strip()
