"""Views of a board as they come from two live cameras: which are worth keeping, what they cover, what is still to be shown."""

from __future__ import annotations

import numpy as np

from estimators.board.board import Board, Sighting
from estimators.board.calibration import LEAST_COVERED, LEAST_TILTS, LEAST_VIEWS, View, too_blurred
from estimators.board.coverage import Coverage, coverage

WANTED_VIEWS = LEAST_VIEWS + 6
"""Some more than must be: a few may turn out to disagree."""
_STILL_PX = 1.0
"""Corners that move by more between two pictures were not taken at one moment by cameras that are not synchronised."""
_ANOTHER = 0.05
"""A view shows something new where its corners lie by this share of the picture's width from those of each view before."""


class Gathering:
    """Takes sightings one after the other; ``views`` are those that were kept."""

    def __init__(self, board: Board, size: tuple[int, int]) -> None:
        self._board = board
        self._size = size
        self._last: Sighting | None = None
        self.views: list[View] = []

    def take(self, name: str, left: Sighting | None, right: Sighting | None) -> str:
        """What both cameras see now: keeps it where it shows something new, and says why not otherwise; empty where kept."""
        last, self._last = self._last, left
        if left is None or right is None:
            where = "either picture" if left is None and right is None else f"the {'left' if left is None else 'right'} picture"
            return f"no board in {where}"
        view = View(name, left, right)
        if not view.shows_enough(self._board):
            return "too little of the board is in both pictures"
        if too_blurred(view, self._size):
            return "blurred: hold it still, or focus"
        if last is None or _moved(last, left) > _STILL_PX:
            return "moving: hold it still"
        if any(_moved(before.left, left) < _ANOTHER * self._size[0] for before in self.views):
            return "seen already: show it elsewhere, or tilt it"
        self.views.append(view)
        return ""

    def covered(self) -> Coverage:
        """What the kept views cover."""
        return coverage(self._board, ((view.left, view.right) for view in self.views), self._size)

    @property
    def enough(self) -> bool:
        """Whether everything was shown that a calibration asks for."""
        return not self.wanted()

    def wanted(self) -> str:
        """What to show next, in words; empty where nothing is missing."""
        covered = self.covered()
        if min(covered.shares) < LEAST_COVERED and covered.missing():
            return f"show it in the {covered.missing()[0]}"
        tilts = covered.missing_tilts(LEAST_TILTS)
        if tilts:
            return f"tilt it, its {tilts[0]}"
        more = WANTED_VIEWS - len(self.views)
        return f"show it {more} more times, nearer and farther" if more > 0 else ""


def _moved(before: Sighting, now: Sighting) -> float:
    """Mean way (px) of the corners that are in both; without any, endlessly far."""
    _, first, second = np.intersect1d(before.ids, now.ids, return_indices=True)
    if len(first) < 4:
        return float("inf")
    return float(np.linalg.norm(now.pixels[second] - before.pixels[first], axis=1).mean())
