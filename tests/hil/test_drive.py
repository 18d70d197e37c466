"""The landmarks survey on a bench: a drive, and what befalls it."""

from __future__ import annotations

import math
import sqlite3
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from device.errors import Busy, Invalid, NotFound
from device.landmarks.pipeline import LandmarkPipeline
from estimators.landmarks.projection import clock_hour
from tests.hil.crawler_rig import Bench, Thing

THINGS = (
    Thing("connection", 1.5, -2.4),
    Thing("connection", 3.1, 0.2),
    Thing("deposit", 4.4, math.pi / 2),
    Thing("connection", 6.0, -0.7),
    Thing("roots", 7.2, 2.8),
)
END_M = 8.0

Open = Callable[..., Bench]


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Open]:
    opened: list[Bench] = []

    def make(things: Any = THINGS, **options: Any) -> Bench:
        opened.append(Bench(tmp_path / "data", things, **options).up())
        return opened[-1]

    yield make
    for one in opened:
        one.close()


def end(box: Bench, survey_id: int, **arguments: Any) -> dict[str, Any]:
    assert box.device.drive.end(**arguments) == {"survey_id": survey_id}
    box.finished()
    return box.device.drive.map(survey_id)


def check(found: dict[str, Any], offset: float, things: Any = THINGS, within_m: float = 0.2) -> None:
    """Each landmark once, none lost, where it is: to so many metres beside what the drive says that it does
    not know, for the smoother takes no tether for better than two per cent."""
    rows = found["landmarks"]
    assert [row["class"] for row in rows] == [thing.label for thing in things]
    for row, thing in zip(rows, things, strict=True):
        middle, sigma = (row["chainage_m"] + row["chainage_to_m"]) / 2, row["sigma_chainage_m"]
        assert sigma < within_m
        assert middle == pytest.approx(thing.chainage - offset, abs=within_m + sigma)
        apart = (row["clock"] - clock_hour(thing.angle) + 6) % 12 - 6
        assert abs(apart) < 0.6
        assert row["status"] == "passed"


def parked(open_bench: Open, **options: Any) -> Bench:
    """A box whose crawler waits at chainage 0."""
    box = open_bench(**options)
    box.moving = False
    box.position = 0.0
    box.wait(lambda: abs(box.device.drive.state()["encoder"]["counts"]) < 1)
    return box


def test_a_drive_finds_each_landmark_once_and_where_it_is(bench: Open, tmp_path: Path) -> None:
    box = parked(bench)
    pipe = box.device.places.create_pipe({"name": "H1", "reference_dn": 300})
    survey_id = box.device.drive.begin(pipe["id"], "downstream")["survey_id"]
    box.moving = True
    box.drive_to(3.3)
    state = box.device.drive.state()
    assert (state["state"], state["survey_id"], state["pipe_id"]) == ("driving", survey_id, pipe["id"])
    assert state["chainage_m"] == pytest.approx(box.position, abs=0.3)
    assert state["speed_mps"] == pytest.approx(0.4, abs=0.1)
    assert state["counts"]["passed"] + state["counts"]["confirmed"] >= 2
    for overlay, heatmap in ((False, None), (True, None), (True, "roots"), (False, "connection")):
        picture = box.device.drive.picture(overlay, heatmap)
        assert picture is not None
        assert picture.startswith(b"\xff\xd8")
    box.drive_to(END_M)
    found = end(box, survey_id)
    check(found, 0.0)
    assert (found["state"], found["smoothed"], found["radius_m"]) == ("saved", True, 0.15)
    assert found["to_m"] == pytest.approx(END_M, abs=0.5)
    assert [fault for fault in found["faults"] if fault["what"] != "slip_found"] == []
    for row in found["landmarks"]:
        thumbnail = box.device.drive.thumbnail(survey_id, row["id"])
        assert thumbnail is not None
        assert thumbnail.startswith(b"\xff\xd8")
        explained = box.device.drive.thumbnail(survey_id, row["id"], row["class"])
        assert explained is not None
        assert explained.startswith(b"\xff\xd8")
    with pytest.raises(Invalid, match="There is no heatmap of cracks"):
        box.device.drive.picture(heatmap="cracks")
    assert [row["landmarks"] for row in box.device.surveys()] == [len(THINGS)]
    with sqlite3.connect(f"file:{tmp_path}/data/borescout.db?mode=ro", uri=True) as onlooker:
        assert onlooker.execute("SELECT state FROM surveys").fetchall() == [("saved",)]
        assert onlooker.execute("SELECT count(*) FROM drive_log").fetchone()[0] >= 5


