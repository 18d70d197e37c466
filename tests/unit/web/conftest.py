"""What the tests of page and API share: the application over a device without cameras, and a client that is paired."""

from collections.abc import Iterator

import pytest
from flask import Flask
from flask.testing import FlaskClient

from tests.browser.fake_device import FakeDevice
from tests.pairing import paired_client
from web_ui.app import create_app


@pytest.fixture
def device() -> Iterator[FakeDevice]:
    fake = FakeDevice(seconds=0.2)
    yield fake
    fake.close()


@pytest.fixture
def app(device: FakeDevice) -> Flask:
    return create_app(device)  # type: ignore[arg-type]  # a fake with the facade's methods


@pytest.fixture
def client(app: Flask) -> FlaskClient:
    return paired_client(app)
