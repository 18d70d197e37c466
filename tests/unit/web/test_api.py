"""The JSON API over a fake device: every route, what it refuses, and in what words."""

import json
from typing import Any

import pytest
from flask.testing import FlaskClient

from tests.browser.fake_device import FakeDevice
from tests.unit.web.asking import error, pipe, send


def test_status_and_live_are_the_devices(client: FlaskClient, device: FakeDevice) -> None:
    status = client.get("/api/v1/status")
    assert status.status_code == 200
    assert status.get_json()["cameras"][0]["state"] == "up"
    assert client.get("/api/v1/live").get_json()["level"] == "good"
    device.scene = "lost"
    assert client.get("/api/v1/live").get_json() is None


@pytest.mark.parametrize("kind", ["depth", "color"])
def test_pictures_are_jpeg_and_never_kept(client: FlaskClient, device: FakeDevice, kind: str) -> None:
    response = client.get(f"/api/v1/picture/{kind}.jpg")
    assert response.mimetype == "image/jpeg"
    assert response.data[:2] == b"\xff\xd8"
    assert response.headers["Cache-Control"] == "no-store"
    device.scene = "lost"
    response = client.get(f"/api/v1/picture/{kind}.jpg")
    assert response.status_code == 204
    assert response.data == b""
    assert error(client.get(f"/api/v1/picture/{kind}.jpg?camera=nobody"))[:2] == (404, "not_found")


@pytest.mark.parametrize("kind", ["depth", "color"])
def test_a_survey_has_the_pictures_that_were_kept(client: FlaskClient, device: FakeDevice, kind: str) -> None:
    number = device.add_survey(None, None, "top", "accept")
    response = client.get(f"/api/v1/surveys/{number}/picture/{kind}.jpg")
    assert (response.status_code, response.mimetype) == (200, "image/jpeg")
    assert response.data == device.survey_picture(number, kind)
    device.kept = ()
    response = client.get(f"/api/v1/surveys/{number}/picture/{kind}.jpg")
    assert (response.status_code, response.data) == (204, b"")
    assert error(client.get(f"/api/v1/surveys/999/picture/{kind}.jpg"))[:2] == (404, "not_found")
    assert error(client.get(f"/api/v1/surveys/{number}/picture/infrared.jpg"))[0] == 404


def test_other_pictures_do_not_exist(client: FlaskClient) -> None:
    for path in ("/picture/infrared.jpg", "/picture/depth.png", "/picture/../status", "/nothing"):
        assert error(client.get(f"/api/v1{path}"))[0] == 404


def test_nodes_and_pipes_from_creation_to_deletion(client: FlaskClient) -> None:
    start = send(client, "/nodes", {"name": " MH 14 "}).get_json()
    assert start["name"] == "MH 14"
    number = pipe(client, name="MH 14 - MH 15", start_node=start["id"], material="concrete", reference_dn=400)
    assert [row["name"] for row in client.get("/api/v1/pipes").get_json()] == ["MH 14 - MH 15"]
    assert [row["name"] for row in client.get("/api/v1/nodes").get_json()] == ["MH 14"]
    changed = send(client, f"/pipes/{number}", {"reference_dn": 300}, "PATCH").get_json()
    assert changed["reference_dn"] == 300
    assert changed["material"] == "concrete", "a field that was not sent must stay"
    assert send(client, f"/pipes/{number}", method="DELETE").status_code == 204
    assert client.get("/api/v1/pipes").get_json() == []
    assert error(send(client, f"/pipes/{number}", method="DELETE"))[:2] == (404, "not_found")
    assert error(send(client, f"/pipes/{number}", {"note": ""}, "PATCH"))[0] == 404


