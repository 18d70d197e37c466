"""Every fault of the virtual cameras against the device: shown with the age of the last good frame, then recovered or lost."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from device.config import Settings
from device.daemon import Device
from device.feeds.feed import CameraFeed, FeedStatus
from device.feeds.reader import FeedTiming
from drivers.depth.base import DepthSettings
from drivers.depth.librealsense import LibrealsenseCamera
from drivers.virtual.cameras import TIME_OF_FLIGHT_SERIAL, virtual_bus
from drivers.virtual.demo import Description
from drivers.virtual.depth_camera import VirtualCamera
from drivers.virtual.faults import Fault
from tests.hil.rig import PATIENCE_S, Bench

QUICK = FeedTiming(
    read_s=0.4,
    stale_s=0.8,
    read_limit_s=2.0,
    open_limit_s=6.0,
    faults_before_reopen=3,
    good_before_trust=3,
    openings_before_reset=1,
    back_off_s=(0.1,),
    repeats_before_frozen=6,
    empty_before_reopen=6,
    abandoned_limit=2,
)
SMALL = DepthSettings(224, 172, 10, color=False, serial=TIME_OF_FLIGHT_SERIAL)
"""The time-of-flight camera is the cheaper one to render."""
PIPE = Description(diameter_mm=200, water_mm=0)


@dataclass
class Plugged:
    """One virtual camera with the feed that keeps it alive."""

    twin: VirtualCamera
    feed: CameraFeed

    def wait(self, check: Callable[[FeedStatus], bool]) -> FeedStatus:
        deadline = time.monotonic() + PATIENCE_S
        while time.monotonic() < deadline:
            status = self.feed.status()
            if check(status):
                return status
            time.sleep(0.02)
        raise AssertionError(f"it never came to this; last {self.feed.status()}")

    def up(self) -> FeedStatus:
        return self.wait(lambda status: status.state == "up" and status.age_s is not None and status.age_s < QUICK.stale_s)

    def away(self) -> FeedStatus:
        """Wait until the operator sees that no good picture comes, and for how long."""
        return self.wait(lambda status: status.state != "up" and status.age_s is not None and status.age_s > QUICK.stale_s)


@pytest.fixture
def camera() -> Iterator[Plugged]:
    bus = virtual_bus(PIPE)
    twin = bus.cameras[1]
    feed = CameraFeed("box", "virtual", lambda: LibrealsenseCamera(bus, SMALL), timing=QUICK)
    feed.start()
    plugged = Plugged(twin, feed)
    try:
        plugged.up()
        yield plugged
    finally:
        twin.faults.end()
        feed.close()


@pytest.mark.parametrize(
    ("fault", "cure", "resets"),
    [
        ("freeze", "restart", 0),
        ("freeze", "reset", 1),
        ("never comes", "restart", 0),
        ("never comes", "reset", 1),
        ("wrong size", "restart", 0),
        ("wrong size", "reset", 1),
        ("all zero", "reset", 1),
        ("hang", "restart", 0),
    ],
)
def test_the_ladder_cures_it(camera: Plugged, fault: str, cure: str, resets: int) -> None:
    before = camera.up()
    camera.twin.faults.trigger(fault, cure=cure)
    seen = camera.away()
    assert seen.message.endswith((".", "?"))
    after = camera.up()
    assert after.frames > before.frames
    assert camera.twin.faults.active() == frozenset(), "cured by the ladder, not by time"
    assert camera.twin.resets >= resets
    assert after.reconnects > before.reconnects


@pytest.mark.parametrize("fault", ["freeze", "never comes", "wrong size", "all zero", "slow", "late", "hang"])
def test_it_comes_back_when_the_fault_is_over(camera: Plugged, fault: str) -> None:
    before = camera.up()
    camera.twin.faults.trigger(fault)
    seen = camera.wait(lambda status: status.state != "up")
    assert seen.message.endswith((".", "?"))
    camera.twin.faults.end(fault)
    after = camera.up()
    assert after.frames > before.frames
    assert after.message == ""


def test_a_camera_without_its_cable_is_lost_until_it_is_plugged_in(camera: Plugged) -> None:
    camera.twin.faults.trigger("disconnect")
    lost = camera.wait(lambda status: status.state == "lost" and (status.age_s or 0) > QUICK.stale_s)
    assert "cable" in lost.message or "plugged in" in lost.message
    later = camera.wait(lambda status: (status.age_s or 0) > (lost.age_s or 0) + 0.5)
    assert later.frames == lost.frames
    camera.twin.faults.trigger("reconnect")
    assert camera.up().frames > lost.frames


@pytest.mark.parametrize("fault", ["never comes", "wrong size"])
def test_what_nothing_cures_is_declared_lost_and_still_tried(camera: Plugged, fault: str) -> None:
    camera.twin.faults.trigger(fault)
    lost = camera.wait(lambda status: status.state == "lost")
    assert (lost.age_s or 0) > QUICK.stale_s
    camera.wait(lambda status: camera.twin.resets >= 2)


def test_a_camera_that_never_was_there_has_no_age() -> None:
    bus = virtual_bus(Description(faults=(Fault("disconnect"),)))
    bus.cameras[0].faults.begin()
    feed = CameraFeed("box", "virtual", lambda: LibrealsenseCamera(bus, DepthSettings(serial="virtual-stereo")), timing=QUICK)
    feed.start()
    try:
        lost = Plugged(bus.cameras[0], feed).wait(lambda status: status.state == "lost")
        assert lost.age_s is None
        assert lost.message.endswith("plugged in.")
    finally:
        feed.close()


def test_a_timed_script_is_lived_through(camera: Plugged) -> None:
    """Several faults one after the other, as a script brings them, and the camera is up in the end."""
    before = camera.up()
    for name, seconds in (("freeze", 1.0), ("wrong size", 0.5), ("late", 2.0), ("never comes", 1.0), ("disconnect", 0.7)):
        camera.twin.faults.trigger(name, for_s=seconds)
        time.sleep(seconds)
    after = camera.up()
    assert after.frames > before.frames
    assert after.bad_frames > before.bad_frames
    assert after.reconnects > before.reconnects


# --- the whole device ---


def box(folder: Path, frames: int = 10) -> tuple[Bench, VirtualCamera]:
    bus = virtual_bus(PIPE)
    return Bench(folder, LibrealsenseCamera(bus, SMALL), frames=frames), bus.cameras[1]


@pytest.mark.parametrize("fault", ["garbage", "partial blackout"])
def test_pictures_that_lie_are_refused_or_right(fault: str, tmp_path: Path) -> None:
    bench, twin = box(tmp_path)
    try:
        bench.up()
        twin.faults.trigger(fault)
        time.sleep(1.0)
        survey_id = bench.device.measure()["survey_id"]
        bench.finish(survey_id)
        survey = bench.device.survey(survey_id)
        result = survey["result"]
        assert result["verdict"] == "retry" or result["diameter_mm"] == pytest.approx(200, abs=20)
        if fault == "garbage":
            assert survey["final_verdict"] == "retry"
            assert result["prompts"]
    finally:
        twin.faults.end()
        bench.close()


def test_a_camera_lost_in_mid_measurement_and_back_for_the_next(tmp_path: Path) -> None:
    bench, twin = box(tmp_path, frames=40)
    try:
        bench.up()
        survey_id = bench.device.measure()["survey_id"]
        bench.wait_for("measurement", lambda data: data["frames_done"] >= 3)
        twin.faults.trigger("disconnect")
        assert bench.finish(survey_id)["state"] == "failed"
        assert bench.device.survey(survey_id)["result"]["reasons"] == ["camera_lost"]
        away = bench.wait_for("status", lambda data: data["cameras"][0]["state"] == "lost")
        assert away["cameras"][0]["age_s"] > 0
        twin.faults.trigger("reconnect")
        bench.wait_for("status", lambda data: data["cameras"][0]["state"] == "up")
        second = bench.device.measure(frames=6)["survey_id"]
        assert bench.finish(second)["state"] == "saved"
    finally:
        twin.faults.end()
        bench.close()


def test_both_virtual_cameras_record_and_are_judged_each_by_itself(tmp_path: Path) -> None:
    device = Device(Settings(data_dir=tmp_path / "data", cameras=("virtual",), virtual_cameras=2, frames=10))
    ear = device.subscribe()
    device.start()
    try:
        deadline = time.monotonic() + PATIENCE_S
        while not all(one["state"] == "up" for one in device.status()["cameras"]):
            assert time.monotonic() < deadline, device.status()
            time.sleep(0.1)
        survey_id = device.measure()["survey_id"]
        while True:
            event = ear.get(PATIENCE_S)
            assert event is not None
            if event.name == "measurement" and event.data["state"] in ("saved", "failed"):
                break
        recordings = device.survey(survey_id)["recordings"]
        assert len({recording["camera"] for recording in recordings}) == 2
        for recording in recordings:
            assert recording["result"]["diameter_mm"] == pytest.approx(300, abs=20)
    finally:
        device.close()
