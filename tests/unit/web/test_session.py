"""Sessions over HTTP: what answers without one, what each change must carry, who may change, and how pairing refuses."""

import re

import pytest
from flask import Flask
from flask.testing import FlaskClient
from werkzeug.routing import Rule

from tests.browser.fake_device import FakeDevice
from tests.pairing import PIN, paired_client
from web_ui import access

METHODS = ("GET", "HEAD", "POST", "PUT", "PATCH", "DELETE", "OPTIONS")


def rules(app: Flask) -> list[Rule]:
    found = list(app.url_map.iter_rules())
    assert len(found) > 30
    return found


def address(rule: Rule) -> str:
    """A path that the rule matches."""

    def value(found: re.Match[str]) -> str:
        kind, arguments = found[1] or "string", found[2] or ""
        length = re.search(r"length=(\d+)", arguments)
        if kind == "any":
            return arguments.split(",")[0].strip(" '\"")
        return {"int": "1", "float": "1.0", "path": "style.css"}.get(kind, "0" * int(length[1] if length else 1))

    return re.sub(r"<(?:(\w+)(?:\(([^)]*)\))?:)?\w+>", value, rule.rule)


def pair(client: FlaskClient, pin: str = PIN, **more: object) -> tuple[int, str]:
    response = client.post("/api/v1/session", json={"pin": pin, **more})
    return response.status_code, response.get_json().get("error", {}).get("code", "")


# --- Without a session ---


def test_every_route_is_listed_as_public_or_refused_in_every_method(app: Flask, device: FakeDevice) -> None:
    """A new route is private unless it is named in web_ui.access."""
    stranger = app.test_client()
    listed = {(address(rule), method) for rule in rules(app) if rule.endpoint in access.PUBLIC for method in rule.methods or ()}
    for rule in rules(app):
        for method in METHODS:
            if (address(rule), method) in listed:
                continue
            response = stranger.open(address(rule), method=method, json={})
            assert response.status_code == 401, (rule, method)
            assert response.headers["WWW-Authenticate"]
            assert "Set-Cookie" not in response.headers
    assert device.calls == []


def test_the_list_names_only_what_is_there(app: Flask) -> None:
    endpoints = {rule.endpoint for rule in rules(app)}
    assert endpoints >= access.PUBLIC
    assert endpoints >= access.WATCHERS_MAY
    assert not access.PUBLIC & access.WATCHERS_MAY


def test_what_is_public_answers_a_stranger_and_tells_nothing_of_the_box(app: Flask) -> None:
    stranger = app.test_client()
    assert stranger.get("/api/v1/session").get_json() == {"paired": False}
    assert stranger.get("/api/v1/openapi.json").status_code == 200
    assert "PIN" in stranger.get("/pair").text
    for path in ("/static/style.css", "/favicon.ico", "/robots.txt"):
        assert stranger.get(path).status_code == 200
    assert stranger.get("/static/../app.py").status_code in (401, 404)


def test_a_stranger_gets_the_pairing_page_in_place_of_any_other(app: Flask) -> None:
    stranger = app.test_client()
    for path in ("/", "/drive", "/surveys/1", "/nothing"):
        response = stranger.get(path)
        assert response.status_code == 401
        assert 'id="pin"' in response.text
        assert "Measure</a>" not in response.text
    assert stranger.get("/api/v1/nothing").get_json()["error"]["code"] == "not_paired"


# --- Pairing ---


def test_the_session_is_a_cookie_that_no_script_and_no_other_site_sees(app: Flask) -> None:
    response = app.test_client().post("/api/v1/session", json={"pin": PIN})
    cookie = response.headers["Set-Cookie"]
    assert cookie.startswith("borescout=")
    for word in ("HttpOnly", "SameSite=Strict", "Path=/", "Max-Age="):
        assert word in cookie
    value = cookie.split(";")[0].split("=")[1]
    assert len(value) >= 43
    assert value not in response.text


def test_wrong_pins_wait_longer_and_longer_and_say_how_long(app: Flask) -> None:
    client = app.test_client()
    assert [pair(client, "000000") for _ in range(3)] == [(403, "wrong_pin")] * 3
    response = client.post("/api/v1/session", json={"pin": PIN})
    assert response.status_code == 429
    assert response.headers["Retry-After"] == "2"
    assert "2 s" in response.get_json()["error"]["message"]
    assert pair(client, "12345")[0] == 422
    elsewhere = {"REMOTE_ADDR": "10.0.0.7"}
    assert client.post("/api/v1/session", json={"pin": PIN}, environ_base=elsewhere).status_code == 200


def test_pairing_again_makes_the_old_cookie_worthless(app: Flask) -> None:
    client = app.test_client()
    first = client.post("/api/v1/session", json={"pin": PIN}).headers["Set-Cookie"].split(";")[0]
    assert client.get("/api/v1/status").status_code == 200
    assert pair(client)[0] == 200
    assert client.get("/api/v1/status").status_code == 200
    assert app.test_client(use_cookies=False).get("/api/v1/status", headers={"Cookie": first}).status_code == 401


