"""What every request must pass and every response carries.

The box has no name on the internet, so a request naming a foreign host is a DNS-rebinding page; one with a foreign `Origin` is
another site's page using the operator's browser. Both are refused before a handler runs.
"""

import ipaddress
import re
from collections.abc import Collection

from flask import Flask, Response, abort, request

MAX_BODY_BYTES = 64 * 1024

_HOST = re.compile(r"(?:\[(?P<v6>[0-9A-Fa-f:.]{2,45})\]|(?P<name>[A-Za-z0-9._-]{1,253}))(?::[0-9]{1,5})?", re.ASCII)
_LOCAL_SUFFIXES = (".local", ".lan", ".home.arpa", ".internal", ".localhost")
_CHANGES = frozenset({"POST", "PUT", "PATCH", "DELETE"})
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


def host_is_ours(host: str, extra: Collection[str] = ()) -> bool:
    """True for an IP address, a single-label or local-only name, or one of `extra` (lower case, without port)."""
    match = _HOST.fullmatch(host)
    if match is None:
        return False
    if match["v6"] is not None:
        return _is_address(match["v6"])
    name = match["name"].lower().rstrip(".")
    return name in extra or (bool(name) and "." not in name) or name.endswith(_LOCAL_SUFFIXES) or _is_address(name)


def _is_address(text: str) -> bool:
    try:
        ipaddress.ip_address(text)
    except ValueError:
        return False
    return True


def install(app: Flask, allowed_hosts: Collection[str]) -> None:
    """Put the checks in front of every route of `app` and the security headers on every answer."""
    extra = frozenset(host.lower() for host in allowed_hosts)

    @app.before_request
    def check_request() -> None:
        host = request.environ.get("HTTP_HOST", "")
        if not host_is_ours(host, extra):
            abort(400, "This box is not known by that name; open it by its address.")
        origin = request.headers.get("Origin")
        if origin is not None and origin.lower() != f"{request.scheme}://{host}".lower():
            abort(403, "Requests from another site's page are refused.")
        if request.headers.get("Sec-Fetch-Site") == "cross-site" and request.path.startswith("/api/"):
            abort(403, "Requests from another site's page are refused.")
        if request.method in _CHANGES and request.mimetype != "application/json":
            abort(415, "Send changes as application/json.")

    @app.after_request
    def add_headers(response: Response) -> Response:
        for name, value in _HEADERS.items():
            response.headers.setdefault(name, value)
        if request.endpoint != "static":
            response.headers.setdefault("Cache-Control", "no-store")
        return response
