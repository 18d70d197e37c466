"""Folds and figures of the detector, against cases done by hand."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from estimators.fcdd_training.folds import at_threshold, auroc, auroc_interval, grouped_folds, threshold_for


def test_auroc_counts_pairs_in_the_right_order_and_ties_half() -> None:
    scores = np.array([0.9, 0.4, 0.4, 0.1])
    positive = np.array([True, True, False, False])
    # pairs: (0.9 > 0.4), (0.9 > 0.1), (0.4 = 0.4), (0.4 > 0.1): 3.5 of 4
    assert auroc(scores, positive) == pytest.approx(3.5 / 4)
    assert auroc(-scores, positive) == pytest.approx(0.5 / 4)
    assert np.isnan(auroc(scores, np.ones(4, bool)))


@given(st.lists(st.tuples(st.integers(0, 5), st.booleans()), min_size=2, max_size=30))
def test_auroc_is_the_share_of_ordered_pairs(rows: list[tuple[int, bool]]) -> None:
    scores = np.array([float(score) for score, _ in rows])
    positive = np.array([label for _, label in rows])
    if positive.all() or not positive.any():
        assert np.isnan(auroc(scores, positive))
        return
    pairs = [(p > n) + 0.5 * (p == n) for p in scores[positive] for n in scores[~positive]]
    assert auroc(scores, positive) == pytest.approx(float(np.mean(pairs)))


def test_interval_holds_the_figure_and_narrows_with_more_groups() -> None:
    rng = np.random.default_rng(1)
    positive = rng.random(400) < 0.4
    scores = positive + rng.normal(0, 1, 400)
    value = auroc(scores, positive)
    wide = auroc_interval(scores, positive, [str(k // 40) for k in range(400)], np.random.default_rng(2), 300)
    fine = auroc_interval(scores, positive, [str(k) for k in range(400)], np.random.default_rng(2), 300)
    assert wide[0] < value < wide[1]
    assert fine[0] < value < fine[1]
    # a group drawn twice tells nothing twice: the same pictures as one group leave more doubt than as single ones
    same = auroc_interval(np.tile(scores[:40], 10), np.tile(positive[:40], 10), [str(k % 40) for k in range(400)], rng, 300)
    assert same[1] - same[0] > fine[1] - fine[0]


def test_groups_stay_whole_and_positives_are_spread() -> None:
    rng = np.random.default_rng(3)
    groups = [f"g{k}" for k in rng.integers(0, 60, 300)]
    labels = (rng.random((300, 3)) < (0.3, 0.1, 0.5)).astype(np.float32)
    fold = grouped_folds(groups, labels, 5, np.random.default_rng(4))
    assert set(fold.tolist()) == set(range(5))
    for name in set(groups):
        assert len({int(fold[k]) for k, group in enumerate(groups) if group == name}) == 1
    for column in range(3):
        share = np.array([labels[fold == k, column].sum() for k in range(5)])
        assert share.min() >= 0.5 * share.mean()
        assert share.max() <= 1.6 * share.mean()


def test_threshold_is_the_lowest_that_keeps_the_precision() -> None:
    scores = np.array([0.9, 0.8, 0.7, 0.6, 0.5])
    positive = np.array([True, False, True, True, False])
    # precision downwards: 1, 1/2, 2/3, 3/4, 3/5
    assert threshold_for(scores, positive, 0.7) == 0.6
    assert threshold_for(scores, positive, 0.99) == 0.9
    found = at_threshold(scores, positive, 0.6)
    assert (found.precision, found.recall) == (0.75, 1.0)
    assert found.f1 == pytest.approx(6 / 7)


def test_where_no_threshold_is_precise_enough_the_best_f1_is_taken() -> None:
    scores = np.array([0.9, 0.8, 0.7])
    positive = np.array([False, True, True])
    # F1 downwards: 0, 2/4, 4/5
    assert threshold_for(scores, positive, 0.9) == 0.7
