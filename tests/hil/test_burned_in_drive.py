"""A drive by the distance burned into its pictures: settings, grabber, reader and survey, as ``borescout serve`` has them."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

import device.landmarks.crawlers
from device.clock import Clock
from device.config import CrawlerSettings, Settings
from device.daemon import Device
from device.workers import WorkerPool
from drivers.encoder.osd import OsdReader, OsdText
from tests.hil.crawler_rig import CAMERA, PipePictures
from tests.pairing import PIN
from tests.unit.drivers.osd_pictures import as_read
from tests.waiting import wait_until

FPS, FRAMES, STEP_M = 20.0, 200, 0.02


class Stripes(OsdReader):
    """In place of the OCR: the distance in tenths is the number of white columns in the picture's first rows."""

    def __init__(self, region: tuple[int, int, int, int] | None = None) -> None:
        self._region = region

    def read(self, image: NDArray[np.uint8], patient: bool = True) -> OsdText:
        return as_read(f"{np.count_nonzero(image[:4].mean(axis=(0, 2)) > 128) / 10:06.1f}")


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """Ten seconds of a drive of 4 m."""
    pictures, file = PipePictures(), tmp_path / "run.avi"
    writer = cv2.VideoWriter(str(file), cv2.VideoWriter.fourcc(*"MJPG"), FPS, (CAMERA.width, CAMERA.height))
    for k in range(FRAMES):
        image = pictures.at(STEP_M * k)
        image[:8] = 0
        image[:8, : int(10 * STEP_M * k + 1e-6)] = 255
        writer.write(image)
    writer.release()
    return file


def test_a_drive_is_placed_by_the_distance_in_its_pictures(run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(device.landmarks.crawlers, "OsdReader", Stripes)
    crawler = CrawlerSettings(grabber="video", grabber_source=str(run), encoder="osd", focal_px=(170.0, 170.0), radius_m=0.15)
    settings = Settings(data_dir=tmp_path / "data", pin=PIN, crawler=crawler)
    box = Device(settings, feeds=[], pool=WorkerPool(1), clock=Clock(tmp_path / "x"))
    box.start()
    try:
        wait_until(lambda: box.drive.state()["grabber"]["state"] == "up", 40.0)
        assert box.drive.state()["available"]
        survey_id = box.drive.begin()["survey_id"]
        wait_until(lambda: (box.drive.state()["chainage_m"] or 0.0) > 2.0, 40.0)
        state = box.drive.state()
        assert state["speed_mps"] == pytest.approx(STEP_M * FPS, abs=0.15)
        assert "no_distance" not in [prompt["code"] for prompt in state["prompts"]]
        mark = box.drive.mark("patch", 4.0, "")
        assert mark["chainage_m"] == pytest.approx(box.drive.state()["chainage_m"], abs=0.3)
        box.drive.end()
        wait_until(lambda: box.drive.state()["state"] == "idle", 40.0)
        found = box.drive.map(survey_id)
        assert found["state"] == "saved"
        assert found["frames"] > 20
        assert 2.0 < found["to_m"] < FRAMES * STEP_M
        # the clock of the drive is the recording's: it is not played faster than it was made
        assert found["to_m"] - found["from_m"] < (found["seconds"] + 1.0) * STEP_M * FPS
    finally:
        box.close()
