"""How well a number tells wrong diameters from right ones: ranking (AUROC) and the F1 score of a threshold (paper, Table 2)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.stats import rankdata

FOLDS = 5


def auroc(suspicion: ArrayLike, wrong: ArrayLike) -> float:
    """Chance that a wrong one has the higher suspicion than a right one, ties counting half; NaN where one kind is missing.

    ``suspicion`` (N,) may hold infinities (nothing could be fitted), no NaN; ``wrong`` (N,) bool.
    """
    scores, labels = np.asarray(suspicion, dtype=np.float64), np.asarray(wrong, dtype=bool)
    if np.isnan(scores).any():
        raise ValueError("a suspicion is not a number")
    positives, negatives = int(labels.sum()), int((~labels).sum())
    if positives == 0 or negatives == 0:
        return float("nan")
    ranks = rankdata(scores)
    return float((ranks[labels].sum() - positives * (positives + 1) / 2) / (positives * negatives))


def f1_of_right(accepted: NDArray[np.bool_], wrong: NDArray[np.bool_]) -> float:
    """F1 (eq. 10) where a right estimate that is accepted is a true positive, as in the paper; 0 where there is none."""
    true_positive = int((accepted & ~wrong).sum())
    errors = int((accepted & wrong).sum()) + int((~accepted & ~wrong).sum())
    return true_positive / (true_positive + errors / 2) if true_positive else 0.0


def best_threshold(suspicion: ArrayLike, wrong: ArrayLike) -> float:
    """The threshold (accept at or below it) with the highest F1; half-way to the next value, the lowest of equals."""
    scores, labels = np.asarray(suspicion, dtype=np.float64), np.asarray(wrong, dtype=bool)
    values = np.unique(scores[np.isfinite(scores)])
    if len(values) == 0:
        return float("-inf")
    candidates = np.append((values[:-1] + values[1:]) / 2, values[-1])
    scored = [f1_of_right(scores <= candidate, labels) for candidate in candidates]
    return float(candidates[int(np.argmax(scored))])


def cross_validated_f1(suspicion: ArrayLike, wrong: ArrayLike, seed: int = 0) -> tuple[float, float]:
    """Mean and standard deviation of the F1 on held-out folds (equal shares of wrong ones in each), the threshold fitted on
    the other folds."""
    scores, labels = np.asarray(suspicion, dtype=np.float64), np.asarray(wrong, dtype=bool)
    fold = np.empty(len(labels), dtype=np.int64)
    rng = np.random.default_rng(seed)
    for kind in (False, True):
        members = rng.permutation(np.flatnonzero(labels == kind))
        fold[members] = np.arange(len(members)) % FOLDS
    results = []
    for k in range(FOLDS):
        test = fold == k
        threshold = best_threshold(scores[~test], labels[~test])
        results.append(f1_of_right(scores[test] <= threshold, labels[test]))
    return float(np.mean(results)), float(np.std(results))
