"""Folds that keep together what belongs together, and the scores that are told from them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def grouped_folds(
    groups: Sequence[str], labels: NDArray[np.float32], count: int, rng: np.random.Generator
) -> NDArray[np.int64]:
    """The fold (n,) of each image: every group lies in one fold whole, and the positives of each class, ``labels``
    (n, classes), are spread as evenly as groups allow: largest groups first, each to the fold that needs it most."""
    names = sorted(set(groups))
    rng.shuffle(names)
    index = {name: k for k, name in enumerate(names)}
    member = np.array([index[group] for group in groups])
    wanted = np.column_stack([labels, np.ones(len(labels))])
    total = wanted.sum(axis=0)
    amount = np.array([wanted[member == k].sum(axis=0) for k in range(len(names))])
    held = np.zeros((count, wanted.shape[1]))
    fold_of = np.zeros(len(names), dtype=np.int64)
    for k in np.argsort(-amount[:, -1], kind="stable"):
        # how uneven the folds would be if the group went to each of them
        after = held[None] + np.eye(count)[:, :, None] * amount[k]
        share = after / np.maximum(total, 1)
        fold = int(np.argmin((share**2).sum(axis=(1, 2))))
        held[fold] += amount[k]
        fold_of[k] = fold
    return np.asarray(fold_of[member], dtype=np.int64)


def auroc(scores: Array, positive: NDArray[np.bool_]) -> float:
    """Area under the receiver operating characteristic: the share of pairs in the right order, ties half (Mann and Whitney
    1947). nan where there is nothing to tell apart."""
    count = int(positive.sum())
    others = len(positive) - count
    if count == 0 or others == 0:
        return float("nan")
    _, place, times = np.unique(scores, return_inverse=True, return_counts=True)
    ends = np.cumsum(times)
    ranks = ((ends - times + 1 + ends) / 2)[place]
    return float((ranks[positive].sum() - count * (count + 1) / 2) / (count * others))


def auroc_interval(
    scores: Array, positive: NDArray[np.bool_], groups: Sequence[str], rng: np.random.Generator, draws: int = 1000
) -> tuple[float, float]:
    """95 % bootstrap interval of the AUROC; whole ``groups`` are drawn, since near-duplicates are one observation."""
    names, member = np.unique(np.asarray(groups), return_inverse=True)
    rows = [np.flatnonzero(member == k) for k in range(len(names))]
    found = []
    for _ in range(draws):
        chosen = np.concatenate([rows[k] for k in rng.integers(0, len(names), len(names))])
        found.append(auroc(scores[chosen], positive[chosen]))
    low, high = np.nanpercentile(found, [2.5, 97.5])
    return float(low), float(high)


@dataclass(frozen=True)
class AtThreshold:
    """Precision, recall and F1 at one threshold."""

    threshold: float
    precision: float
    recall: float
    f1: float


def at_threshold(scores: Array, positive: NDArray[np.bool_], threshold: float) -> AtThreshold:
    """What is said and what is missed where a score of ``threshold`` or more counts."""
    said = scores >= threshold
    hits = int((said & positive).sum())
    precision = hits / max(int(said.sum()), 1)
    recall = hits / max(int(positive.sum()), 1)
    return AtThreshold(threshold, precision, recall, 2 * precision * recall / max(precision + recall, 1e-12))


def threshold_for(scores: Array, positive: NDArray[np.bool_], precision: float) -> float:
    """The lowest threshold that reaches ``precision``; where none does, that of the best F1."""
    order = np.argsort(-scores, kind="stable")
    sorted_scores = scores[order]
    hits = np.cumsum(positive[order])
    said = np.arange(1, len(order) + 1)
    last = np.append(sorted_scores[1:] < sorted_scores[:-1], True)
    reached = np.flatnonzero(last & (hits / said >= precision))
    if len(reached):
        return float(sorted_scores[reached[-1]])
    recall = hits / max(int(positive.sum()), 1)
    share = hits / said
    f1 = np.where(last, 2 * share * recall / np.maximum(share + recall, 1e-12), 0)
    return float(sorted_scores[int(np.argmax(f1))])
