"""schemathesis tries every route over the whole device: no server error, and nothing that the document does not say.

`python -m tests.bench.api_schema` does the same with many more cases.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest
from flask import Flask

from device.clock import Clock
from device.config import Settings
from device.daemon import Device
from device.workers import WorkerPool
from tests.api_schema import operations, try_operation
from tests.pairing import PIN, paired_client
from web_ui.app import create_app

EXAMPLES = 2


@pytest.fixture(scope="module")
def app(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Flask]:
    """The whole device without a camera: its store, its door and its words; the benchmark has one with cameras."""
    folder = tmp_path_factory.mktemp("box")
    device = Device(Settings(data_dir=folder, pin=PIN), feeds=[], pool=WorkerPool(1, len), clock=Clock(folder / "none"))
    yield create_app(device.start())
    device.close()


@pytest.fixture
def headers(app: Flask) -> Callable[[], dict[str, str]]:
    """Of a session that controls the box; a new one where a case has ended it."""
    client = paired_client(app)

    def kept() -> dict[str, str]:
        nonlocal client
        if client.get("/api/v1/status").status_code == 401:
            client = paired_client(app)
        client.post("/api/v1/control/ask", json={})
        return {"Cookie": client.environ_base["HTTP_COOKIE"], "X-CSRF-Token": client.environ_base["HTTP_X_CSRF_TOKEN"]}

    return kept


def test_every_route_keeps_to_the_document(app: Flask, headers: Callable[[], dict[str, str]]) -> None:
    tried = {label: try_operation(operation, headers, EXAMPLES, 1) for label, operation in operations(app).items()}
    assert len(tried) >= 45
    assert all(tried.values())