def test_what_is_shown_as_stored_is_stored_while_the_drive_goes_on(bench: Open, tmp_path: Path) -> None:
    box = parked(bench, period_s=0.02)
    survey_id = box.device.drive.begin()["survey_id"]
    box.moving = True
    box.drive_to(3.6)
    box.wait(lambda: len(box.device.drive.map(survey_id)["landmarks"]) >= 2)
    so_far = box.device.drive.map(survey_id)
    assert (so_far["state"], so_far["smoothed"]) == ("measuring", False)
    assert box.device.surveys() == []  # the list has what is finished
    box.close()  # the power is cut nicely
    with sqlite3.connect(tmp_path / "data" / "borescout.db") as onlooker:
        assert onlooker.execute("SELECT state FROM surveys").fetchone() == ("interrupted",)
        assert onlooker.execute("SELECT count(*) FROM landmarks").fetchone()[0] >= 2


def test_stream_and_encoder_die_and_return_and_nothing_is_lost_or_doubled(bench: Open) -> None:
    box = parked(bench)
    survey_id = box.device.drive.begin()["survey_id"]
    box.moving = True
    box.drive_to(2.0)
    box.grabber.fault = "lost"
    box.wait(lambda: "signal_lost" in [prompt["code"] for prompt in box.device.drive.state()["prompts"]])
    box.grabber.fault = ""
    box.drive_to(3.6)
    box.encoder.fault = "unplugged"
    box.wait(lambda: box.device.drive.state()["encoder"]["state"] != "up")
    box.moving = False  # the operator is told to stop, and does
    box.wait(lambda: "encoder_lost" in [prompt["code"] for prompt in box.device.drive.state()["prompts"]])
    box.encoder.fault = ""
    box.wait(lambda: box.device.drive.state()["encoder"]["state"] == "up")
    box.moving = True
    box.drive_to(5.0)
    box.counter_offset = -1.3  # the counter jumps back
    box.drive_to(5.5)
    for _ in range(3):
        box.grabber.fault = "stall"
        box.wait(lambda: not box.grabber.fault)
    box.drive_to(END_M)
    found = end(box, survey_id)
    check(found, 0.0, within_m=0.25)  # the tether was silent for a while
    what = [fault["what"] for fault in found["faults"]]
    for fault in ("grabber_lost", "grabber_back", "encoder_lost", "encoder_back", "encoder_jump"):
        assert what.count(fault) == 1, (fault, found["faults"])
    assert all(fault["text"].endswith(".") for fault in found["faults"])


def test_the_page_waits_while_the_map_is_closed(bench: Open, monkeypatch: pytest.MonkeyPatch) -> None:
    """Suspicions are dropped at the end of a drive; whoever counted them meanwhile would run out of the list."""
    box = parked(bench, period_s=0.02)
    waited: list[bool] = []
    close = LandmarkPipeline.close

    def looked_at(pipeline: LandmarkPipeline) -> None:
        asking = threading.Thread(target=box.device.drive.state, daemon=True)
        asking.start()
        asking.join(0.3)
        waited.append(asking.is_alive())
        close(pipeline)

    monkeypatch.setattr(LandmarkPipeline, "close", looked_at)
    survey_id = box.device.drive.begin()["survey_id"]
    box.moving = True
    box.drive_to(1.0)
    end(box, survey_id)
    assert waited[0]