@pytest.mark.parametrize(
    ("body", "field"),
    [
        ({}, "name"),
        ({"name": ""}, "name"),
        ({"name": "   "}, "name"),
        ({"name": "x" * 81}, "name"),
        ({"name": "a\u0000b"}, "name"),
        ({"name": "a\nb"}, "name"),
        ({"name": 7}, "name"),
        ({"name": None}, "name"),
        ({"name": "P", "material": "cheese"}, "material"),
        ({"name": "P", "shape": "square"}, "shape"),
        ({"name": "P", "reference_dn": "400"}, "reference_dn"),
        ({"name": "P", "reference_dn": 49}, "reference_dn"),
        ({"name": "P", "reference_dn": 1e99}, "reference_dn"),
        ({"name": "P", "reference_dn": True}, "reference_dn"),
        ({"name": "P", "start_node": 2**63}, "start_node"),
        ({"name": "P", "start_node": 0}, "start_node"),
        ({"name": "P", "note": "x" * 2001}, "note"),
        ({"name": "P", "note": "bell\u0007"}, "note"),
        ({"name": "P", "id": 3}, "id"),
        ({"name": "P", "__class__": "x"}, "__class__"),
    ],
)
def test_a_bad_pipe_is_refused_in_one_sentence(client: FlaskClient, body: dict[str, Any], field: str) -> None:
    status, code, message = error(send(client, "/pipes", body))
    assert (status, code) == (422, "invalid")
    assert message.startswith(f"{field}: ")
    assert message.endswith(".")
    assert "\n" not in message
    assert client.get("/api/v1/pipes").get_json() == []


@pytest.mark.parametrize(
    "body",
    [
        b"{",
        b"[]",
        b"7",
        b"null",
        b'"text"',
        b"[" * 5000,
        b'{"name": "P", ' * 300,
        b"\xff\xfe",
        b'{"name": "\\ud800"}',
        b'{"name": NaN}',
    ],
)
def test_a_hostile_body_is_refused_in_one_sentence(client: FlaskClient, body: bytes) -> None:
    response = client.post("/api/v1/pipes", data=body, content_type="application/json")
    status, code, message = error(response)
    assert (status, code) == (422, "invalid")
    assert "\n" not in message
    assert len(message) < 300


def test_a_body_is_bounded(client: FlaskClient) -> None:
    body = json.dumps({"name": "P", "note": "x" * 70_000})
    assert error(client.post("/api/v1/pipes", data=body, content_type="application/json"))[:2] == (413, "too_large")


def test_measuring_starts_once_and_can_be_cancelled(client: FlaskClient, device: FakeDevice) -> None:
    device.seconds = 5
    number = pipe(client)
    response = send(client, "/measure", {"pipe_id": number, "position": "middle", "frames": 20})
    assert response.status_code == 202
    assert response.get_json()["survey_id"] > 0
    assert device.calls == [("measure", (number, "middle", 20, None))]
    assert error(send(client, "/measure")) == (409, "busy", "A measurement is already running.")
    assert send(client, "/measure/cancel").status_code == 204


@pytest.mark.parametrize(
    "body",
    [
        {"pipe_id": "1"},
        {"pipe_id": -1},
        {"position": "sideways"},
        {"frames": 0},
        {"frames": 501},
        {"frames": 1.5},
        {"survey_id": 2**70},
        {"speed": 3},
    ],
)
def test_a_bad_measurement_is_refused(client: FlaskClient, device: FakeDevice, body: dict[str, Any]) -> None:
    assert error(send(client, "/measure", body))[:2] == (422, "invalid")
    assert device.calls == []


def test_what_the_device_refuses_is_told_in_its_words(client: FlaskClient, device: FakeDevice) -> None:
    assert error(send(client, "/measure", {"pipe_id": 99})) == (404, "not_found", "There is no pipe 99.")
    device.scene = "lost"
    assert error(send(client, "/measure"))[:2] == (422, "invalid")


def test_surveys_are_listed_shown_answered_deleted_and_restored(client: FlaskClient, device: FakeDevice) -> None:
    mine = pipe(client)
    first = device.add_survey(None, mine, "top", "accept")
    second = device.add_survey(None, None, "top", "retry")
    assert [row["id"] for row in client.get("/api/v1/surveys").get_json()] == [second, first]
    assert [row["id"] for row in client.get(f"/api/v1/surveys?pipe_id={mine}").get_json()] == [first]
    assert [row["id"] for row in client.get(f"/api/v1/surveys?before={second}").get_json()] == [first]
    assert [row["id"] for row in client.get("/api/v1/surveys?limit=1&pipe_id=").get_json()] == [second]
    assert client.get(f"/api/v1/surveys/{first}").get_json()["final_verdict"] == "accept"

    said = {
        "image_good": True,
        "cloud_is_pipe": True,
        "fit_aligned": False,
        "verdict": "retry",
        "by": "Ann",
        "note": "bent\nthere",
    }
    answered = send(client, f"/surveys/{first}/answer", said).get_json()
    assert answered["final_verdict"] == "retry"
    assert answered["operator"]["note"] == "bent\nthere"
    assert error(send(client, f"/surveys/{second}/answer", {"verdict": "accept"}))[:2] == (422, "invalid")

    assert send(client, f"/surveys/{first}", method="DELETE").status_code == 204
    assert error(client.get(f"/api/v1/surveys/{first}"))[:2] == (404, "not_found")
    assert send(client, f"/surveys/{first}/restore").status_code == 204
    assert client.get(f"/api/v1/surveys/{first}").status_code == 200
    assert error(send(client, f"/surveys/{first}/restore"))[0] == 404


