"""The whole device on the bench: aim, measure, cancel, lose a camera, lose a worker, lose the power."""

from __future__ import annotations

import os
import signal
import sqlite3
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from device.config import Settings
from device.daemon import Device
from device.errors import Busy, Invalid, NotFound, StorageFull, StoreUnusable
from tests.hil.rig import Bench, PipeCamera
from tests.unit.device.device_doubles import ScriptedCamera, eventually, slow_no_fit

Open = Callable[..., Bench]


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Open]:
    opened: list[Bench] = []

    def make(*cameras: Any, **options: Any) -> Bench:
        opened.append(Bench(tmp_path / "data", *cameras, **options))
        return opened[-1]

    yield make
    for one in opened:
        one.close()


def test_aiming_shows_a_live_diameter_with_picture_and_cloud(bench: Open) -> None:
    box = bench(PipeCamera("front")).up()
    live = box.wait_for("live", lambda data: data["diameter_mm"] is not None)
    assert live["camera"] == "front"
    assert live["diameter_mm"] == pytest.approx(200, abs=10)
    assert live["age_s"] < 3.0
    assert box.device.live() is not None
    for kind in ("depth", "color"):
        picture = box.device.picture(kind)
        assert picture is not None
        assert picture.startswith(b"\xff\xd8")
    cloud = box.device.cloud(None)
    assert 100 < len(cloud["points"]) <= 3000
    assert len(cloud["inlier"]) == len(cloud["points"])
    assert cloud["cylinder"]["radius"] == pytest.approx(0.1, abs=0.005)


def test_measure_is_durable_before_it_is_said_to_be(bench: Open, tmp_path: Path) -> None:
    box = bench(PipeCamera("front")).up()
    pipe = box.device.places.create_pipe({"name": "H1", "material": "concrete", "reference_dn": 200})
    survey_id = box.device.measure(pipe_id=pipe["id"])["survey_id"]
    end = box.finish(survey_id)
    assert (end["state"], end["frames_done"], end["frames_wanted"]) == ("saved", 12, 12)
    with sqlite3.connect(f"file:{tmp_path}/data/borescout.db?mode=ro", uri=True) as onlooker:  # another program sees it too
        assert onlooker.execute("SELECT state FROM surveys WHERE id = ?", (survey_id,)).fetchone() == ("saved",)
    survey = box.device.survey(survey_id)
    assert survey["state"] == "saved"
    assert survey["result"]["diameter_mm"] == pytest.approx(200, abs=5)
    assert survey["result"]["camera"] == "front"
    assert survey["recordings"][0]["frames"] == 12
    assert survey["pipe"]["name"] == "H1"
    assert survey["result"]["reference"] is not None
    assert len(box.device.cloud(survey_id)["points"]) > 100
    for kind in ("depth", "color"):
        picture = box.device.survey_picture(survey_id, kind)
        assert picture is not None
        assert picture.startswith(b"\xff\xd8")
    with pytest.raises(NotFound):
        box.device.survey_picture(99, "color")
    assert [row["id"] for row in box.device.surveys(pipe_id=pipe["id"])] == [survey_id]
    assert box.device.status()["survey"]["state"] == "idle"


def test_live_values_go_on_during_a_measurement(bench: Open) -> None:
    box = bench(PipeCamera("front", fps=20), frames=60).up()
    survey_id = box.device.measure()["survey_id"]
    lives = 0
    begun = time.monotonic()
    while True:
        event = box.ear.get(5.0)
        assert event is not None
        lives += event.name == "live"
        if event.name == "measurement" and event.data["state"] == "saved":
            break
    assert event.data["survey_id"] == survey_id
    assert lives >= 1.5 * (time.monotonic() - begun)  # 4 a second are meant; the machine is shared


def test_only_one_measurement_at_a_time(bench: Open) -> None:
    box = bench(PipeCamera("front", fps=10), frames=100).up()
    survey_id = box.device.measure()["survey_id"]
    with pytest.raises(Busy, match="under way"):
        box.device.measure()
    with pytest.raises(Busy):
        box.device.delete_survey(survey_id)
    box.device.cancel()
    assert box.finish(survey_id)["state"] == "cancelled"


@pytest.mark.parametrize("delay_s", [0.0, 0.3])
def test_cancel_leaves_nothing_behind_and_the_next_measurement_works(bench: Open, delay_s: float) -> None:
    box = bench(PipeCamera("front", fps=20)).up()
    survey_id = box.device.measure(frames=200)["survey_id"]
    time.sleep(delay_s)
    box.device.cancel()
    assert box.finish(survey_id)["state"] == "cancelled"
    with pytest.raises(NotFound):
        box.device.survey(survey_id)
    assert box.device.surveys() == []
    assert box.finish(box.device.measure(frames=6)["survey_id"])["state"] == "saved"


