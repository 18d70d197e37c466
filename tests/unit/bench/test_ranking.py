"""The figures by which proxies are judged: worked by hand on samples small enough for that."""

from __future__ import annotations

import numpy as np
import pytest

from tests.bench.ranking import auroc, best_threshold, cross_validated_f1, f1_of_right


def test_auroc_counts_the_pairs_in_the_right_order() -> None:
    # wrong: 3 and 1; right: 0, 2. Pairs wrong above right: (3,0) (3,2) (1,0) of four.
    assert auroc([3, 0, 1, 2], [True, False, True, False]) == pytest.approx(0.75)


def test_auroc_of_ties_is_a_half_and_infinity_is_the_most_suspicious() -> None:
    assert auroc([1, 1, 1], [True, False, False]) == pytest.approx(0.5)
    assert auroc([np.inf, 5, 9], [True, False, False]) == 1.0


def test_auroc_needs_both_kinds_and_numbers() -> None:
    assert np.isnan(auroc([1, 2], [False, False]))
    with pytest.raises(ValueError, match="not a number"):
        auroc([np.nan, 1], [True, False])


def test_f1_counts_right_ones_that_are_accepted() -> None:
    accepted = np.array([True, True, True, False])
    wrong = np.array([False, False, True, False])
    assert f1_of_right(accepted, wrong) == pytest.approx(2 / (2 + 0.5 * (1 + 1)))
    assert f1_of_right(~accepted, ~wrong) == 0.0


def test_best_threshold_separates_what_can_be_separated() -> None:
    assert best_threshold([1.0, 2.0, 8.0, 9.0], [False, False, True, True]) == 5.0
    assert best_threshold([1.0, 2.0, np.inf], [False, False, True]) == 2.0


def test_cross_validation_is_deterministic_and_near_one_on_separable_data() -> None:
    rng = np.random.default_rng(1)
    wrong = np.arange(100) < 30
    suspicion = np.where(wrong, 10.0, 1.0) + rng.random(100)
    first = cross_validated_f1(suspicion, wrong)
    assert first == cross_validated_f1(suspicion, wrong)
    assert first[0] > 0.97
    noise = cross_validated_f1(rng.random(100), wrong)
    assert noise[0] < 0.95
