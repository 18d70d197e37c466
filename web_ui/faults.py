"""Every failure answered in words: JSON under /api, a page elsewhere, never a trace."""

import logging
from http import HTTPStatus

from flask import Flask, Response, jsonify, make_response, render_template, request
from pydantic import ValidationError
from werkzeug.exceptions import HTTPException

from device.errors import Busy, Closed, DeviceError, Forbidden, Invalid, NotFound, StorageFull

log = logging.getLogger(__name__)

_STATUS: tuple[tuple[type[DeviceError], int], ...] = (
    (Forbidden, 403),
    (NotFound, 404),
    (Busy, 409),
    (Invalid, 422),
    (Closed, 503),
    (StorageFull, 507),
)
_CODES = {
    400: "bad_request",
    401: "not_paired",
    403: "forbidden",
    404: "not_found",
    405: "method_not_allowed",
    409: "busy",
    413: "too_large",
    415: "wrong_content_type",
    422: "invalid",
    500: "internal",
    503: "unavailable",
    507: "storage_full",
}
_SENTENCES = {
    404: "There is nothing at this address.",
    405: "This address does not take that kind of request.",
    413: "The request is larger than 64 KB.",
}


def answer(status: int, message: str, code: str | None = None) -> Response:
    """The error as this caller reads it: JSON below /api, HTML for pages. `code` defaults to one named after `status`."""
    if request.path.startswith("/api/"):
        code = code or _CODES.get(status, HTTPStatus(status).phrase.lower().replace(" ", "_"))
        response = jsonify({"error": {"code": code, "message": message}})
    else:
        response = make_response(render_template("error.html", status=status, message=message))
    response.status_code = status
    return response


def sentence(error: ValidationError) -> str:
    """The first thing wrong with a body, in one sentence naming the field."""
    first = error.errors(include_url=False, include_context=False, include_input=False)[0]
    field = ".".join(str(part) for part in first["loc"])
    message = str(first["msg"]).removeprefix("Value error, ").rstrip(".")
    return f"{field}: {message}." if field else f"{message}."


def install(app: Flask) -> None:
    """Register the handlers on `app`."""

    @app.errorhandler(DeviceError)
    def device_error(error: DeviceError) -> Response:
        status = next((status for kind, status in _STATUS if isinstance(error, kind)), 500)
        if status == 500:
            log.error("the device refused a request", exc_info=error)
        return answer(status, str(error), error.code)

    @app.errorhandler(ValidationError)
    def bad_body(error: ValidationError) -> Response:
        return answer(422, sentence(error))

    @app.errorhandler(HTTPException)
    def http_error(error: HTTPException) -> Response:
        status = error.code or 500
        response = answer(status, _SENTENCES.get(status) or error.description or "The request failed.")
        allowed = getattr(error, "valid_methods", None)
        if allowed:
            response.headers["Allow"] = ", ".join(sorted(allowed))
        return response

    @app.errorhandler(Exception)
    def unexpected(error: Exception) -> Response:
        # The last net: the operator gets a sentence, the log gets the trace.
        log.error("request %s %s failed", request.method, request.path, exc_info=error)
        return answer(500, "Something went wrong inside the box; its log says what.")