def test_cancel_while_computing(bench: Open) -> None:
    box = bench(PipeCamera("front", fps=100), estimate=slow_no_fit).up()
    survey_id = box.device.measure(frames=10)["survey_id"]
    box.wait_for("measurement", lambda data: data["state"] == "computing" or data["frames_done"] >= 8)
    box.device.cancel()
    assert box.finish(survey_id)["state"] == "cancelled"


@pytest.mark.parametrize("fault", ["gone", "silent", "stuck"])
def test_a_camera_that_dies_in_mid_measurement_is_a_clean_failure_with_a_prompt(bench: Open, fault: str) -> None:
    camera = PipeCamera("front", fps=20)
    box = bench(camera).up()
    survey_id = box.device.measure(frames=300)["survey_id"]
    box.wait_for("measurement", lambda data: data["frames_done"] >= 5)
    camera.fault = fault
    end = box.finish(survey_id)
    assert end["state"] == "failed"
    assert end["message"].endswith(".")
    prompt = box.wait_for("prompt")
    assert prompt["code"] == "camera_lost"
    survey = box.device.survey(survey_id)
    assert survey["state"] == "failed"
    assert survey["result"]["reasons"] == ["camera_lost"]
    assert survey["final_verdict"] == "retry"
    camera.fault = ""
    camera.free()
    box.wait_for("status", lambda data: data["cameras"][0]["state"] == "up")
    assert box.finish(box.device.measure(frames=6)["survey_id"])["state"] == "saved"


def test_without_any_camera_a_measurement_fails_at_once_and_says_why(bench: Open) -> None:
    box = bench(ScriptedCamera("frame", missing=10**9))
    box.wait_for("status", lambda data: data["cameras"][0]["state"] == "lost")
    end = box.finish(box.device.measure()["survey_id"])
    assert end["state"] == "failed"
    assert box.device.live() is None
    assert box.device.picture("depth") is None
    assert box.device.cloud(None)["points"] == []


def test_a_covered_window_is_told_as_such_and_a_failed_survey_can_be_tried_again(bench: Open) -> None:
    camera = ScriptedCamera("empty")
    box = bench(camera)
    box.wait_for("status", lambda data: data["cameras"][0]["bad_frames"] > 5)
    survey_id = box.device.measure(frames=5)["survey_id"]
    assert box.finish(survey_id)["state"] == "failed"
    assert box.device.survey(survey_id)["result"]["reasons"] == ["few_points"]
    box.device.measure(survey_id=survey_id)
    box.device.cancel()
    assert box.finish(survey_id)["state"] == "cancelled"
    assert box.device.survey(survey_id)["state"] == "failed"


def test_of_two_cameras_the_surer_one_is_taken_and_both_are_kept(bench: Open) -> None:
    sharp, rough = PipeCamera("sharp", noise=0.01), PipeCamera("rough", noise=0.15)
    box = bench(rough, sharp).up()
    survey_id = box.device.measure()["survey_id"]
    assert box.finish(survey_id)["state"] == "saved"
    survey = box.device.survey(survey_id)
    assert {recording["camera"] for recording in survey["recordings"]} == {"sharp", "rough"}
    assert survey["result"]["camera"] == "sharp"


def test_one_camera_of_two_may_die(bench: Open) -> None:
    steady, dying = PipeCamera("steady", fps=20), PipeCamera("dying", fps=20)
    box = bench(dying, steady).up()
    survey_id = box.device.measure(frames=40)["survey_id"]
    box.wait_for("measurement", lambda data: data["frames_done"] >= 3)
    dying.fault = "gone"
    assert box.finish(survey_id)["state"] == "saved"
    survey = box.device.survey(survey_id)
    assert [recording["camera"] for recording in survey["recordings"]] == ["steady"]
    assert "dying" in next(warning["text"] for warning in survey["result"]["warnings"] if warning["code"] == "camera_lost")


def test_a_wide_pipe_asks_for_a_second_position_which_continues_the_survey(bench: Open) -> None:
    box = bench(PipeCamera("front", radius_m=0.2, noise=0.005)).up()
    survey_id = box.device.measure()["survey_id"]
    box.finish(survey_id)
    first = box.device.survey(survey_id)
    assert first["result"]["reasons"] == ["second_position"], first["result"]["reasons"]
    assert first["recordings"][0]["position"] == "entrance"
    assert box.device.measure(survey_id=survey_id)["survey_id"] == survey_id
    assert box.finish(survey_id)["state"] == "saved"
    second = box.device.survey(survey_id)
    assert [recording["position"] for recording in second["recordings"]] == ["entrance", "middle"]
    assert second["final_verdict"] == "accept"


