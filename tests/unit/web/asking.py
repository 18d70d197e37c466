"""How the tests ask the API, and how they read a refusal."""

from typing import Any

from flask.testing import FlaskClient
from werkzeug.test import TestResponse


def send(client: FlaskClient, path: str, body: Any = None, method: str = "POST") -> TestResponse:
    return client.open(f"/api/v1{path}", method=method, json={} if body is None else body)


def error(response: TestResponse) -> tuple[int, str, str]:
    answer = response.get_json()
    assert list(answer) == ["error"]
    assert sorted(answer["error"]) == ["code", "message"]
    return response.status_code, answer["error"]["code"], answer["error"]["message"]


def pipe(client: FlaskClient, **fields: Any) -> int:
    response = send(client, "/pipes", {"name": "P 1", **fields})
    assert response.status_code == 201
    return int(response.get_json()["id"])
