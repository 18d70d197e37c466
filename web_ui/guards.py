"""What every request must pass and every response carries.

The box has no name on the internet, so a request naming a foreign host is a DNS-rebinding page; one with a foreign `Origin` is
another site's page using the operator's browser. Both are refused before anything else is looked at. Then comes the session,
without which only the routes of `web_ui.access` answer, its CSRF token, and the control of the box.
"""

import ipaddress
import re
import socket
from collections.abc import Callable, Collection
from http import HTTPStatus
from typing import TYPE_CHECKING

from flask import Flask, Response, abort, g, make_response, render_template, request

from web_ui import access, faults

if TYPE_CHECKING:
    from device.access import Access

MAX_BODY_BYTES = 64 * 1024
COOKIE = "borescout"
CSRF_HEADER = "X-CSRF-Token"

_HOST = re.compile(r"(?:\[(?P<v6>[0-9A-Fa-f:.]{2,45})\]|(?P<name>[A-Za-z0-9._-]{1,253}))(?::[0-9]{1,5})?", re.ASCII)
_READS = frozenset({"GET", "HEAD", "OPTIONS"})
_POLICY = ("default-src 'self'", "object-src 'none'", "base-uri 'none'", "form-action 'self'", "frame-ancestors 'none'")
_HEADERS = {
    "Content-Security-Policy": "; ".join(_POLICY),
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    # "no-referrer" would turn the Origin of our own forms into "null" and lock them out.
    "Referrer-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Permissions-Policy": "camera=(), microphone=(), geolocation=(), payment=(), usb=()",
}


def own_names() -> frozenset[str]:
    """The names of this machine, lower case: on itself, on its network, and by mDNS."""
    name = socket.gethostname().lower().split(".")[0]
    return frozenset({"localhost", name, f"{name}.local"})


def own_address(text: str) -> bool:
    """Whether an interface of this machine has that address just now: then the way there begins where it ends."""
    try:
        ip = ipaddress.ip_address(text)
    except ValueError:
        return False
    if ip.is_loopback:
        return True
    if ip.is_unspecified or ip.is_multicast:
        return False
    family = socket.AF_INET if ip.version == 4 else socket.AF_INET6
    with socket.socket(family, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect((text, 9))  # sends nothing
        except OSError:
            return False
        return ipaddress.ip_address(str(probe.getsockname()[0])) == ip


def host_is_ours(host: str, names: Collection[str], is_own_address: Callable[[str], bool] = own_address) -> bool:
    """True for an address of this box or one of `names` (lower case, without port)."""
    match = _HOST.fullmatch(host)
    if match is None:
        return False
    if match["v6"] is not None:
        return is_own_address(match["v6"])
    name = match["name"].lower().rstrip(".")
    return bool(name) and (name in names or is_own_address(name))


def install(app: Flask, door: "Access", allowed_hosts: Collection[str]) -> None:
    """Put the checks in front of every route of `app` and the security headers on every answer.

    A request that comes through has its session in `g.session`: None on public routes for who is not paired.
    """
    names = own_names() | {host.lower() for host in allowed_hosts}

    @app.before_request
    def check_request() -> Response | None:
        g.session = None
        host = request.environ.get("HTTP_HOST", "")
        if request.endpoint not in access.ANY_HOST and not host_is_ours(host, names):
            abort(400, "This box is not known by that name; open it by its address.")
        origin = request.headers.get("Origin")
        if origin is not None and origin.lower() != f"{request.scheme}://{host}".lower():
            abort(403, "Requests from another site's page are refused.")
        if request.headers.get("Sec-Fetch-Site") == "cross-site" and request.path.startswith("/api/"):
            abort(403, "Requests from another site's page are refused.")
        token = request.cookies.get(COOKIE, "")
        g.session = door.session(token)
        if request.endpoint in access.PUBLIC:
            return None if request.method in _READS else _as_json()
        if g.session is None:
            return refuse_unpaired()
        if request.method in _READS:
            return None
        _as_json()
        if not door.csrf_fits(token, request.headers.get(CSRF_HEADER, "")):
            abort(403, "This page is out of date: load it again.")
        if request.endpoint is not None and request.endpoint not in access.WATCHERS_MAY:
            door.may_change(g.session)
        return None

    @app.after_request
    def add_headers(response: Response) -> Response:
        for name, value in _HEADERS.items():
            response.headers.setdefault(name, value)
        if request.endpoint != "static":
            response.headers.setdefault("Cache-Control", "no-store")
        return response

    @app.context_processor
    def shown() -> dict[str, object]:
        session = g.get("session")
        token = request.cookies.get(COOKIE, "")
        return {"mine": session, "csrf": None if session is None else door.csrf(token)}


def refuse_unpaired() -> Response:
    """Where a session is needed: the sentence for a program; for a person the pairing page, in place of the one asked for."""
    message = "Pair this device with the PIN on the box's label first."
    if request.path.startswith("/api/"):
        response = faults.answer(HTTPStatus.UNAUTHORIZED, message, "not_paired")
    else:
        response = make_response(render_template("pair.html"), HTTPStatus.UNAUTHORIZED)
    response.headers["WWW-Authenticate"] = 'Pairing realm="borescout"'
    return response


def _as_json() -> None:
    """No form of another site can send JSON."""
    if request.mimetype != "application/json":
        abort(415, "Send changes as application/json.")
