"""What every request must pass and every answer carries."""

import socket
from collections.abc import Iterator

import pytest
from flask import Flask
from flask.testing import FlaskClient

from tests.browser.fake_device import FakeDevice
from tests.pairing import paired_client
from web_ui.app import create_app
from web_ui.guards import host_is_ours, own_address, own_names


@pytest.fixture(scope="module")
def device() -> Iterator[FakeDevice]:
    fake = FakeDevice()
    fake.add_survey(None, None, "top", "accept")
    yield fake
    fake.close()


@pytest.fixture(scope="module")
def app(device: FakeDevice) -> Flask:
    return create_app(device, allowed_hosts=["Box.Example.com"])  # type: ignore[arg-type]  # a fake with the facade's methods


@pytest.fixture(scope="module")
def client(app: Flask) -> FlaskClient:
    return paired_client(app)


NAMES = {"localhost", "borescout", "borescout.local", "box.lan"}
ADDRESSES = {"127.0.0.1", "10.42.0.1", "::1", "fe80::1"}


def ours(host: str) -> bool:
    return host_is_ours(host, NAMES, lambda text: text in ADDRESSES)


@pytest.mark.parametrize(
    "host",
    [
        "localhost",
        "localhost:8000",
        "127.0.0.1",
        "10.42.0.1:80",
        "[::1]",
        "[fe80::1]:8080",
        "borescout",
        "Borescout.local.",
        "BOX.lan:80",
    ],
)
def test_own_names_and_addresses_are_ours(host: str) -> None:
    assert ours(host)


FOREIGN = [
    "",
    "evil.example",
    "evil.example:80",
    "127.0.0.1.evil.example",
    "borescout.local.evil.example",
    "[1.2.3.4.5]",
    "10.42.0.2",
    "evil.local",
    "printer",
]
BROKEN = ["a b", "a/b", "[::1", "[zz]", "x:99999999", "a@b", ".", "host\u0661"]


@pytest.mark.parametrize("host", FOREIGN + BROKEN)
def test_foreign_and_broken_names_are_not(host: str) -> None:
    assert not ours(host)


def test_this_machine_knows_itself() -> None:
    assert {"localhost", socket.gethostname().lower().split(".")[0]} <= own_names()
    assert own_address("127.0.0.1")
    assert own_address("::1")
    for foreign in ("192.0.2.1", "2001:db8::1", "0.0.0.0", "::", "224.0.0.1", "255.255.255.255", "localhost", "1.2.3.4.5", ""):
        assert not own_address(foreign), foreign


@pytest.mark.parametrize("path", ["/", "/surveys", "/api/v1/status", "/static/style.css", "/pair", "/nothing"])
def test_a_request_for_another_host_is_refused(client: FlaskClient, path: str) -> None:
    assert client.get(path, headers={"Host": "evil.example"}).status_code == 400
    assert client.get(path, headers={"Host": "box.example.com"}).status_code == (404 if path == "/nothing" else 200)


@pytest.mark.parametrize(
    "origin", ["http://evil.example", "null", "https://localhost", "http://localhost:81", "http://localhost.evil.example"]
)
@pytest.mark.parametrize("method", ["GET", "POST"])
def test_another_sites_page_is_refused(client: FlaskClient, device: FakeDevice, origin: str, method: str) -> None:
    before = len(device.calls)
    path = "/api/v1/status" if method == "GET" else "/api/v1/measure"
    response = client.open(path, method=method, json={} if method == "POST" else None, headers={"Origin": origin})
    assert response.status_code == 403
    assert response.get_json()["error"]["code"] == "forbidden"
    assert len(device.calls) == before


def test_the_own_page_is_let_in(client: FlaskClient) -> None:
    assert client.post("/api/v1/nodes", json={"name": "A"}, headers={"Origin": "http://localhost"}).status_code == 201
    headers = {"Origin": "http://127.0.0.1:8000", "Host": "127.0.0.1:8000"}
    assert client.post("/api/v1/nodes", json={"name": "B"}, headers=headers).status_code == 201


def test_a_cross_site_request_without_origin_is_refused(client: FlaskClient) -> None:
    assert client.get("/api/v1/status", headers={"Sec-Fetch-Site": "cross-site"}).status_code == 403
    assert client.get("/", headers={"Sec-Fetch-Site": "cross-site"}).status_code == 200, "a link to the box may be followed"


@pytest.mark.parametrize(
    "content_type", [None, "text/plain", "application/x-www-form-urlencoded", "multipart/form-data; boundary=x"]
)
@pytest.mark.parametrize(
    ("method", "path"),
    [("POST", "/measure"), ("POST", "/measure/cancel"), ("PATCH", "/pipes/1"), ("DELETE", "/surveys/1"), ("POST", "/clock")],
)
def test_a_change_must_be_json(client: FlaskClient, method: str, path: str, content_type: str | None) -> None:
    response = client.open(f"/api/v1{path}", method=method, data=b"{}", content_type=content_type)
    assert response.status_code == 415
    assert response.get_json()["error"]["code"] == "wrong_content_type"


@pytest.mark.parametrize(
    "path", ["/", "/surveys", "/surveys/1", "/api/v1/status", "/static/js/dom.js", "/nothing", "/api/v1/nothing"]
)
def test_every_answer_carries_the_security_headers(client: FlaskClient, path: str) -> None:
    headers = client.get(path).headers
    policy = headers["Content-Security-Policy"]
    assert "default-src 'self'" in policy
    assert "frame-ancestors 'none'" in policy
    assert "unsafe" not in policy
    assert headers["X-Content-Type-Options"] == "nosniff"
    assert headers["Referrer-Policy"] == "same-origin"
    assert "Access-Control-Allow-Origin" not in headers


def test_errors_outside_the_api_are_pages(client: FlaskClient) -> None:
    response = client.get("/nothing<script>")
    assert response.status_code == 404
    assert response.mimetype == "text/html"
    assert "<script>" not in response.text.replace('<script type="module"', "")
    assert client.get("/surveys/12345").status_code == 404
