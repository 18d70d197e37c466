"""What all tests share: the real recordings, and the switch for real hardware."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from hypothesis import settings

settings.register_profile("suite", derandomize=True, deadline=None)
settings.load_profile("suite")  # the same examples in every run: a suite that fails now and then says nothing

pytest.register_assert_rewrite("tests.unit.drivers")


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--hardware", action="store_true", help="also run the tests that need a real camera on the USB bus")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    if config.getoption("--hardware"):
        return
    skip = pytest.mark.skip(reason="needs a real camera: plug one in and run pytest --hardware")
    for item in items:
        if "hardware" in item.keywords:
            item.add_marker(skip)


@pytest.fixture(scope="session")
def data_dir() -> Path:
    """The folder of real recordings. Tests that ask for it are skipped where there is none."""
    named = os.environ.get("BORESCOUT_DATA")
    if not named:
        pytest.skip("no real recordings: set BORESCOUT_DATA to their folder")
    folder = Path(named)
    if not folder.is_dir():
        pytest.skip(f"no real recordings: BORESCOUT_DATA names {named}, which is no folder")
    return folder
