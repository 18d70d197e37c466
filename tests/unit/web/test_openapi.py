"""The OpenAPI document tells the truth: it is walked against the application's URL map."""

import json
import re
from collections.abc import Iterator
from typing import Any

import pytest
from flask import Flask

from tests.browser.fake_device import FakeDevice
from web_ui import access, openapi
from web_ui.app import create_app


@pytest.fixture(scope="module")
def app() -> Iterator[Flask]:
    fake = FakeDevice()
    yield create_app(fake)  # type: ignore[arg-type]  # a fake with the facade's methods
    fake.close()


def routes(app: Flask) -> dict[tuple[str, str], str]:
    """(path, method) to endpoint."""
    found = {}
    for rule in app.url_map.iter_rules():
        path = re.sub(r"<(?:[^<>]*:)?(\w+)>", r"{\1}", rule.rule)
        found |= {(path, method): rule.endpoint for method in (rule.methods or set()) - {"HEAD", "OPTIONS"}}
    return found


def document(app: Flask) -> dict[str, Any]:
    answer: dict[str, Any] = app.test_client().get("/api/v1/openapi.json").get_json()
    return answer


def operations(app: Flask) -> dict[tuple[str, str], dict[str, Any]]:
    return {
        (path, method.upper()): operation for path, told in document(app)["paths"].items() for method, operation in told.items()
    }


def test_the_document_holds_every_route_and_no_other(app: Flask) -> None:
    assert operations(app).keys() == routes(app).keys()
    api = {endpoint for (path, _), endpoint in routes(app).items() if path.startswith("/api/")}
    assert api == set(openapi.ROUTES), "each route of the API has its line in ROUTES, and no line is left over"
    assert len(api) >= 40


def test_what_is_public_is_marked_so_and_nothing_else(app: Flask) -> None:
    endpoints = routes(app)
    for place, operation in operations(app).items():
        assert (operation["security"] == []) == (endpoints[place] in access.PUBLIC), place
        if operation["security"]:
            assert "401" in operation["responses"] or "4XX" in operation["responses"]
            assert ("csrf" in operation["security"][0]) == (place[1] != "GET")


def test_every_reference_in_the_document_leads_somewhere(app: Flask) -> None:
    whole = document(app)
    references: list[str] = re.findall(r'"\$ref": ?"([^"]+)"', json.dumps(whole))
    assert references
    for reference in references:
        place: Any = whole
        for part in reference.removeprefix("#/").split("/"):
            assert part in place, reference
            place = place[part]


def test_every_path_parameter_is_declared_and_every_change_has_a_body(app: Flask) -> None:
    for (path, method), operation in operations(app).items():
        declared = {parameter["name"] for parameter in operation.get("parameters", []) if parameter["in"] == "path"}
        assert declared == set(re.findall(r"{(\w+)}", path)), (method, path)
        assert ("requestBody" in operation) == (method != "GET"), (method, path)


def test_every_answer_of_the_api_has_a_schema(app: Flask) -> None:
    for (path, method), operation in operations(app).items():
        if not path.startswith("/api/"):
            continue
        for status, response in operation["responses"].items():
            assert status == "204" or "$ref" in response or response["content"], (method, path, status)
        assert any(status.startswith("4") for status in operation["responses"])
