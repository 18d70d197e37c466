"""The page and the API of the box itself: health and lamp."""

import pytest
from flask.testing import FlaskClient

from tests.browser.fake_device import FakeDevice


def test_health_is_the_devices_and_its_page_carries_it(client: FlaskClient, device: FakeDevice) -> None:
    device.concerns = ("under_voltage",)
    health = client.get("/api/v1/health").get_json()
    assert health["prompts"][0]["code"] == "under_voltage"
    page = client.get("/health").text
    assert "The box gets too little voltage." in page
    assert 'id="lamp-level"' in page


def test_the_lamp_is_set_and_read(client: FlaskClient) -> None:
    assert client.put("/api/v1/lamp", json={"level": 0.25}).get_json()["level"] == 0.25
    assert client.get("/api/v1/lamp").get_json()["automatic"] is False
    assert client.put("/api/v1/lamp", json={"automatic": True}).get_json()["automatic"] is True


@pytest.mark.parametrize("body", [{"level": 1.01}, {"level": -0.1}, {"level": "half"}, {"automatic": 1}, {"light": 1}, {}])
def test_what_no_lamp_can_do_is_refused(client: FlaskClient, body: dict[str, object]) -> None:
    assert client.put("/api/v1/lamp", json=body).status_code == 422


def test_a_box_without_a_lamp_says_so_and_shows_none(client: FlaskClient, device: FakeDevice) -> None:
    device.lamp_state = None
    assert client.get("/api/v1/lamp").status_code == 404
    assert client.put("/api/v1/lamp", json={"level": 0.5}).status_code == 404
    assert 'id="lamp"' not in client.get("/health").text
