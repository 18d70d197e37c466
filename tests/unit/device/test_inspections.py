"""Findings become coded observations, and rules say what does not fit together."""

from __future__ import annotations

from dataclasses import replace

import pytest

from device.inspections.codes import codes, of_class
from device.inspections.coding import hour, numbered, observations
from device.inspections.model import Inspection, NodeRecord, Observation, PipeRecord
from device.inspections.rules import faults
from tests.unit.device.inspections import landmark, whole


def lines(inspection: Inspection) -> list[str]:
    return [f"{o.station:g} {o.code} {o.ch1}{o.ch2} {o.continuous}".strip() for o in inspection.observations]


def test_everything_found_lies_between_start_and_finish_in_order() -> None:
    assert lines(whole()) == [
        "0 BCD",
        "1 BAA A",
        "1 BDD",
        "4.2 BCA ZA",
        "9 BBC Z A1",
        "11 BBC Z B1",
        "15 BBB Z",
        "28.3 BCE",
    ]
    assert [o.number for o in whole().observations] == list(range(1, 9))
    assert faults(whole()) == []


def test_start_and_finish_are_named_in_the_direction_of_the_inspection() -> None:
    found = whole().observations
    assert (found[0].remark, found[-1].remark) == ("M2", "M1")


def test_what_people_said_counts() -> None:
    base = replace(
        whole(), landmarks=(landmark(1, "roots", 5.0, clock=3.0, corrected={"class": "deposit", "chainage_m": 6.0}),)
    )
    (found,) = [o for o in observations(base) if o.source == "landmark 1"]
    assert (found.code, found.station) == ("BBC", 6.0)


def test_candidates_rejected_ones_and_classes_without_a_code_are_left_out() -> None:
    marks = (
        landmark(1, "connection", 3.0, clock=3.0, status="candidate"),
        landmark(2, "connection", 4.0, clock=3.0, decision="rejected"),
        landmark(3, "rubber duck", 5.0),
    )
    assert not [o for o in observations(replace(whole(), landmarks=marks)) if o.source.startswith("landmark")]


def test_an_inspection_that_ends_early_says_so() -> None:
    short = replace(whole(), length=12.0, observations=())
    last = observations(short)[-1]
    assert (last.code, last.station) == ("BDC", 12.0)


def test_a_refused_diameter_gives_no_observation() -> None:
    refused = replace(whole(), diameters=(replace(whole().diameters[0], verdict="retry"),))
    assert not [o for o in observations(refused) if o.code in ("BAA", "BDD")]


@pytest.mark.parametrize(("clock", "expected"), [(12.0, 12), (0.4, 12), (12.4, 12), (12.6, 1), (5.5, 6), (6.4, 6), (11.6, 12)])
def test_clock_positions_are_whole_hours_from_1_to_12(clock: float, expected: int) -> None:
    assert hour(clock) == expected


def test_every_class_of_the_detector_has_a_code() -> None:
    for label in ("connection", "deposit", "displaced joint", "fracture", "roots", "obstacle", "broken pipe"):
        coded = of_class(label)
        assert coded is not None
        code = codes()[coded["code"]]
        assert coded.get("ch1", "") in ("", *code.ch1)
        assert coded.get("ch2", "") in ("", *code.ch2)


def broken(*found: Observation, length: float | None = 20.0) -> list[str]:
    pipe = PipeRecord("P", NodeRecord("A"), NodeRecord("B"), length=length)
    ends = (Observation(0.0, "BCD"), Observation(20.0, "BCE"))
    return faults(Inspection(1, "S", pipe, length=length, observations=numbered([*ends, *found])))


@pytest.mark.parametrize(
    ("observation", "says"),
    [
        (Observation(3.0, "XYZ"), "not in the table"),
        (Observation(3.0, "BCA"), "needs a clock position"),
        (Observation(3.0, "BBC", clock_from=13), "from 1 to 12"),
        (Observation(3.0, "BBC", clock_from=0), "from 1 to 12"),
        (Observation(3.0, "BBC", clock_to=3), "without one from"),
        (Observation(3.0, "BBC", q1=101.0), "cannot be"),
        (Observation(3.0, "BAJ", q1=-1.0), "below zero"),
        (Observation(3.0, "BBA", ch1="Q"), "is not one of"),
        (Observation(3.0, "BBC", continuous="A1"), "never ends"),
        (Observation(3.0, "BBC", continuous="B1"), "without having begun"),
        (Observation(3.0, "BBC", continuous="C1"), "no mark"),
        (Observation(3.0, "BBC", photo="none.jpg"), "is not there"),
        (Observation(20.2, "BBC"), "lies outside the length"),
    ],
)
def test_rules(observation: Observation, says: str) -> None:
    assert any(says in fault for fault in broken(observation)), broken(observation)


def test_a_continuous_defect_keeps_its_code_and_begins_once() -> None:
    first, again = Observation(2.0, "BBC", continuous="A1"), Observation(3.0, "BBC", continuous="A1")
    assert any("has begun already" in fault for fault in broken(first, again, Observation(4.0, "BBC", continuous="B1")))
    assert any("began as another code" in fault for fault in broken(first, Observation(4.0, "BBA", continuous="B1")))
    assert broken(first, Observation(4.0, "BBC", continuous="B1")) == []


def test_an_inspection_needs_its_ends() -> None:
    pipe = PipeRecord("P", NodeRecord("A"), NodeRecord("A"))
    said = " ".join(faults(Inspection(1, "S", pipe, observations=(Observation(1.0, "BBC"),))))
    assert "start node (BCD)" in said
    assert "finish node (BCE)" in said
    assert "same node" in said
    assert any("no observation" in fault for fault in faults(Inspection(1, "S", pipe)))
