"""What phones find out about the hotspot: it is of use, there is no portal, and nothing of the box is told."""

import pytest
from flask import Flask
from flask.testing import FlaskClient

from web_ui.captive import NO_CONTENT, PROBES


@pytest.fixture
def phone(app: Flask) -> FlaskClient:
    """Just joined: no session."""
    return app.test_client()


@pytest.mark.parametrize(
    ("host", "path", "body"),
    [
        ("captive.apple.com", "/hotspot-detect.html", "<HTML><HEAD><TITLE>Success</TITLE></HEAD><BODY>Success</BODY></HTML>"),
        ("www.msftconnecttest.com", "/connecttest.txt", "Microsoft Connect Test"),
        ("www.msftncsi.com", "/ncsi.txt", "Microsoft NCSI"),
        ("detectportal.firefox.com", "/success.txt", "success\n"),
        ("nmcheck.gnome.org", "/check_network_status.txt", "NetworkManager is online\n"),
    ],
)
def test_the_makers_word_is_said_byte_for_byte(phone: FlaskClient, host: str, path: str, body: str) -> None:
    answer = phone.get(path, headers={"Host": host})
    assert (answer.status_code, answer.text) == (200, body)
    assert "Set-Cookie" not in answer.headers


@pytest.mark.parametrize("host", ["connectivitycheck.gstatic.com", "clients3.google.com", "connect.rom.miui.com"])
@pytest.mark.parametrize("path", NO_CONTENT)
def test_android_gets_nothing_as_it_should(phone: FlaskClient, host: str, path: str) -> None:
    answer = phone.get(path, headers={"Host": host})
    assert (answer.status_code, answer.data) == (204, b"")


def test_nothing_is_redirected_so_that_no_portal_opens(phone: FlaskClient) -> None:
    for path in (*PROBES, *NO_CONTENT):
        assert phone.get(path, headers={"Host": "captive.apple.com"}).status_code in (200, 204)


def test_under_a_foreign_name_there_is_nothing_else(phone: FlaskClient) -> None:
    for path in ("/", "/drive", "/api/v1/status", "/static/style.css"):
        assert phone.get(path, headers={"Host": "captive.apple.com"}).status_code in (400, 403, 421), path
    assert phone.post("/generate_204", headers={"Host": "captive.apple.com"}).status_code in (400, 403, 405, 415)
