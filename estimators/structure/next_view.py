"""Where to look next: the place from which the likeliest classes of several objects are best told apart (the paper's Sec.
7)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estimators.structure.graph import MapObject
from estimators.structure.recognition import Views
from estimators.structure.types import CLASSES, Array

SURE = 0.97
"""An object believed more than this to be of one class needs no other view."""
DISTANCE = 2.6
_NEAR = 0.35
_SMOOTH = 0.5


@dataclass(frozen=True)
class Suggestion:
    """Look from ``position`` (3,) towards ``target`` (3,): it would tell ``objects`` apart. ``gain`` has no unit; more is
    better."""

    position: Array
    target: Array
    objects: tuple[int, ...]
    gain: float


def next_view(
    objects: Sequence[MapObject], seen_from: dict[int, list[Array]], views: Views, least_depth: float, most_depth: float
) -> Suggestion | None:
    """The best of the places around the objects (level, 2.6 m off), at depths between two; None where every class is sure.

    ``seen_from``: directions from which each object has been seen, by its number.
    """
    unsure = [thing for thing in objects if thing.beliefs.max() < SURE]
    if not unsure:
        return None
    centre = np.mean([thing.position for thing in objects], axis=0)
    extent = float(np.max([np.linalg.norm(thing.position[:2] - centre[:2]) for thing in objects]))
    best: Suggestion | None = None
    for turn in np.arange(0, 2 * np.pi, np.pi / 12):
        for depth in np.linspace(least_depth, most_depth, 3):
            out = np.array([np.cos(turn), np.sin(turn), 0.0])
            position = np.array([*(centre[:2] + (DISTANCE + 0.5 * extent) * out[:2]), depth])
            gains = [gain(thing, position, seen_from.get(thing.number, []), views) for thing in unsure]
            total = float(np.sum(gains))
            if best is None or total > best.gain:
                helped = [thing for thing, one in zip(unsure, gains, strict=True) if one > 0.5 * max(gains)]
                target = np.mean([thing.position for thing in helped], axis=0)
                best = Suggestion(position, target, tuple(thing.number for thing in helped), total)
    return best


def gain(thing: MapObject, position: Array, seen_from: Sequence[Array], views: Views) -> float:
    """How much a look from ``position`` would say of ``thing``: how unsure its two likeliest classes are, times how
    different they look from there, times how new the direction is."""
    order = np.argsort(thing.beliefs)[::-1][:2]
    doubt = 4 * float(thing.beliefs[order[0]] * thing.beliefs[order[1]])
    direction = position - thing.position
    direction = direction / np.linalg.norm(direction)
    again = sum(1 for before in seen_from if before @ direction > np.cos(_NEAR))
    return doubt * difference(views, int(order[0]), int(order[1]), thing.orientation, direction) / (1 + _SMOOTH * again)


def difference(views: Views, one: int, other: int, orientation: Array | None, direction: Array) -> float:
    """Distance of the histograms of classes ``one`` and ``other`` as seen from ``direction`` (3,) of the world; the mean
    over all directions where the object's ``orientation`` (3, 3) is not known."""
    assert 0 <= one < len(CLASSES)
    assert 0 <= other < len(CLASSES)
    mine, theirs = views.labels == one, views.labels == other
    apart = np.abs(views.histograms[mine][:, None] - views.histograms[theirs][None]).sum(axis=2).min(axis=1)
    if orientation is None:
        return float(apart.mean())
    near = views.directions[mine] @ (orientation.T @ direction)
    return float(apart[near > near.max() - 0.02].mean())