@pytest.mark.parametrize(
    "body", [{"verdict": "maybe"}, {"image_good": "yes"}, {"image_good": 1}, {"by": "x" * 81}, {"by": "a\tb"}, {"who": "me"}]
)
def test_a_bad_answer_is_refused(client: FlaskClient, device: FakeDevice, body: dict[str, Any]) -> None:
    number = device.add_survey(None, None, "top", "accept")
    assert error(send(client, f"/surveys/{number}/answer", body))[:2] == (422, "invalid")
    assert device.survey(number)["operator"] is None


@pytest.mark.parametrize(
    "query", ["pipe_id=x", "pipe_id=0", "limit=0", "limit=201", "before=1e9", f"before={2**80}", "limit=5.5"]
)
def test_a_bad_filter_is_refused(client: FlaskClient, query: str) -> None:
    assert error(client.get(f"/api/v1/surveys?{query}"))[:2] == (422, "invalid")
    assert client.get(f"/surveys?{query}").status_code in (200, 422)


@pytest.mark.parametrize("number", ["0", "-1", "x", "9" * 40, "1.0", "%00"])
def test_a_number_that_is_none_is_not_found(client: FlaskClient, number: str) -> None:
    assert error(client.get(f"/api/v1/surveys/{number}"))[0] == 404
    assert client.get(f"/surveys/{number}").status_code == 404


def test_the_cloud_is_live_or_a_surveys(client: FlaskClient, device: FakeDevice) -> None:
    number = device.add_survey(None, None, "top", "accept")
    assert len(client.get("/api/v1/cloud").get_json()["points"]) <= 3000
    cloud = client.get(f"/api/v1/cloud?survey_id={number}").get_json()
    assert len(cloud["points"]) == len(cloud["inlier"])
    assert error(client.get("/api/v1/cloud?survey_id=999"))[0] == 404
    assert error(client.get("/api/v1/cloud?survey_id=all"))[0] == 422


def test_the_browser_offers_its_time(client: FlaskClient, device: FakeDevice) -> None:
    assert send(client, "/clock", {"epoch_ms": 1_795_000_000_000}).status_code == 204
    assert device.calls == [("set_clock", 1_795_000_000_000)]
    for body in ({}, {"epoch_ms": "now"}, {"epoch_ms": 0}, {"epoch_ms": 10**18}, {"epoch_ms": -1}):
        assert error(send(client, "/clock", body))[:2] == (422, "invalid")
    assert len(device.calls) == 1


def test_numbers_json_has_no_word_for_become_null(client: FlaskClient, device: FakeDevice) -> None:
    number = device.add_survey(None, None, "top", "accept")
    device.survey(number)["result"]["diameter_mm"] = float("nan")
    text = client.get(f"/api/v1/surveys/{number}").text
    assert "NaN" not in text
    assert json.loads(text)["result"]["diameter_mm"] is None


def test_a_fault_inside_is_a_sentence_without_a_trace(
    client: FlaskClient, device: FakeDevice, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def broken() -> None:
        raise RuntimeError("secret detail")

    monkeypatch.setattr(device, "status", broken)
    status, code, message = error(client.get("/api/v1/status"))
    assert (status, code) == (500, "internal")
    assert "secret" not in message
    assert "secret detail" in caplog.text


def test_wrong_methods_are_told_apart(client: FlaskClient) -> None:
    response = client.get("/api/v1/measure")
    assert error(response)[:2] == (405, "method_not_allowed")
    assert "POST" in response.headers["Allow"]
