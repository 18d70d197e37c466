"""Belief in class and existence."""

import numpy as np
import pytest

from estimators.landmarks import belief
from estimators.landmarks.belief import Bursts, Errors

ERRORS = Errors()
DENSITY = np.array([0.2 / (720 * 576)])


def burst(u: float, v: float, count: float = 10.0, first: int = 0, last: int = 9) -> Bursts:
    return Bursts(np.array([[u, v]]), np.array([count]), np.array([0]), np.array([first]), np.array([last]))


def evidence(bursts: Bursts, frame: int, pixels: np.ndarray, same: float = 0.9) -> tuple[np.ndarray, np.ndarray, Bursts]:
    return belief.clutter_evidence(ERRORS, bursts, frame, pixels, np.array([1]), np.array([same]), DENSITY, 15.0)


def test_a_burst_hardly_changes_its_label() -> None:
    same, _, _ = evidence(burst(100, 100), 10, np.array([[101.0, 99.0]]))
    other, _, after = evidence(burst(100, 100), 10, np.array([[101.0, 99.0]]), 0.025)
    assert same[0] > other[0] + 3
    assert after.label[0] == 1


def test_confusion_rows_are_probabilities() -> None:
    matrix = belief.confusion(5, 0.9)
    np.testing.assert_allclose(matrix.sum(axis=1), 1.0)
    np.testing.assert_allclose(np.diag(matrix), 0.9)
    assert belief.confusion(1).tolist() == [[1.0]]


def test_one_wrong_label_does_not_turn_a_landmark_many_do() -> None:
    matrix = belief.confusion(3, 0.9)
    now = np.full((1, 3), 1 / 3)
    for label in (0, 0, 1, 0):
        now = belief.after_label(now, matrix[:, [label]].T, np.ones(1))
    # By hand: 0.9^3 * 0.05 against 0.05^3 * 0.9 and 0.05^4.
    odds = np.array([0.9**3 * 0.05, 0.05**3 * 0.9, 0.05**4])
    np.testing.assert_allclose(now[0], odds / odds.sum())
    for _ in range(3):
        now = belief.after_label(now, matrix[:, [1]].T, np.ones(1))
    assert now[0].argmax() == 1


def test_a_label_that_counts_nothing_changes_nothing() -> None:
    now = np.array([[0.2, 0.5, 0.3]])
    np.testing.assert_allclose(belief.after_label(now, belief.confusion(3)[:, [0]].T, np.zeros(1)), now)


def test_a_sighting_where_the_burst_stands_is_likely_clutter_elsewhere_it_is_not() -> None:
    same, _, _ = evidence(burst(100, 100), 10, np.array([[101.0, 99.0]]))
    other, _, _ = evidence(burst(100, 100), 10, np.array([[300.0, 99.0]]))
    assert same[0] > other[0] + 5
    assert other[0] == pytest.approx(np.log(DENSITY[0]))


def test_a_burst_ends_with_its_time_and_after_a_gap() -> None:
    pixel = np.array([[100.0, 100.0]])
    long_ago, _, started = evidence(burst(100, 100, last=9), 15, pixel)
    too_long, _, _ = evidence(burst(100, 100, first=0, last=24), 25, pixel)
    assert long_ago[0] == too_long[0] == pytest.approx(np.log(DENSITY[0]))
    assert (started.count[0], started.first[0], started.last[0]) == (1.0, 15, 15)


def test_burst_keeps_the_mean_of_its_sightings() -> None:
    _, _, after = evidence(burst(100, 100, 3.0, 0, 2), 3, np.array([[104.0, 100.0]]))
    assert after.mean[0].tolist() == [101.0, 100.0]
    assert (after.count[0], after.first[0], after.last[0]) == (4.0, 0, 3)


def test_misses_in_a_row_cost_less_than_misses_apart_until_no_burst_lasts_that_long() -> None:
    cost = belief.miss_evidence(ERRORS, np.array([0, 1, 24, 25]))
    assert cost[0] < cost[1] == cost[2] < 0
    assert cost[3] < cost[2]


def test_belief_by_name_sums_to_one_and_knows_false() -> None:
    named = belief.named(["a", "b"], np.array([0.25, 0.75]), 0.0)
    assert named == {"a": pytest.approx(0.125), "b": pytest.approx(0.375), "false": pytest.approx(0.5)}
    assert belief.named(["a"], np.array([1.0]), 1e6)["false"] == pytest.approx(0.0, abs=1e-12)
