"""A box left alone with a crawler: what it began and ended by itself, through a power cut."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from device.clock import Clock
from device.daemon import Device
from device.errors import StorageFull
from device.store import Store
from tests.bench.unattended import GRACE_S, compare, read
from tests.crash.shim import ROOT
from tests.hil.crawler_rig import Bench
from tests.hil.unattended_rig import TourTime, box, two_pipes


def test_two_pipes_and_a_power_cut_are_two_surveys_and_the_cut_one_goes_on(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "tests.hil.unattended_rig", str(tmp_path), "--tour", "two", "--scale", "8"]
    subprocess.run([*command, "--cut", "70", "4"], cwd=ROOT, check=True, timeout=280)
    parts, entries = read(tmp_path)
    rows, invented = compare(two_pipes(), parts, entries)
    assert invented == []
    assert [[part.reason for part in row.parts] for row in rows] == [["node"], ["power_cut", "node"]]
    for row in rows:
        assert row.begin_off_s == pytest.approx(0.0, abs=GRACE_S)
        assert row.end_off_s == pytest.approx(0.0, abs=GRACE_S)
    states = [part.state for row in rows for part in row.parts]
    assert states == ["saved", "interrupted", "saved"]
    assert sum(part.landmarks for row in rows for part in row.parts) >= 3
    assert [entry["what"] for entry in entries].count("cut") == 1
    store = Store(tmp_path, Clock(tmp_path / "no-machine"))
    cut, on = (store.drives.map(part.survey_id) for part in rows[1].parts)
    assert on["settings"]["start_chainage_m"] == pytest.approx(cut["to_m"])  # it goes on where it was
    store.close()


@pytest.fixture
def left_alone(tmp_path: Path) -> Iterator[Callable[[], Device]]:
    opened: list[Device] = []

    def make() -> Device:
        opened.append(box(tmp_path, two_pipes(), TourTime(8.0)).start())
        return opened[-1]

    yield make
    for device in opened:
        device.close()


def test_it_can_be_switched_off_at_the_page_and_stays_so_after_a_restart(left_alone: Callable[[], Device]) -> None:
    device = left_alone()
    Bench.wait(lambda: device.unattended()["autonomy"]["survey_id"] is not None, 60)
    state = device.unattended()["autonomy"]
    assert (state["on"], state["state"], state["holds"]) == (True, "surveying", [])
    Bench.wait(lambda: device.drive.state()["chainage_m"] is not None and device.drive.state()["chainage_m"] > 1.0, 60)
    assert device.log_by_itself(False)["on"] is False
    Bench.wait(lambda: device.drive.state()["state"] == "idle", 60)
    news = device.unattended()
    assert [entry["what"] for entry in news["entries"]] == ["on", "begin", "end"]
    assert news["entries"][-1]["text"] == "Survey 1 ended. Logging by itself was switched off."
    assert news["autonomy"]["news"] == 2
    device.look_at_journal(news["entries"][-1]["id"])
    assert device.unattended()["autonomy"]["news"] == 0
    assert device.drive.map(1)["state"] == "saved"
    device.close()
    device = left_alone()
    assert device.unattended()["autonomy"]["on"] is False
    time.sleep(1.0)
    assert device.unattended()["autonomy"]["state"] == "off"
    assert device.unattended()["unsafe_shutdowns"] == 0
    assert device.drive.state()["state"] == "idle"


def test_a_box_on_a_full_disk_starts_and_stops(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    device = box(tmp_path, two_pipes(), TourTime(8.0))

    def full(*given: object, **more: object) -> None:
        raise StorageFull("The disk is full.")

    monkeypatch.setattr(device._store.journal, "switched_on", full)
    monkeypatch.setattr(device._store.journal, "add", full)
    device.start()
    Bench.wait(lambda: all(device.drive.state()[which]["state"] == "up" for which in ("grabber", "encoder")))
    assert device.status()["autonomy"]["on"]
    device.close()


def test_a_drive_by_hand_is_left_alone(left_alone: Callable[[], Device]) -> None:
    device = left_alone()
    device.log_by_itself(False)
    Bench.wait(lambda: all(device.drive.state()[which]["state"] == "up" for which in ("grabber", "encoder")))
    survey_id = device.drive.begin()["survey_id"]
    device.log_by_itself(True)
    Bench.wait(lambda: device.unattended()["autonomy"]["state"] == "aside")
    Bench.wait(lambda: device.drive.state()["chainage_m"] is not None and device.drive.state()["chainage_m"] > 1.0, 60)
    assert device.drive.state()["survey_id"] == survey_id
    device.drive.end()
    Bench.wait(lambda: device.drive.state()["state"] == "idle", 60)
    assert [entry["what"] for entry in device.unattended()["entries"]] == ["on"]