def test_a_second_position_that_fails_leaves_the_first(bench: Open) -> None:
    camera = PipeCamera("front", radius_m=0.2, noise=0.005, fps=20)
    box = bench(camera).up()
    survey_id = box.device.measure()["survey_id"]
    box.finish(survey_id)
    before = box.device.survey(survey_id)
    box.device.measure(survey_id=survey_id, frames=300)
    box.wait_for("measurement", lambda data: data["frames_done"] >= 5)
    camera.fault = "gone"
    assert box.finish(survey_id)["state"] == "failed"
    assert box.device.survey(survey_id) == before


def test_a_killed_worker_costs_nothing_but_time(bench: Open) -> None:
    box = bench(PipeCamera("front", fps=20)).up()
    survey_id = box.device.measure(frames=40)["survey_id"]
    box.wait_for("measurement", lambda data: data["frames_done"] >= 5)
    for pid in box.pool.pids:
        os.kill(pid, signal.SIGKILL)
    assert box.finish(survey_id)["state"] == "saved"
    assert box.device.survey(survey_id)["recordings"][0]["frames"] == 40
    assert box.device.status()["workers_replaced"] >= 1


def test_the_operators_word_changes_the_final_verdict(bench: Open) -> None:
    box = bench(PipeCamera("front")).up()
    survey_id = box.device.measure()["survey_id"]
    box.finish(survey_id)
    assert box.device.survey(survey_id)["result"]["verdict"] == "accept"
    answered = box.device.answer(survey_id, {"cloud_is_pipe": False, "verdict": "retry", "by": "Ada", "note": ""})
    assert (answered["final_verdict"], answered["verdict_by"]) == ("retry", "operator")
    with pytest.raises(Invalid):
        box.device.answer(survey_id, {"verdict": "perhaps"})
    box.device.delete_survey(survey_id)
    assert box.device.surveys() == []
    assert box.device.restore_survey(survey_id)["final_verdict"] == "retry"


@pytest.mark.parametrize(
    "arguments", [{"frames": 0}, {"frames": 10**6}, {"position": "roof"}, {"pipe_id": 99}, {"survey_id": 99}]
)
def test_a_measurement_that_cannot_be_is_refused(bench: Open, arguments: dict[str, Any]) -> None:
    box = bench(ScriptedCamera("timeout"))
    with pytest.raises((Invalid, NotFound)):
        box.device.measure(**arguments)
    assert box.device.status()["survey"]["state"] == "idle"


def test_with_too_little_room_nothing_is_measured(bench: Open, monkeypatch: pytest.MonkeyPatch) -> None:
    box = bench(ScriptedCamera("timeout"))
    monkeypatch.setattr(Device, "_free_mb", lambda self: 3)
    with pytest.raises(StorageFull, match="make room"):
        box.device.measure()


def test_a_disk_that_fills_up_in_mid_measurement_is_told_and_leaves_no_half_survey(bench: Open) -> None:
    box = bench(PipeCamera("front", fps=20)).up()
    survey_id = box.device.measure(frames=30)["survey_id"]
    with box.device._store._database.read() as connection:
        pages = connection.execute("PRAGMA page_count").fetchone()[0]
        connection.execute(f"PRAGMA max_page_count = {pages}")
    end = box.finish(survey_id)
    assert end["state"] == "failed"
    assert "disk is full" in end["message"]
    assert box.device.surveys() == []


def test_two_daemons_do_not_share_a_data_folder(bench: Open, tmp_path: Path) -> None:
    bench(ScriptedCamera("timeout"))
    with pytest.raises(StoreUnusable, match=rf"process {os.getpid()}\) is using"):
        Device(Settings(data_dir=tmp_path / "data"), feeds=[])


def test_closing_in_mid_measurement_is_quick_clean_and_leaves_no_thread(bench: Open, tmp_path: Path) -> None:
    before = set(threading.enumerate())
    box = bench(PipeCamera("front", fps=20)).up()
    box.device.measure(frames=300)
    pids = box.pool.pids
    begun = time.monotonic()
    box.close()
    assert time.monotonic() - begun < 15.0
    assert eventually(lambda: set(threading.enumerate()) <= before)
    assert eventually(lambda: not any(Path(f"/proc/{pid}").exists() for pid in pids))
    again = Device(Settings(data_dir=tmp_path / "data"), feeds=[])
    assert again.surveys() == []
    again.close()


def test_the_browsers_clock_dates_what_was_measured(bench: Open) -> None:
    box = bench(PipeCamera("front")).up()
    survey_id = box.device.measure(frames=6)["survey_id"]
    box.finish(survey_id)
    assert box.device.survey(survey_id)["created"] is None
    box.device.set_clock(1_777_600_000_000)
    assert box.device.survey(survey_id)["created"].startswith("2026-05-01T01:4")
    assert box.device.status()["clock"] == {"source": "browser"}
