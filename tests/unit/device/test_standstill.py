"""Whether the crawler stands."""

from __future__ import annotations

import pytest

from device.landmarks.standstill import Standstill


def test_it_stands_from_where_it_last_moved() -> None:
    still = Standstill()
    assert still.since_s is None
    assert still.standing_s(5.0) == 0.0
    for k in range(100):
        still.add(0.1 * k, min(0.02 * k, 1.0))  # 0.2 m/s for 5 s
    assert still.standing_s(9.9) == pytest.approx(4.9, abs=0.76)  # the least move takes 0.75 s
    assert still.moved_m(2.0) == 0.0
    assert still.moved_m(30.0) == pytest.approx(1.0)


def test_a_counter_that_flickers_stands_and_a_slow_crawler_does_not() -> None:
    flicker, slow = Standstill(), Standstill()
    for k in range(600):
        flicker.add(0.5 * k, 0.1 * (k % 2))
        slow.add(0.5 * k, 0.005 * k)  # 1 cm/s
    assert flicker.standing_s(300.0) == pytest.approx(300.0)
    assert slow.standing_s(300.0) < 16.0


def test_forgotten_readings_count_no_more() -> None:
    still = Standstill()
    still.add(0.0, 0.0)
    still.forget()
    assert still.since_s is None
    still.add(1.0, 7.0)
    assert (still.since_s, still.moved_m(10.0)) == (1.0, 0.0)
