"""Two inspections of one pipe: new, gone, grown, as before."""

from __future__ import annotations

from dataclasses import replace

import pytest

from device.inspections.coding import numbered
from device.inspections.compare import compare
from device.inspections.model import Inspection, NodeRecord, Observation, PipeRecord

PIPE = PipeRecord("P", NodeRecord("A"), NodeRecord("B"), length=30.0)


def inspection(*found: Observation, direction: str = "downstream") -> Inspection:
    ends = (Observation(0.0, "BCD"), Observation(30.0, "BCE"))
    return Inspection(1, "S", PIPE, direction=direction, length=30.0, observations=numbered([*ends, *found]))  # type: ignore[arg-type]


def counts(older: Inspection, newer: Inspection) -> tuple[int, int, int, int]:
    found = compare(older, newer)
    return len(found.new), len(found.gone), len(found.grown), len(found.same)


def test_the_same_inspection_has_changed_nothing() -> None:
    one = inspection(Observation(4.0, "BCA", clock_from=3), Observation(9.0, "BBA", clock_from=12, q1=10))
    assert counts(one, one) == (0, 0, 0, 2)


def test_what_came_and_what_went() -> None:
    older = inspection(Observation(4.0, "BCA", clock_from=3), Observation(20.0, "BBA", clock_from=6))
    newer = inspection(Observation(4.3, "BCA", clock_from=3), Observation(12.0, "BAB", clock_from=12))
    found = compare(older, newer)
    assert [one.observation.code for one in found.new] == ["BAB"]
    assert [one.observation.code for one in found.gone] == ["BBA"]
    assert [(a.observation.station, b.observation.station) for a, b in found.same] == [(4.0, 4.3)]


@pytest.mark.parametrize(("before", "now", "grown"), [(10.0, 11.0, 0), (10.0, 20.0, 1), (20.0, 10.0, 0), (None, 10.0, 0)])
def test_a_larger_share_has_grown(before: float | None, now: float, grown: int) -> None:
    older, newer = (inspection(Observation(9.0, "BBA", clock_from=12, q1=size)) for size in (before, now))
    assert counts(older, newer) == (0, 0, grown, 1 - grown)


def test_a_longer_deposit_has_grown() -> None:
    def deposit(end: float) -> Inspection:
        return inspection(
            Observation(5.0, "BBC", clock_from=6, continuous="A1"), Observation(end, "BBC", clock_from=6, continuous="B1")
        )

    assert counts(deposit(7.0), deposit(9.0)) == (0, 0, 1, 0)
    assert counts(deposit(7.0), deposit(7.2)) == (0, 0, 0, 1)


def test_another_side_of_the_pipe_is_another_thing() -> None:
    assert counts(inspection(Observation(4.0, "BCA", clock_from=3)), inspection(Observation(4.0, "BCA", clock_from=9))) == (
        1,
        1,
        0,
        0,
    )
    assert counts(inspection(Observation(4.0, "BBA", clock_from=12)), inspection(Observation(4.0, "BBA", clock_from=1))) == (
        0,
        0,
        0,
        1,
    )


def test_an_inspection_from_the_other_end_is_turned_round() -> None:
    older = inspection(Observation(4.0, "BCA", clock_from=3), Observation(10.0, "BBC", clock_from=6))
    newer = inspection(Observation(26.0, "BCA", clock_from=9), Observation(20.0, "BBC", clock_from=6), direction="upstream")
    assert counts(older, newer) == (0, 0, 0, 2)


def test_pairs_are_the_best_together() -> None:
    older = inspection(Observation(4.0, "BCA", clock_from=3), Observation(4.4, "BCA", clock_from=3))
    newer = inspection(Observation(4.4, "BCA", clock_from=3), Observation(4.8, "BCA", clock_from=3))
    assert [(a.observation.station, b.observation.station) for a, b in compare(older, newer).same] == [(4.0, 4.4), (4.4, 4.8)]


def test_water_and_remarks_are_no_things() -> None:
    assert counts(inspection(), inspection(Observation(4.0, "BDD", q1=10), replace(Observation(5.0, "BDB"), remark="x"))) == (
        0,
        0,
        0,
        0,
    )
