"""Positions of a recording from its distances."""

from __future__ import annotations

import numpy as np
import pytest

from device.landmarks.recorded_way import recorded_way


def test_a_counter_that_steps_by_a_tenth_gives_a_smooth_way() -> None:
    times = np.arange(0, 40, 0.5)
    truth = 0.13 * times
    way = recorded_way(times, np.round(truth, 1))
    inner = list(np.arange(3, 37, 0.17))
    errors = [abs(found.chainage - 0.13 * moment) for moment in inner if (found := way.at(moment))]
    assert len(errors) == len(inner)
    assert max(errors) < 0.05
    assert np.median(errors) < 0.015
    found = way.at(20.0)
    assert found is not None
    assert found.speed == pytest.approx(0.13, abs=0.02)
    assert not found.standing


def test_nobody_knows_before_after_in_gaps_and_in_jumps() -> None:
    way = recorded_way([0.0, 1.0, 2.0, 20.0, 21.0, 22.0], [1.0, 1.2, 1.4, 3.0, 3.2, 9.0], 0.1)
    assert way.at(-2.0) is None
    assert way.at(30.0) is None
    assert way.at(10.0) is None  # nothing was read for 18 s
    assert way.at(21.5) is None  # 5.8 m in a second: the counter was set
    assert way.at(1.5) is not None
    assert way.pieces == 2


def test_of_several_stretches_the_longest_way_is_kept() -> None:
    way = recorded_way([0, 1, 2, 3, 4, 5, 6], [5.0, 5.1, -3.0, -2.5, -2.0, -1.5, -1.0], 0.1)
    kept = way.longest()
    assert kept.times[0] == 2.0
    assert kept.pieces == 1
    assert kept.at(1.0) is None


def test_a_crawler_that_stands_is_said_to() -> None:
    way = recorded_way(np.arange(0, 30, 1.0), [2.0] * 30, 0.1)
    found = way.at(15.0)
    assert found is not None
    assert (found.standing, found.speed) == (True, 0.0)


def test_which_way_a_counter_rounds_is_left_open() -> None:
    times = np.arange(0.0, 20.0, 0.04)
    true = 0.2 * times
    for shown in (np.floor(true / 0.1) * 0.1, np.round(true / 0.1) * 0.1):
        where = recorded_way(times.tolist(), shown.tolist(), 0.1).at(10.0)
        assert where is not None
        assert abs(where.chainage - 2.0) < 1.96 * where.common
        assert where.common < 0.04
    fine = recorded_way(times.tolist(), true.tolist(), 0.0).at(10.0)
    assert fine is not None
    assert fine.common == 0.0
