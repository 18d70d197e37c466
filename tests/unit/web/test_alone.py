"""The page and the API of what happened while nobody looked."""

import pytest
from flask.testing import FlaskClient

from tests.browser.fake_alone import line
from tests.browser.fake_device import FakeDevice


def test_it_is_switched_on_and_off(client: FlaskClient, device: FakeDevice) -> None:
    assert client.put("/api/v1/alone", json={"on": True}).get_json()["state"] == "waiting"
    assert client.get("/api/v1/status").get_json()["autonomy"]["on"] is True
    assert 'aria-pressed="true"' in client.get("/alone").text
    assert client.put("/api/v1/alone", json={"on": False}).get_json()["state"] == "off"
    assert not device.logs_by_itself


@pytest.mark.parametrize("body", [{}, {"on": 1}, {"on": "yes"}, {"on": True, "off": False}])
def test_what_is_neither_on_nor_off_is_refused(client: FlaskClient, device: FakeDevice, body: dict[str, object]) -> None:
    assert client.put("/api/v1/alone", json=body).status_code == 422
    assert not device.logs_by_itself


def test_a_map_says_that_the_box_drove_by_itself_and_what_it_continues(client: FlaskClient, device: FakeDevice) -> None:
    number = device.drive.add()
    assert "by itself" not in client.get(f"/surveys/{number}").text
    device.drive.map(number)["settings"] = {"by_itself": True, "continues": 4}
    page = client.get(f"/surveys/{number}").text
    assert "The box drove this survey by itself" in page
    assert 'href="/surveys/4"' in page


def test_the_journal_is_told_in_sentences_newest_first_and_remembers_what_was_read(
    client: FlaskClient, device: FakeDevice
) -> None:
    assert "Nothing yet." in client.get("/alone").text
    device.journal = (
        line(1, "on"),
        line(2, "begin", 7, "pipe_seen", "2026-05-01T10:00:00Z"),
        line(3, "end", 7, "power_cut", "2026-05-01T10:02:00Z"),
        line(4, "cut", 7),
        line(5, "on"),
    )
    page = client.get("/alone").text
    sentences = [
        "The power was cut: the box was not",
        "Survey 7 ended. The power was cut.",
        "Survey 7 began. A pipe came into view.",
    ]
    places = [page.index(text) for text in sentences]
    assert places == sorted(places)
    assert "1 May 2026, 10:02 UTC" in page
    assert "time unknown" in page
    told = client.get("/api/v1/alone").get_json()
    assert (told["unsafe_shutdowns"], told["autonomy"]["news"]) == (1, 3)
    assert client.post("/api/v1/alone/looked", json={"entry": 5}).status_code == 204
    assert client.get("/api/v1/alone").get_json()["autonomy"]["news"] == 0
    assert "I have read this" not in client.get("/alone").text
