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
    Bench.wait(lambda: device.drive()["encoder"]["state"] == "up")
    assert device.drive()["available"]
    assert device.drive()["grabber"]["state"] in ("resting", "starting")
    frames = device.drive()["grabber"]["frames"]
    assert frames == 0  # nothing is drawn while nobody looks
    Bench.wait(lambda: device.drive_picture() is not None)  # somebody does
    survey_id = device.start_drive()["survey_id"]
    Bench.wait(lambda: device.drive()["chainage_m"] is not None and device.drive()["chainage_m"] > 0.3, 60)
    Bench.wait(lambda: device.drive_picture(overlay=True) is not None)
    device.pause_drive()
    Bench.wait(lambda: device.drive()["speed_mps"] == pytest.approx(0.0, abs=0.05))
    device.resume_drive()
    assert device.end_drive() == {"survey_id": survey_id}
    Bench.wait(lambda: device.drive()["state"] == "idle", 60)
    found = device.survey_map(survey_id)
    assert (found["state"], found["radius_m"]) == ("saved", pytest.approx(0.15))
    assert found["frames"] > 10