def test_marking_by_hand_and_what_is_said_of_a_landmark(bench: Open) -> None:
    box = parked(bench)
    survey_id = box.device.drive.begin(start_chainage_m=10.0)["survey_id"]
    box.moving = True
    box.drive_to(2.2)
    mark = box.device.drive.mark("patch", 4.0, "looks new")
    assert (mark["marked_by_hand"], mark["class"], mark["clock"], mark["note"]) == (True, "patch", 4.0, "looks new")
    assert mark["chainage_m"] == pytest.approx(10.0 + box.position, abs=0.4)
    rows = box.device.drive.map(survey_id)["landmarks"]
    assert mark["id"] in [row["id"] for row in rows]  # it is stored already
    connection = next(row for row in rows if row["class"] == "connection")
    said = box.device.drive.change_landmark(survey_id, connection["id"], {"decision": "confirmed", "clock": 9.0, "by": "Ada"})
    assert said["corrected"] == {"clock": 9.0}
    box.drive_to(3.4)
    found = end(box, survey_id)
    kept = {row["id"]: row for row in found["landmarks"]}
    assert kept[connection["id"]]["decision"] == "confirmed"
    assert kept[connection["id"]]["clock"] != 9.0  # the measured value stays beside it
    assert kept[connection["id"]]["chainage_m"] == pytest.approx(11.5, abs=0.15)
    assert kept[mark["id"]]["marked_by_hand"]
    with pytest.raises(NotFound):
        box.device.drive.change_landmark(survey_id, 999, {"note": "?"})


def test_pause_cancel_and_one_drive_at_a_time(bench: Open) -> None:
    box = parked(bench)
    survey_id = box.device.drive.begin()["survey_id"]
    with pytest.raises(Busy):
        box.device.drive.begin()
    with pytest.raises(Busy):
        box.device.drive.zero_encoder()
    with pytest.raises(Busy):
        box.device.delete_survey(survey_id)
    box.device.drive.pause()
    before = box.device.drive.state()["frames"]
    box.moving = True
    box.drive_to(1.0)
    assert box.device.drive.state()["frames"] <= before + 2
    assert box.device.drive.state()["chainage_m"] > 0.5  # the way goes on being counted
    box.device.drive.resume()
    box.wait(lambda: box.device.drive.state()["frames"] > before + 10)
    box.device.drive.cancel()
    box.finished()
    with pytest.raises(NotFound):
        box.device.drive.map(survey_id)
    for refused in (box.device.drive.pause, box.device.drive.end, lambda: box.device.drive.mark("roots")):
        with pytest.raises(Invalid, match="No drive is under way"):
            refused()


def test_the_tether_is_zeroed_turned_and_calibrated(bench: Open) -> None:
    box = parked(bench)
    assert box.device.drive.zero_encoder(2.0)["metres"] == pytest.approx(2.0, abs=0.01)
    turned = box.device.drive.set_encoder({"direction": -1})
    assert (turned["direction"], turned["counts_per_metre"]) == (-1, 1000.0)
    assert turned["metres"] == pytest.approx(2.0, abs=0.01)  # it stands where it stood
    with pytest.raises(Invalid, match="first point"):
        box.device.drive.calibrate_encoder("end", 5.0)
    box.device.drive.calibrate_encoder("start")
    with pytest.raises(Invalid, match="steps"):
        box.device.drive.calibrate_encoder("end", 5.0)  # it has not moved
    box.position = 5.0
    box.wait(lambda: box.device.drive.state()["encoder"]["counts"] == pytest.approx(5000, abs=1))
    done = box.device.drive.calibrate_encoder("end", 4.9)
    assert (done["counts_per_metre"], done["direction"]) == (pytest.approx(5000 / 4.9, rel=1e-3), 1)
    assert box.tether is not None
    assert box.device._store.remembered.get("encoder")["counts_per_metre"] == done["counts_per_metre"]


def test_a_disk_that_fills_up_is_told_and_the_drive_goes_on(bench: Open) -> None:
    box = parked(bench)
    survey_id = box.device.drive.begin()["survey_id"]
    box.moving = True
    box.drive_to(1.0)
    with box.device._store._database.read() as connection:
        pages = connection.execute("PRAGMA page_count").fetchone()[0]
        connection.execute(f"PRAGMA max_page_count = {pages}")
    box.wait(lambda: "storage_full" in [prompt["code"] for prompt in box.device.drive.state()["prompts"]])
    box.drive_to(4.0)
    with box.device._store._database.read() as connection:
        connection.execute("PRAGMA max_page_count = 1000000")
    box.wait(lambda: "storage_full" not in [prompt["code"] for prompt in box.device.drive.state()["prompts"]])
    found = end(box, survey_id)
    assert len(found["landmarks"]) >= 2  # what could not be written waited
