"""A chamber mapped by the whole box: live twins on their wires, map, store, recording, replay, cancel, power cut."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from device.clock import Clock
from device.config import Settings, StructureSettings
from device.daemon import Device
from device.errors import Busy, Invalid
from device.replay.survey import replay
from device.store import Store
from device.structure.course import Course, CourseSetup
from device.structure.export import KINDS
from drivers.navigation.readings import Attitude
from drivers.navigation.scans import Scan
from drivers.virtual.chamber import structure
from drivers.virtual.chamber.structure import SMALL
from tests.hil.rig import PATIENCE_S
from tests.pairing import PIN


@pytest.fixture
def device(tmp_path: Path) -> Iterator[Device]:
    settings = Settings(
        data_dir=tmp_path / "data",
        pin=PIN,
        structure=StructureSettings(scanner="virtual", file=Path(structure.__file__).with_name(SMALL)),
    )
    made = Device(settings, feeds=[], clock=Clock(tmp_path / "no-machine")).start()
    yield made
    made.close()


def wait_for(device: Device, check: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
    """The state of the survey once it fits."""
    deadline = time.monotonic() + 3 * PATIENCE_S
    while time.monotonic() < deadline:
        state = device.structure.state()
        if check(state):
            return state
        time.sleep(0.1)
    raise AssertionError(f"the survey never came so far: {state}")


def test_a_chamber_is_mapped_stored_recorded_and_computed_again(device: Device) -> None:
    node = device.places.create_node("Pump station 4")
    survey = device.structure.begin(node["id"])["survey_id"]
    with pytest.raises(Busy):
        device.structure.begin()
    with pytest.raises(Busy):
        device.delete_survey(survey)
    state = wait_for(device, lambda state: state["scans"] >= 6 and state["pipes"] >= 3)
    assert len(device.structure.map(survey)["track"]) >= state["scans"], "what is told has been stored"
    assert state["sigma_m"] < 0.1
    assert device.structure.end() == {"survey_id": survey}
    wait_for(device, lambda state: state["state"] == "idle")

    found = device.structure.map(survey)
    assert (found["state"], found["node"]["name"]) == ("saved", "Pump station 4")
    assert (found["verdict"] == "accept") == (found["prompts"] == []), "a refusal says why"
    assert {thing["class"] for thing in found["objects"]} <= {"tee", "elbow", "3-way valve", "ball valve", "socket"}
    tees = [thing for thing in found["objects"] if len(thing["pipes"]) == 3]
    assert tees, "the tee with its three pipes"
    row = device.surveys()[0]
    assert (row["id"], row["kind"], row["node"], row["pipes"]) == (survey, "structure", "Pump station 4", len(found["pipes"]))
    for kind in KINDS:
        data, name, _ = device.structure.file(survey, kind.removeprefix("."))
        assert len(data) > 500, name
        assert name.endswith(kind)

    files = device.recordings.of(survey)["files"]
    assert files
    again = replay(device.recordings.file(survey, files[0]["take"], files[0]["part"]))
    assert again.frames == found["scans"]
    assert (again.missing, again.equal) == (0, True), again.differences[:3]


def test_cancel_leaves_nothing_and_a_power_cut_what_was_mapped(device: Device, tmp_path: Path) -> None:
    survey = device.structure.begin()["survey_id"]
    device.structure.cancel()
    wait_for(device, lambda state: state["state"] == "idle")
    assert all(row["id"] != survey for row in device.surveys())
    with pytest.raises(Invalid):
        device.structure.end()

    survey = device.structure.begin()["survey_id"]
    wait_for(device, lambda state: state["scans"] >= 2)
    with_map = device.structure.map(survey)
    store = Store(tmp_path / "data", Clock(tmp_path / "no-machine"))  # what another process would find after a cut
    try:
        assert store.structures.interrupt_unfinished() == 1
        left = store.structures.map(survey)
    finally:
        store.close()
    assert left["state"] == "interrupted"
    assert len(left["pipes"]) >= len(with_map["pipes"]) > 0


def test_without_attitude_no_scan_counts() -> None:
    setup = CourseSetup(((1.0, 0, 0), (0, 1.0, 0), (0, 0, 1.0)), (0.0, 0, 0), 0.0315, False, depths=False)
    course = Course(setup)
    scan = Scan(5.0, np.ones((100, 3)))
    assert not course.take(scan)
    course.take(Attitude(5.0, (0.0, 0.0, 0.0), None, 0.005))
    assert not course.take(Scan(7.0, scan.points))
    assert course.left_out == 1
