"""The landmarks survey with the virtual crawler, as ``serve --virtual`` has it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from device.config import Settings
from device.daemon import Device
from device.workers import WorkerPool
from tests.hil.crawler_rig import Bench


@pytest.fixture
def device(tmp_path: Path) -> Iterator[Device]:
    crawler = {"grabber": "virtual", "encoder": "virtual"}
    settings = Settings.model_validate({"data_dir": tmp_path, "crawler": crawler})
    device = Device(settings, feeds=[], pool=WorkerPool(1)).start()
    yield device
    device.close()


def test_the_virtual_crawler_drives_when_it_is_told_to_and_rests_otherwise(device: Device) -> None:
    Bench.wait(lambda: device.drive.state()["encoder"]["state"] == "up")
    assert device.drive.state()["available"]
    assert device.drive.state()["grabber"]["state"] in ("resting", "starting")
    frames = device.drive.state()["grabber"]["frames"]
    assert frames == 0  # nothing is drawn while nobody looks
    Bench.wait(lambda: device.drive.picture() is not None)  # somebody does
    survey_id = device.drive.begin()["survey_id"]
    Bench.wait(lambda: device.drive.state()["chainage_m"] is not None and device.drive.state()["chainage_m"] > 0.3, 60)
    Bench.wait(lambda: device.drive.picture(overlay=True) is not None)
    device.drive.pause()
    Bench.wait(lambda: device.drive.state()["speed_mps"] == pytest.approx(0.0, abs=0.05))
    device.drive.resume()
    assert device.drive.end() == {"survey_id": survey_id}
    Bench.wait(lambda: device.drive.state()["state"] == "idle", 60)
    found = device.drive.map(survey_id)
    assert (found["state"], found["radius_m"]) == ("saved", pytest.approx(0.15))
    assert found["frames"] > 10
