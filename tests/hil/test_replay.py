"""The device on a recording: a picture that is held is one picture, however often it is shown."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import pytest

from device.config import Settings
from device.daemon import Device
from device.feeds.cameras import HeldReplay
from drivers.base import EndOfRecording
from drivers.depth.base import DepthFrame
from drivers.depth.replay import ReplayCamera
from tests.hil.rig import PATIENCE_S
from tests.unit.device.device_doubles import eventually
from tests.unit.estimators.analytic_scenes import SMALL, cylinder, to_depth


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Two recordings: two pictures of a 200 mm pipe, one of a 300 mm pipe."""
    entries = []
    intrinsics = {name: getattr(SMALL, name) for name in ("width", "height", "fx", "fy", "ppx", "ppy")}
    for path, radius in (("a/depth_1.png", 0.1), ("a/depth_2.png", 0.1), ("b/depth_1.png", 0.15)):
        (tmp_path / path).parent.mkdir(exist_ok=True)
        cv2.imwrite(str(tmp_path / path), to_depth(cylinder(radius, SMALL, tilt=(0.05, 0.0)), 0.01, seed=len(entries)))
        entries.append({"depth": path, "recording": path[0], "depth_unit_m": 0.001, "intrinsics": intrinsics})
    (tmp_path / "manifest.json").write_text(json.dumps(entries))
    return tmp_path


@pytest.fixture
def device(folder: Path, request: pytest.FixtureRequest) -> Iterator[Device]:
    settings = Settings(data_dir=folder / "data", cameras=("replay",), replay=folder, replay_hold_s=request.param)
    device = Device(settings).start()
    yield device
    device.close()


def measured(device: Device, **arguments: Any) -> dict[str, Any]:
    ear = device.subscribe()
    survey_id = device.measure(**arguments)["survey_id"]
    deadline = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline:
        event = ear.get(1.0)
        if event is not None and event.name == "measurement" and event.data["state"] in ("saved", "failed"):
            return device.survey(survey_id)
    raise AssertionError("the measurement did not end")


@pytest.mark.parametrize("device", [600.0], indirect=True)
def test_fifty_looks_at_one_picture_are_one_frame_with_a_resampled_spread(device: Device) -> None:
    assert eventually(lambda: device.status()["cameras"][0]["state"] == "up", 30)
    survey = measured(device, frames=20)
    assert survey["state"] == "saved"
    assert survey["recordings"][0]["frames"] == 1
    assert survey["result"]["diameter_mm"] == pytest.approx(200, abs=5)
    assert survey["result"]["radius_std_mm"] > 0  # between frames it would be nothing at all


@pytest.mark.parametrize("device", [0.2], indirect=True)
def test_a_recording_ends_where_the_next_one_begins(device: Device) -> None:
    assert eventually(lambda: device.status()["cameras"][0]["state"] == "up", 30)
    survey = measured(device, frames=100)  # some three seconds: it would run through both pipes
    diameters = [frame["diameter_mm"] for frame in survey["result"]["frames"]]
    assert len(diameters) <= 2
    assert all(diameter == pytest.approx(diameters[0], abs=5) for diameter in diameters)


@pytest.mark.parametrize("device", [600.0], indirect=True)
def test_a_held_picture_stays_live(device: Device) -> None:
    assert eventually(lambda: device.live() is not None, 60)
    time.sleep(4.0)  # longer than an estimate of a camera stays live
    live = device.live()
    assert live is not None
    assert live["age_s"] < 2.0
    assert live["diameter_mm"] == pytest.approx(200, abs=5)


def test_held_pictures_come_at_their_rate_with_growing_numbers_and_change_after_their_time(folder: Path) -> None:
    camera = HeldReplay(ReplayCamera(folder, loop=False), hold_s=0.3, rate_hz=50)
    camera.open()
    seen: list[DepthFrame] = []

    def read_on() -> None:
        while True:
            seen.append(camera.read())

    with pytest.raises(EndOfRecording):
        read_on()
    camera.close()
    assert [frame.number for frame in seen] == list(range(1, len(seen) + 1))
    assert list(dict.fromkeys(frame.source for frame in seen)) == ["a/depth_1.png", "a/depth_2.png", "b/depth_1.png"]
    assert len(seen) > 12


def test_the_shared_recordings_play_through_the_device(data_dir: Path, tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path, cameras=("replay",), replay=data_dir / "realsense_pipes")
    device = Device(settings).start()
    try:
        assert eventually(lambda: device.status()["cameras"][0]["state"] == "up", 30)
        survey = measured(device, frames=10)
        assert survey["state"] == "saved"
        assert survey["result"]["verdict"] in ("accept", "retry")
    finally:
        device.close()
