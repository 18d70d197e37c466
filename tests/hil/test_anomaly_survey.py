"""The anomaly survey of a whole device: a stereo camera in the virtual sewer, from the live state to what is kept."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from device.anomaly.calibration import RigSource
from device.anomaly.rig import StereoEye
from device.anomaly.views import unpacked
from device.cli import cli
from device.clock import Clock
from device.config import CrawlerSettings, Settings
from device.daemon import Device
from device.feeds.feed import StereoFeed
from device.recorder.export import export_recording
from device.replay.survey import replay
from device.workers import WorkerPool
from drivers.stereo.replay import pair_folder, read_pair
from drivers.virtual.landmarks import Patch
from drivers.virtual.profile import circular
from drivers.virtual.stereo_camera import StereoLens, StereoLook, StereoPainter, VirtualStereoCamera
from drivers.virtual.world import VirtualSewer
from estimators.pinhole import Intrinsics
from tests.hil.rig import PATIENCE_S, TIMING
from tests.pairing import PIN

SMALL = StereoLens(Intrinsics(640, 400, 373.0, 373.0, 319.5, 199.5), 0.06)


def camera(start: float = 0.3) -> VirtualStereoCamera:
    """Stands still in a pipe of 400 mm, ``start`` (m) from its begin, with 40 mm of deposit on its invert."""
    deposit = Patch(0.85, 1.15, np.pi / 2, 0.35, 0.04)
    sewer = VirtualSewer(circular(0.4), 6.0, things=(deposit,))
    eye = VirtualStereoCamera(StereoPainter(sewer, SMALL, StereoLook(), 3), start, seed=3, dwell=10_000, rate_hz=8.0)
    eye.open()
    eye.read(PATIENCE_S)  # painting takes its time, on a busy machine longer than a driver may
    eye.close()
    return eye


@pytest.fixture
def box(tmp_path: Path) -> Iterator[Callable[..., Device]]:
    made: list[Device] = []

    def make(eye: VirtualStereoCamera, **given: Any) -> Device:
        feed = StereoFeed(eye.name, "virtual", lambda: eye, timing=replace(TIMING, read_limit_s=10.0))
        settings = Settings(data_dir=tmp_path, pin=PIN, **given)
        pool: Any = WorkerPool(0)
        device = Device(settings, feeds=[], pool=pool, clock=Clock(tmp_path / "none"), eye=StereoEye(feed, RigSource()))
        made.append(device.start())
        return device

    yield make
    for device in made:
        device.close()


def wait_for(what: Callable[[], Any]) -> Any:
    deadline = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline:
        found = what()
        if found:
            return found
        time.sleep(0.05)
    raise AssertionError("it never came")


def scanned(device: Device, **body: Any) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """The result of one scan, and what was told of it on the way."""
    ear = device.subscribe()
    number = device.anomaly.scan(**body)["survey_id"]
    told: list[dict[str, Any]] = []

    def over() -> bool:
        event = ear.get(0.2)
        if event is not None and event.name == "measurement" and event.data["survey_id"] == number:
            told.append(event.data)
        return bool(told) and told[-1]["state"] in ("saved", "failed", "cancelled")

    wait_for(over)
    return device.anomaly.found(number), told


def test_a_deposit_is_scanned_kept_and_found_again(box: Callable[..., Device], tmp_path: Path) -> None:
    device = box(camera())
    pipe = device.places.create_pipe(
        {"name": "P1", "material": "concrete", "shape": "circular", "reference_dn": 400, "note": ""}
    )
    live = wait_for(lambda: device.anomaly.look()["live"])
    assert (live["code"], live["level"]) == (None, "good")
    assert abs(live["radius_mm"] - 200) < 20
    assert device.anomaly.picture() is not None
    found, told = scanned(device, pipe_id=pipe["id"], chainage=12.0, pairs=2)
    assert {"measuring", "computing"} <= {event["state"] for event in told}
    assert all(event["kind"] == "anomaly" for event in told)
    assert found["verdict"] == "accept"
    assert found["pipe"]["name"] == "P1"
    regions = [one for one in found["regions"] if not one["expected"]]
    assert len(regions) == 1
    region = regions[0]
    assert -50 < region["peak_mm"] < -25
    assert region["seen_in"] == 2
    assert abs(region["clock"] - 6) <= 0.5
    # the camera stands at 0.3 m of the virtual sewer, its deposit from 0.85 to 1.15 m
    assert region["chainage_m"] == pytest.approx(12.0 + 1.0 - 0.3, abs=0.12)
    number = found["survey_id"]
    kept = unpacked(device._store.surveys.anomaly_view(number, "map") or b"")
    assert np.nanmin(kept.deviation) < -0.025
    assert (device.anomaly.wall(number) or b"").startswith(b"\x89PNG")
    for what in ("reference", "overlay"):
        assert (device.anomaly.view(number, what) or b"").startswith(b"\xff\xd8")
    assert device.surveys()[0]["score_mm"] == found["score_mm"]
    assert len(device.cloud(number)["deviation_mm"]) == len(device.cloud(number)["points"]) > 500
    wait_for(lambda: device.recordings.of(number)["state"] == "kept")
    outcome = replay(device.recordings.file(number, 1, 1))
    assert (outcome.equal, outcome.exact, outcome.frames) == (True, True, 2)
    assert export_recording(device.recordings.file(number, 1, 1), tmp_path / "plain")["stereo pairs"] == 2
    pairs = pair_folder(tmp_path / "plain")
    assert [read_pair(pairs, entry).left.shape for entry in pairs.pairs] == [(400, 640, 3)] * 2
    assert (pairs.baseline_m, pairs.offset_px) == (0.06, 0.0)
    assert [(entry.pipe, entry.chainage_m) for entry in pairs.pairs] == [("P1", 12.0)] * 2
    cli.main(["anomaly", "--replay", str(tmp_path / "plain"), "--along", str(tmp_path / "along.json")], standalone_mode=False)
    (pipe_found,) = json.loads((tmp_path / "along.json").read_text())
    assert pipe_found["pipe"] == "P1"
    assert [one["seen_from"] for one in pipe_found["regions"] if not one["expected"]] in ([[1, 2]], [[2, 1]])


def test_a_deposit_scanned_from_two_places_is_one(box: Callable[..., Device]) -> None:
    device = box(camera())
    device.set_clock(1_795_000_000_000)
    pipe = device.places.create_pipe({"name": "P1"})["id"]
    first, _ = scanned(device, pipe_id=pipe, chainage=0.3, pairs=1)
    device.close()
    device = box(camera(start=0.55))
    device.set_clock(1_795_000_060_000)
    second, _ = scanned(device, pipe_id=pipe, chainage=0.57, pairs=1)  # the tether is 2 cm off
    along = device.anomaly.along(second["survey_id"])
    assert along == device.anomaly.along(first["survey_id"])
    assert along["surveys"] == [first["survey_id"], second["survey_id"]]
    (deposit,) = [one for one in along["regions"] if not one["expected"]]
    assert sorted(deposit["seen_from"]) == along["surveys"]
    assert deposit["chainage_m"] == pytest.approx(1.0, abs=0.08)
    assert along["gaps"] == []
    worst = max(along["bands"], key=lambda band: band["score_mm"] or 0.0)
    assert 0.8 <= worst["from_m"] <= 1.1


def test_one_camera_maps_the_drive_and_scans_the_wall(box: Callable[..., Device], tmp_path: Path) -> None:
    way = tmp_path / "way.csv"
    way.write_text("time_s,distance_m\n" + "".join(f"{k / 10},{k / 500}\n" for k in range(1200)))
    device = box(camera(), crawler=CrawlerSettings(grabber="stereo", encoder="csv", encoder_port=str(way), radius_m=0.2))
    wait_for(lambda: device.anomaly.state()["chainage_m"] is not None)
    number = device.drive.begin(None, "downstream")["survey_id"]
    wait_for(lambda: device.drive.state()["frames"] > 3)
    found, _ = scanned(device, chainage=device.anomaly.state()["chainage_m"], pairs=1)
    assert found["verdict"] == "accept"
    assert len([one for one in found["regions"] if not one["expected"]]) == 1
    before = device.drive.state()["frames"]
    wait_for(lambda: device.drive.state()["frames"] > before)
    device.drive.end(None)
    wait_for(lambda: device.drive.state()["state"] == "idle")
    driven = device.drive.map(number)
    assert driven["state"] == "saved"
    assert driven["settings"]["focal_px"] == [373.0, 373.0], "as the camera says of itself"
    assert driven["settings"]["centre_px"] == [319.5, 199.5]
    assert "left picture" in driven["settings"]["grabber"]


def test_a_dark_lamp_is_refused_with_a_remedy_and_a_pulled_cable_told(box: Callable[..., Device]) -> None:
    eye = camera()
    device = box(eye)
    eye.faults.trigger("dark")
    found, _ = scanned(device, pairs=1)
    assert (found["verdict"], found["reasons"], found["map"]) == ("retry", ["pair_dark"], None)
    assert "light" in found["prompts"][0]["remedy"]
    assert device.anomaly.view(found["survey_id"], "reference") is not None, "what was refused can be looked at"
    eye.faults.end("dark")
    eye.faults.trigger("disconnect")
    device.anomaly.look()
    wait_for(lambda: device.anomaly.look()["camera"]["state"] == "lost")
    eye.faults.trigger("reconnect")
    wait_for(lambda: device.anomaly.look()["camera"]["state"] == "up")


def test_a_scan_can_be_cancelled_and_leaves_nothing(box: Callable[..., Device]) -> None:
    device = box(camera())
    number = device.anomaly.scan(pairs=20)["survey_id"]
    wait_for(lambda: device.anomaly.state()["frames_done"])
    device.anomaly.cancel()
    wait_for(lambda: device.anomaly.state()["state"] == "idle")
    assert device.surveys() == []
    assert number > 0