def test_leaving_ends_the_session_on_the_server(app: Flask) -> None:
    client = paired_client(app)
    assert client.get("/api/v1/status").status_code == 200
    response = client.delete("/api/v1/session", json={})
    assert response.status_code == 204
    assert "Max-Age=0" in response.headers["Set-Cookie"]
    assert client.get("/api/v1/status").status_code == 401


def test_a_phone_is_called_by_its_kind_and_address_or_as_it_likes(app: Flask) -> None:
    agent = {"User-Agent": "Mozilla/5.0 (Linux; Android 14; Pixel 8) Mobile"}
    at = {"REMOTE_ADDR": "10.42.0.23"}
    client = app.test_client()
    assert client.post("/api/v1/session", json={"pin": PIN}, headers=agent, environ_base=at).get_json()["name"] == (
        "Android phone 23"
    )
    assert pair(client, name="Ann's phone")[0] == 200
    assert client.get("/api/v1/session").get_json()["name"] == "Ann's phone"
    assert pair(client, name="a\nb")[0] == 422


# --- Changes ---


@pytest.mark.parametrize("csrf", [None, "", "0" * 64, "é"])
def test_a_change_without_its_token_is_refused(app: Flask, device: FakeDevice, csrf: str | None) -> None:
    client = paired_client(app)
    right = client.environ_base.pop("HTTP_X_CSRF_TOKEN")
    headers = {} if csrf is None else {"X-CSRF-Token": csrf}
    for rule in rules(app):
        for method in (rule.methods or set()) & {"POST", "PUT", "PATCH", "DELETE"}:
            if rule.endpoint not in access.PUBLIC:
                response = client.open(address(rule), method=method, json={}, headers=headers)
                assert response.status_code == 403, (rule, method)
    assert device.calls == []
    assert client.post("/api/v1/nodes", json={"name": "A"}, headers={"X-CSRF-Token": right}).status_code == 201


def test_the_token_of_another_session_is_no_good(app: Flask) -> None:
    one, other = paired_client(app), paired_client(app)
    headers = {"X-CSRF-Token": other.environ_base["HTTP_X_CSRF_TOKEN"]}
    assert one.post("/api/v1/nodes", json={"name": "A"}, headers=headers).status_code == 403


def test_a_watcher_sees_everything_and_changes_nothing(app: Flask, device: FakeDevice) -> None:
    controller, watcher = paired_client(app, "Ann"), paired_client(app, "Ben")
    for rule in rules(app):
        for method in (rule.methods or set()) & {"POST", "PUT", "PATCH", "DELETE"}:
            if rule.endpoint not in access.PUBLIC | access.WATCHERS_MAY:
                response = watcher.open(address(rule), method=method, json={})
                assert response.status_code == 403, (rule, method)
                assert "Ann controls the box" in response.get_json()["error"]["message"]
    assert device.calls == []
    assert watcher.get("/api/v1/status").status_code == 200
    assert watcher.post("/api/v1/clock", json={"epoch_ms": 1_780_000_000_000}).status_code == 204
    assert controller.post("/api/v1/nodes", json={"name": "A"}).status_code == 201


def test_control_is_asked_for_and_handed_over(app: Flask) -> None:
    controller, watcher = paired_client(app, "Ann"), paired_client(app, "Ben")
    assert watcher.post("/api/v1/control/ask", json={}).get_json()["request"]["name"] == "Ben"
    assert watcher.post("/api/v1/control/grant", json={}).status_code == 403
    assert controller.post("/api/v1/control/refuse", json={}).status_code == 200
    assert watcher.post("/api/v1/control/ask", json={}).status_code == 409
    other = paired_client(app, "Cid")
    assert other.post("/api/v1/control/ask", json={}).status_code == 200
    assert controller.post("/api/v1/control/grant", json={}).get_json()["controller"]["name"] == "Cid"
    assert controller.post("/api/v1/nodes", json={"name": "A"}).status_code == 403
    assert other.post("/api/v1/nodes", json={"name": "A"}).status_code == 201


def test_the_controller_sends_somebody_away(app: Flask) -> None:
    controller, watcher = paired_client(app, "Ann"), paired_client(app, "Ben")
    numbers = {row["name"]: row["id"] for row in watcher.get("/api/v1/sessions").get_json()}
    assert watcher.delete(f"/api/v1/sessions/{numbers['Ann']}", json={}).status_code == 403
    assert controller.delete(f"/api/v1/sessions/{numbers['Ben']}", json={}).status_code == 204
    assert watcher.get("/api/v1/status").status_code == 401
    assert controller.delete("/api/v1/sessions/00000000", json={}).status_code == 404
