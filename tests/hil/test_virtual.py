"""The device in the virtual sewer: what the twin's fault script does to it, and how it comes back."""

from __future__ import annotations

import itertools
import json
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from device.clock import Clock
from device.config import Settings
from device.daemon import Device
from device.errors import Invalid
from device.feeds.cameras import feeds as make_feeds
from device.feeds.feed import CameraFeed
from device.feeds.reader import FeedTiming
from device.workers import WorkerPool
from drivers.registry import open_depth_cameras
from drivers.virtual.cameras import demo_bus
from drivers.virtual.faults import FaultScript
from tests.hil.rig import Bench

TIMING = FeedTiming(read_limit_s=4.0, faults_before_reopen=2, back_off_s=(0.1, 0.5), empty_before_reopen=15)
_seeds = itertools.count(9000)


class VirtualBench(Bench):
    """A box in the demo's pipe, 300 mm wide; every bench has a bus of its own."""

    def __init__(self, folder: Path, cameras: int = 1) -> None:
        self.cameras = ()
        seed = next(_seeds)
        self.bus = demo_bus(seed, None)
        open_one = partial(open_depth_cameras, "virtual", seed=seed, cameras=cameras)
        feeds = [
            CameraFeed(name, "virtual", lambda index=index: open_one()[index], timing=TIMING)
            for index, name in enumerate(("stereo", "tof")[:cameras])
        ]
        self.pool = WorkerPool(2, limit_s=60.0)
        self.device = Device(Settings(data_dir=folder, frames=12), feeds=feeds, pool=self.pool, clock=Clock(folder / "x"))
        self.ear = self.device.subscribe()
        self.device.start()

    @property
    def faults(self) -> FaultScript:
        """Of the stereo camera."""
        return self.bus.cameras[0].faults

    def close(self) -> None:
        for camera in self.bus.cameras:
            camera.faults.end()
        super().close()


@pytest.fixture
def box(tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[VirtualBench]:
    bench = VirtualBench(tmp_path, getattr(request, "param", 1))
    yield bench
    bench.close()


def stereo(data: dict[str, Any]) -> dict[str, Any]:
    camera: dict[str, Any] = data["cameras"][0]
    return camera


def test_the_demo_measures_its_pipe_right(box: VirtualBench) -> None:
    box.up()
    survey_id = box.device.measure()["survey_id"]
    assert box.finish(survey_id)["state"] == "saved"
    result = box.device.survey(survey_id)["result"]
    assert result["diameter_mm"] == pytest.approx(300, abs=20)
    assert result["interval_mm"][0] <= 300 <= result["interval_mm"][1]


@pytest.mark.parametrize("fault", ["freeze", "disconnect", "wrong size", "all zero", "never comes", "hang"])
def test_a_fault_while_aiming_is_shown_and_outlived(box: VirtualBench, fault: str) -> None:
    box.up()
    box.faults.trigger(fault)
    shown = stereo(box.wait_for("status", lambda data: stereo(data)["state"] in ("degraded", "lost")))
    assert shown["message"].endswith((".", "!", "?"))
    assert "Error" not in shown["message"]
    grown = stereo(box.wait_for("status", lambda data: stereo(data)["age_s"] > 2.0))
    assert grown["state"] != "up"
    box.faults.end()
    box.wait_for("status", lambda data: stereo(data)["state"] == "up" and stereo(data)["age_s"] < 2.0)
    box.wait_for("live")


@pytest.mark.parametrize("fault", ["partial blackout", "slow"])
def test_a_fault_that_leaves_pictures_leaves_the_camera_up(box: VirtualBench, fault: str) -> None:
    box.up()
    box.faults.trigger(fault)
    before = box.device.status()["cameras"][0]["frames"]
    box.wait_for("status", lambda data: stereo(data)["frames"] > before + 4)
    assert box.device.status()["cameras"][0]["reconnects"] == 0


def test_a_camera_that_sends_garbage_is_declared_and_recovers(box: VirtualBench) -> None:
    box.up()
    box.faults.trigger("garbage")
    box.wait_for("status", lambda data: stereo(data)["state"] != "up")
    assert box.device.status()["cameras"][0]["bad_frames"] > 0
    box.faults.end("garbage")
    box.wait_for("status", lambda data: stereo(data)["state"] == "up")


def test_garbage_is_never_accepted(box: VirtualBench) -> None:
    box.up()
    box.faults.trigger("garbage")
    survey_id = box.device.measure(frames=6)["survey_id"]
    box.finish(survey_id)
    assert box.device.survey(survey_id)["final_verdict"] == "retry"


def test_a_cable_pulled_in_mid_measurement_fails_it_and_the_next_one_works(box: VirtualBench) -> None:
    box.up()
    survey_id = box.device.measure(frames=400)["survey_id"]
    box.wait_for("measurement", lambda data: data["frames_done"] >= 3)
    box.faults.trigger("disconnect")
    assert box.finish(survey_id)["state"] == "failed"
    assert box.device.survey(survey_id)["result"]["reasons"] == ["camera_lost"]
    box.faults.trigger("reconnect")
    box.wait_for("status", lambda data: stereo(data)["state"] == "up")
    assert stereo(box.device.status())["reconnects"] >= 1
    assert box.finish(box.device.measure(frames=6)["survey_id"])["state"] == "saved"


@pytest.mark.parametrize("box", [2], indirect=True)
def test_stereo_and_time_of_flight_are_judged_each_by_itself(box: VirtualBench) -> None:
    box.up()
    survey_id = box.device.measure(frames=8)["survey_id"]
    assert box.finish(survey_id)["state"] == "saved"
    survey = box.device.survey(survey_id)
    by_camera = {recording["camera"]: recording["result"] for recording in survey["recordings"]}
    assert set(by_camera) == {"stereo", "tof"}
    chosen = by_camera[survey["result"]["camera"]]
    other = by_camera[({"stereo", "tof"} - {survey["result"]["camera"]}).pop()]
    if chosen["verdict"] == other["verdict"]:
        assert chosen["radius_std_mm"] <= other["radius_std_mm"]


def test_a_description_chooses_the_pipe_and_a_broken_one_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "sewer.json"
    file.write_text(json.dumps({"diameter_mm": 400, "faults": []}))
    settings = Settings(data_dir=tmp_path, cameras=("virtual",), virtual_cameras=2, virtual_description=file)
    assert [feed.name for feed in make_feeds(settings, lambda: None)] == ["virtual stereo", "virtual time of flight"]
    broken = tmp_path / "broken.json"
    broken.write_text('{"diameter_mm": "wide"}')
    with pytest.raises(Invalid) as told:
        make_feeds(settings.model_copy(update={"virtual_description": broken}), lambda: None)
    assert "\n" not in str(told.value)
