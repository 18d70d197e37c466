"""Scans from successive places, joined along the pipe: hand-made scans whose sum is known."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from device.anomaly.along import joined, joined_bands, joined_joints, joined_regions, placed_scan
from device.clock import Clock
from device.store import Store

DEPOSIT = {
    "area_mm2": 20000,
    "peak_mm": -24.0,
    "z_m": 1.2,
    "clock": 6.0,
    "from_m": 1.05,
    "to_m": 1.35,
    "width_hours": 1.4,
    "kind": "deposit",
    "expected": False,
}


def band(first: float, score: float | None, measured: float = 0.9) -> dict[str, Any]:
    told = {"score_mm": score, "outward_mm": None, "measured": measured, "sees_mm2": round(400 * first)}
    return {"first_m": first, "last_m": round(first + 0.1, 3), **told}


def scan(survey: int, station: float | None, **found: Any) -> Any:
    return placed_scan(survey, {"regions": [], "joints": [], "bands": [], **found}, station)


def test_what_two_places_see_is_told_once_as_who_saw_most_of_it() -> None:
    # the same deposit 1.2 m ahead of 10 m, and of 10.8 m only its far end, 4 cm off by the tether
    far = scan(1, 10.0, regions=[DEPOSIT])
    near = scan(2, 10.84, regions=[{**DEPOSIT, "z_m": 0.4, "from_m": 0.3, "to_m": 0.55, "area_mm2": 9000}])
    (found,) = joined_regions(far.regions + near.regions)
    assert (found["survey"], found["chainage_m"], found["seen_from"]) == (1, 11.2, [1, 2])
    assert joined_regions(near.regions + far.regions) == [{**found, "seen_from": [1, 2]}]


@pytest.mark.parametrize(
    "other", [{"clock": 12.0}, {"peak_mm": 12.0}, {"z_m": 2.2, "from_m": 2.05, "to_m": 2.35}], ids=["crown", "loss", "further"]
)
def test_other_things_stay_things_of_their_own(other: dict[str, Any]) -> None:
    both = scan(1, 10.0, regions=[DEPOSIT]).regions + scan(2, 10.0, regions=[{**DEPOSIT, **other}]).regions
    assert [one["seen_from"] for one in joined_regions(both)] in ([[1], [2]], [[2], [1]])


def test_two_things_of_one_scan_are_two() -> None:
    assert len(joined_regions(scan(1, 10.0, regions=[DEPOSIT, DEPOSIT]).regions)) == 2


def test_what_nobody_placed_is_told_as_it_is() -> None:
    unplaced = scan(1, None, regions=[DEPOSIT], joints=[{"z_m": 0.5}], bands=[band(0.4, 1.0)])
    found = joined([unplaced, scan(2, 10.0, regions=[DEPOSIT])])
    assert [one["chainage_m"] for one in found["regions"]] == [11.2, None]
    assert [one["chainage_m"] for one in found["joints"]] == [None]
    assert (found["bands"], found["next_m"], found["from_m"]) == ([], None, None)


def test_a_joint_is_told_by_the_scan_that_was_nearest() -> None:
    far, near = scan(1, 10.0, joints=[{"z_m": 1.4, "gap_mm": 9.0}]), scan(2, 11.0, joints=[{"z_m": 0.45, "gap_mm": 12.0}])
    (joint,) = joined_joints(far.joints + near.joints)
    assert (joint["gap_mm"], joint["seen_from"]) == (12.0, [2, 1])


def test_bands_are_weighted_by_the_inverse_variance_of_their_depths() -> None:
    # one band 0.5 m off and one 1.0 m off: 2^4 = 16 to 1
    near, far = scan(1, 10.0, bands=[band(0.45, 2.0)]), scan(2, 9.5, bands=[band(0.95, 19.0)])
    told = joined_bands(near.bands + far.bands)
    assert [one["from_m"] for one in told] == [10.4, 10.5]
    assert [one["score_mm"] for one in told] == [pytest.approx((16 * 2.0 + 19.0) / 17, abs=1e-3)] * 2
    assert [one["measured"] for one in told] == [0.45, 0.45]  # each of the two holds half of the band
    assert [one["sees_mm2"] for one in told] == [180, 180]
    assert [one["surveys"] for one in told] == [[1, 2], [1, 2]]


def test_gaps_are_told_and_where_to_stand_next() -> None:
    seen = [band(0.4, 1.0), band(0.5, 1.0), band(0.6, 1.0, 0.3)]
    found = joined([scan(1, 10.0, bands=seen), scan(2, 11.0, bands=seen)])
    assert (found["from_m"], found["to_m"], found["surveys"]) == (10.4, 11.7, [1, 2])
    assert found["gaps"] == [{"from_m": 10.7, "to_m": 11.4}]
    assert found["bands"][5]["score_mm"] is None
    assert found["next_m"] == pytest.approx(10.3)  # what is well seen begins 0.4 m ahead
    assert joined([scan(1, 10.0, bands=seen)])["next_m"] == pytest.approx(10.2)  # it reaches to 10.6 m


@given(
    st.lists(
        st.tuples(st.integers(0, 40), st.lists(st.tuples(st.floats(0, 20), st.floats(0.01, 1)), min_size=1, max_size=8)),
        min_size=1,
        max_size=5,
    )
)
def test_a_joined_score_lies_between_those_that_it_is_of(found: list[tuple[int, list[tuple[float, float]]]]) -> None:
    scans = [
        scan(
            k, station / 10, bands=[band(round(0.3 + 0.1 * n, 1), score, measured) for n, (score, measured) in enumerate(seen)]
        )
        for k, (station, seen) in enumerate(found)
    ]
    scores = [score for _, seen in found for score, _ in seen]
    told = joined([*scans])["bands"]
    assert all(a["to_m"] == b["from_m"] for a, b in pairwise(told))
    for one in told:
        assert (one["score_mm"] is None) == (not one["surveys"])
        assert one["score_mm"] is None or min(scores) - 1e-3 <= one["score_mm"] <= max(scores) + 1e-3
        assert 0 <= one["measured"] <= 1


def test_one_go_is_of_one_pipe_and_ends_with_a_night(tmp_path: Path) -> None:
    store = Store(tmp_path, Clock(tmp_path / "none"))
    pipes = [store.places.create_pipe({"name": name})["id"] for name in ("A", "B")]
    numbers = [store.surveys.begin("anomaly", pipe) for pipe in (pipes[0], pipes[0], pipes[1], None, pipes[0], pipes[0])]
    with store._database.write() as connection:
        for number, hour in zip(numbers, (0, 11, 11, 11, 22, 35), strict=True):
            connection.execute("UPDATE surveys SET created_ms = ? WHERE id = ?", (3_600_000 * hour, number))
        connection.execute("UPDATE surveys SET created_ms = NULL WHERE id = ?", (numbers[1],))  # before a phone told the date
    first = [numbers[0], numbers[1], numbers[4]]
    assert [store.surveys.in_one_go(number) for number in first] == [first] * 3
    assert [store.surveys.in_one_go(numbers[k]) for k in (2, 3, 5)] == [[numbers[2]], [numbers[3]], [numbers[5]]]
    store.close()
