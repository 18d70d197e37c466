"""A survey's raw data on its page: how much there is, where to get it, or why there is none."""

from __future__ import annotations

from pathlib import Path

import pytest
from flask.testing import FlaskClient

from device.recorder.desk import GONE
from tests.browser.fake_device import FakeDevice
from web_ui.app import create_app


def test_the_page_links_to_the_files(device: FakeDevice, client: FlaskClient) -> None:
    number = device.add_survey(None, None, "top", "accept")
    page = client.get(f"/surveys/{number}").text
    address = f"/api/v1/surveys/{number}/recordings/1/1"
    assert f'href="{address}"' in page
    told = client.get(f"/api/v1/surveys/{number}/recordings").get_json()
    assert told["state"] == "kept"
    response = client.get(address)
    assert response.status_code == 200
    assert response.data == Path(device.raw or "").read_bytes()
    assert response.headers["Content-Disposition"].startswith("attachment")
    assert told["files"][0]["bytes"] == len(response.data)


def test_the_page_says_why_there_is_none(device: FakeDevice, client: FlaskClient) -> None:
    device.raw = None
    number = device.add_survey(None, None, "top", "accept")
    page = client.get(f"/surveys/{number}").text
    assert GONE in page
    assert "recordings/1/1" not in page


@pytest.mark.parametrize(
    "path", ["999/recordings", "999/recordings/1/1", "{}/recordings/1/2", "{}/recordings/1/%2e%2e%2f1", "{}/recordings/a/b"]
)
def test_what_is_not_there(device: FakeDevice, client: FlaskClient, path: str) -> None:
    number = device.add_survey(None, None, "top", "accept")
    assert client.get(f"/api/v1/surveys/{path.format(number)}").status_code == 404


def test_nobody_takes_raw_data_without_a_session(device: FakeDevice) -> None:
    number = device.add_survey(None, None, "top", "accept")
    stranger = create_app(device).test_client()  # type: ignore[arg-type]
    assert stranger.get(f"/api/v1/surveys/{number}/recordings").status_code == 401
    assert stranger.get(f"/api/v1/surveys/{number}/recordings/1/1").status_code == 401
