"""How tests and benchmarks come through the door: one PIN, one way to pair, for every kind of client."""

from __future__ import annotations

import http.client
import json
import re
from dataclasses import dataclass, field
from typing import Any

from flask import Flask
from flask.testing import FlaskClient

PIN = "123456"
COOKIE = "borescout"
CSRF = "X-CSRF-Token"


@dataclass(frozen=True)
class Pass:
    """What a paired client sends: ``headers`` with every request (the CSRF token does no harm where it is not needed)."""

    cookie: str
    csrf: str
    headers: dict[str, str] = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "headers", {"Cookie": f"{COOKIE}={self.cookie}", CSRF: self.csrf})


def pair(port: int, host: str = "127.0.0.1", pin: str = PIN, name: str = "", source: str = "") -> Pass:
    """Pair with the box that is served at (host, port); ``source`` is the address to come from."""
    connection = http.client.HTTPConnection(host, port, timeout=30, source_address=(source, 0) if source else None)
    try:
        connection.request(
            "POST", "/api/v1/session", json.dumps({"pin": pin, "name": name}), {"Content-Type": "application/json"}
        )
        answer = connection.getresponse()
        text = answer.read()
        assert answer.status == 200, f"pairing was answered with {answer.status}: {text.decode()[:300]}"
        return _pass(answer.getheader("Set-Cookie", ""), json.loads(text))
    finally:
        connection.close()


def ask(
    port: int, paired: Pass | None, method: str, path: str, body: Any = None, *, patience_s: float = 30.0
) -> tuple[int, Any]:
    """Status and answer (parsed where it is JSON, else bytes) of one request on a connection of its own."""
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=patience_s)
    try:
        headers = {"Content-Type": "application/json", **({} if paired is None else paired.headers)}
        connection.request(method, path, None if body is None else json.dumps(body), headers)
        answer = connection.getresponse()
        data = answer.read()
        return answer.status, json.loads(data) if "json" in answer.getheader("Content-Type", "") else data
    finally:
        connection.close()


def paired_client(app: Flask, name: str = "") -> FlaskClient:
    """A test client of ``app`` that is paired. It sends its cookie under any host name, as a browser would not."""
    answer = app.test_client().post("/api/v1/session", json={"pin": PIN, "name": name})
    assert answer.status_code == 200, answer.text
    client = app.test_client(use_cookies=False)
    for header, value in _pass(answer.headers["Set-Cookie"], answer.get_json()).headers.items():
        client.environ_base["HTTP_" + header.upper().replace("-", "_")] = value
    return client


def browser_cookie(one: Pass, root: str) -> Any:
    """The session as a cookie for Playwright's ``context.add_cookies``."""
    return {"name": COOKIE, "value": one.cookie, "url": root, "httpOnly": True, "sameSite": "Strict"}


def _pass(cookie: str, body: dict[str, Any]) -> Pass:
    found = re.match(rf"{COOKIE}=([^;]+);", cookie)
    assert found, f"no session came: {cookie!r}"
    return Pass(found[1], body["csrf"])
