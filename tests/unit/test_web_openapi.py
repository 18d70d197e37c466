"""The OpenAPI document tells the truth: it is walked against the application's URL map."""

import json
import re
from collections.abc import Iterator
from typing import Any

import pytest
from flask import Flask

from tests.browser.fake_device import FakeDevice
from web_ui.app import create_app


@pytest.fixture(scope="module")
def app() -> Iterator[Flask]:
    fake = FakeDevice()
    yield create_app(fake)  # type: ignore[arg-type]  # a fake with the facade's methods
    fake.close()


def routes(app: Flask) -> set[tuple[str, str]]:
    found = set()
    for rule in app.url_map.iter_rules():
        if rule.rule.startswith("/api/v1/"):
            path = re.sub(r"<(?:[^<>]*:)?(\w+)>", r"{\1}", rule.rule.removeprefix("/api/v1"))
            found |= {(path, method) for method in (rule.methods or set()) - {"HEAD", "OPTIONS"}}
    return found


def document(app: Flask) -> dict[str, Any]:
    answer: dict[str, Any] = app.test_client().get("/api/v1/openapi.json").get_json()
    return answer


def test_the_document_holds_every_route_and_no_other(app: Flask) -> None:
    told = {(path, method.upper()) for path, operations in document(app)["paths"].items() for method in operations}
    assert told == routes(app)
    assert len(told) >= 20


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
    for path, operations in document(app)["paths"].items():
        for method, operation in operations.items():
            declared = {parameter["name"] for parameter in operation.get("parameters", []) if parameter["in"] == "path"}
            assert declared == set(re.findall(r"{(\w+)}", path)), (method, path)
            assert ("requestBody" in operation) == (method != "get"), (method, path)
