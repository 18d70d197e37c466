"""The drive's routes over a fake device: start, steer, mark, end, the map, what people say of a landmark."""

from __future__ import annotations

from typing import Any

import pytest
from flask.testing import FlaskClient

from tests.browser.fake_device import FakeDevice
from tests.unit.device.device_doubles import eventually
from tests.unit.web.asking import error, pipe, send


def drive(client: FlaskClient) -> dict[str, Any]:
    state: dict[str, Any] = client.get("/api/v1/drive").get_json()
    return state


def test_a_drive_from_start_to_map(client: FlaskClient, device: FakeDevice) -> None:
    assert drive(client)["state"] == "idle"
    number = pipe(client)
    started = send(client, "/drive", {"pipe_id": number, "direction": "upstream", "radius_m": 0.2, "start_chainage_m": 1})
    assert started.status_code == 202
    survey_id = started.get_json()["survey_id"]
    assert device.calls[-1] == ("start_drive", (number, "upstream", 0.2, 1.0))
    assert eventually(lambda: drive(client)["chainage_m"] > 4)
    assert drive(client)["counts"]["passed"] == 1
    assert send(client, "/drive/pause").status_code == 204
    assert drive(client)["state"] == "paused"
    assert send(client, "/drive/resume").status_code == 204
    marked = send(client, "/drive/mark", {"label": "patch", "clock": 4.5, "note": "liner?"})
    assert (marked.status_code, marked.get_json()["marked_by_hand"], marked.get_json()["note"]) == (201, True, "liner?")
    so_far = client.get(f"/api/v1/surveys/{survey_id}/map").get_json()
    assert (so_far["state"], so_far["smoothed"]) == ("measuring", False)
    assert send(client, "/drive/end", {"length_m": 42.5}).status_code == 202
    assert eventually(lambda: drive(client)["state"] == "idle")
    found = client.get(f"/api/v1/surveys/{survey_id}/map").get_json()
    assert (found["state"], found["smoothed"], found["pipe"]["id"]) == ("saved", True, number)
    listed = client.get("/api/v1/surveys").get_json()
    assert [(row["id"], row["kind"]) for row in listed] == [(survey_id, "landmarks")]


def test_one_drive_at_a_time_and_cancelled_is_gone(client: FlaskClient) -> None:
    survey_id = send(client, "/drive").get_json()["survey_id"]
    assert error(send(client, "/drive"))[:2] == (409, "busy")
    assert send(client, "/drive/cancel").status_code == 204
    assert error(client.get(f"/api/v1/surveys/{survey_id}/map"))[:2] == (404, "not_found")
    for path in ("/drive/pause", "/drive/resume", "/drive/mark", "/drive/end"):
        body = {"label": "roots"} if path.endswith("mark") else {}
        assert error(send(client, path, body))[:2] == (422, "invalid"), path


@pytest.mark.parametrize(
    ("path", "body", "field"),
    [
        ("/drive", {"direction": "sideways"}, "direction"),
        ("/drive", {"radius_m": 0}, "radius_m"),
        ("/drive", {"radius_m": "0.15"}, "radius_m"),
        ("/drive", {"start_chainage_m": 1e9}, "start_chainage_m"),
        ("/drive", {"speed": 1}, "speed"),
        ("/drive/mark", {}, "label"),
        ("/drive/mark", {"label": "roots", "clock": 0}, "clock"),
        ("/drive/mark", {"label": "roots", "clock": 12.5}, "clock"),
        ("/drive/mark", {"label": "a\nb"}, "label"),
        ("/drive/end", {"length_m": -3}, "length_m"),
        ("/drive/pause", {"now": True}, "now"),
        ("/encoder/zero", {"chainage_m": "x"}, "chainage_m"),
        ("/encoder/calibrate", {"point": "middle"}, "point"),
        ("/encoder/calibrate", {"point": "end", "length_m": 0}, "length_m"),
    ],
)
def test_bad_bodies_are_refused_in_one_sentence(client: FlaskClient, path: str, body: dict[str, Any], field: str) -> None:
    status, code, message = error(send(client, path, body))
    assert (status, code) == (422, "invalid")
    assert message.startswith(f"{field}: ")
    assert message.endswith(".")


