"""From readings to chainage."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.encoder.base import Reading
from drivers.encoder.calibration import FEWEST_STEPS, Calibration, two_point


def counts(value: float) -> Reading:
    return Reading(value, monotonic_ns=0)


def metres(value: float, quantum: float = 0.1) -> Reading:
    return Reading(value, monotonic_ns=0, unit="m", quantum=quantum)


def test_counts_direction_and_zero() -> None:
    calibration = Calibration(counts_per_metre=2000.0, direction=-1, zero=500.0)
    assert calibration.metres(counts(500)) == 0.0
    assert calibration.metres(counts(-3500)) == 2.0
    assert calibration.quantum(counts(0)) == 0.0005


def test_a_counter_in_metres_needs_no_setting() -> None:
    assert Calibration().metres(metres(12.3)) == 12.3
    assert Calibration().quantum(metres(12.3)) == 0.1


@given(st.floats(0.1, 1e5), st.sampled_from([1, -1]), st.floats(-1e6, 1e6), st.floats(-500, 500))
def test_zeroed_at_a_reading_it_shows_that_chainage(scale: float, direction: Any, value: float, chainage: float) -> None:
    calibration = Calibration(scale, direction, 17.0, 0.01).zeroed_at(counts(value), chainage)
    assert calibration.metres(counts(value)) == pytest.approx(chainage, abs=1e-6)
    assert (calibration.counts_per_metre, calibration.direction, calibration.scale_std) == (scale, direction, 0.01)


def test_zero_stays_where_it_is_when_the_scale_is_set_anew() -> None:
    calibration = Calibration(1000.0).zeroed_at(counts(7000))
    assert replace(calibration, counts_per_metre=900.0).metres(counts(7000)) == 0.0


def test_two_points_tell_scale_direction_and_zero() -> None:
    found = two_point(counts(100), counts(-39_900), 20.0)
    assert found == Calibration(2000.0, -1, 100.0, found.scale_std)
    assert found.metres(counts(-39_900)) == 20.0


def test_two_points_know_how_well_they_tell_the_scale() -> None:
    """Against the spread of the scale over many drives whose ends lie anywhere within the counter's steps."""
    rng = np.random.default_rng(3)
    ends = rng.uniform(0.0, 0.1, 4000)
    shown = np.round(ends / 0.1) * 0.1, np.round((ends + 5.0 + rng.uniform(0, 0.1, 4000)) / 0.1) * 0.1
    truth = 5.05
    scales = (shown[1] - shown[0]) / truth
    stated = two_point(metres(0.0), metres(5.0), truth).scale_std
    assert stated is not None
    assert 0.7 < stated / np.std(scales) < 1.3


@pytest.mark.parametrize(
    ("first", "second", "length", "said"),
    [
        (counts(0), counts(1000), 0.0, "length"),
        (counts(0), counts(1000), -1.0, "length"),
        (counts(0), counts(1000), math.nan, "length"),
        (counts(0), counts(1000), math.inf, "length"),
        (counts(5), counts(5), 10.0, "moved by 0 steps"),
        (counts(0), counts(FEWEST_STEPS - 1), 10.0, "drive further"),
        (metres(0.0), metres(1.0), 1.0, "moved by 10 steps"),
        (counts(0), metres(10.0), 10.0, "different counters"),
    ],
)
def test_two_points_that_tell_nothing_are_refused(first: Reading, second: Reading, length: float, said: str) -> None:
    with pytest.raises(ValueError, match=said) as caught:
        two_point(first, second, length)
    assert str(caught.value).endswith(".")


@pytest.mark.parametrize(
    "wrong",
    [
        {"counts_per_metre": 0.0},
        {"counts_per_metre": -5.0},
        {"counts_per_metre": math.nan},
        {"counts_per_metre": math.inf},
        {"direction": 0},
        {"direction": 2},
        {"zero": math.nan},
    ],
)
def test_impossible_calibrations_are_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=r"got .*\.$"):
        Calibration(**wrong)


def test_an_impossible_zero_is_refused() -> None:
    with pytest.raises(ValueError, match="chainage"):
        Calibration().zeroed_at(counts(0), math.nan)