@pytest.mark.parametrize("query", ["", "?overlay=1", "?overlay=true"])
def test_the_cctv_picture(client: FlaskClient, device: FakeDevice, query: str) -> None:
    response = client.get(f"/api/v1/drive/picture.jpg{query}")
    assert (response.status_code, response.mimetype) == (200, "image/jpeg")
    device.drive.grabber["state"] = "lost"
    assert client.get(f"/api/v1/drive/picture.jpg{query}").status_code == 204
    assert error(client.get("/api/v1/drive/picture.jpg?overlay=perhaps"))[0] == 422


def test_the_encoder_is_set_zeroed_and_calibrated(client: FlaskClient) -> None:
    changed = send(client, "/encoder", {"direction": -1}, "PUT").get_json()
    assert (changed["direction"], changed["counts_per_metre"]) == (-1, 1000.0)  # what was not sent stays
    assert error(send(client, "/encoder", {"direction": 2}, "PUT"))[0] == 422
    assert error(send(client, "/encoder", {"counts_per_metre": 0}, "PUT"))[0] == 422
    assert send(client, "/encoder/zero").get_json()["zero"] == 1200.0
    assert send(client, "/encoder/calibrate", {"point": "start"}).status_code == 200
    assert error(send(client, "/encoder/calibrate", {"point": "end"}))[0] == 422
    assert send(client, "/encoder/calibrate", {"point": "end", "length_m": 20}).get_json()["counts_per_metre"] == 500.0


def test_what_is_said_of_a_landmark_is_kept_beside_what_was_measured(client: FlaskClient, device: FakeDevice) -> None:
    number = device.drive.add()
    address = f"/surveys/{number}/landmarks/1"
    measured = client.get(f"/api/v1/surveys/{number}/map").get_json()["landmarks"][0]
    said = send(client, address, {"decision": "confirmed", "clock": 2.5, "class": "roots", "by": "Ada"}, "PATCH").get_json()
    assert (said["decision"], said["corrected"]) == ("confirmed", {"clock": 2.5, "class": "roots"})
    assert (said["clock"], said["class"]) == (measured["clock"], measured["class"])
    again = send(client, address, {"decision": None, "note": "no"}, "PATCH").get_json()
    assert (again["decision"], again["note"], len(again["history"])) == (None, "no", 2)
    assert device.calls[-1][1] == (number, 1, {"decision": None, "note": "no"}), "an absent field must stay absent"
    for body in ({"decision": "maybe"}, {"clock": 13}, {"status": "passed"}, {"class": ""}):
        assert error(send(client, address, body, "PATCH"))[0] == 422
    assert error(send(client, f"/surveys/{number}/landmarks/99", {}, "PATCH"))[0] == 404
    assert error(send(client, "/surveys/99/landmarks/1", {}, "PATCH"))[0] == 404


def test_thumbnails(client: FlaskClient, device: FakeDevice) -> None:
    number = device.drive.add()
    response = client.get(f"/api/v1/surveys/{number}/landmarks/1/thumbnail.jpg")
    assert (response.status_code, response.mimetype) == (200, "image/jpeg")
    assert error(client.get(f"/api/v1/surveys/{number}/landmarks/99/thumbnail.jpg"))[0] == 404


def test_a_drive_is_deleted_and_restored_as_any_survey(client: FlaskClient, device: FakeDevice) -> None:
    number = device.drive.add()
    assert send(client, f"/surveys/{number}", method="DELETE").status_code == 204
    assert error(client.get(f"/api/v1/surveys/{number}/map"))[0] == 404
    assert send(client, f"/surveys/{number}/restore").status_code == 204
    assert client.get(f"/api/v1/surveys/{number}").get_json()["kind"] == "landmarks"
