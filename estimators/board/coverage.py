"""What views of a board cover: how much of each picture, and in which ways the board was tilted.

Corners in the middle of the picture say nothing of a lens's edges, and a board that always faces the camera cannot tell a long
lens near from a short one far away: both must be there before a calibration is worth anything.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from estimators.board.board import Board, Sighting

CELLS = (6, 4)
"""Parts across and down into which the picture is cut."""
TILTS = ("left edge nearer", "right edge nearer", "upper edge nearer", "lower edge nearer")
_TILTED = np.radians(12.0)
_FOCAL = 0.7
"""Focal length as a share of the picture's width, until it is known: only the sense of a tilt is asked for."""


@dataclass(frozen=True)
class Coverage:
    """``left`` and ``right`` (rows, columns) of CELLS: where corners were seen in each picture; ``tilts`` how many views were
    tilted each way, in the order of TILTS."""

    left: NDArray[np.bool_]
    right: NDArray[np.bool_]
    tilts: tuple[int, int, int, int]

    @property
    def shares(self) -> tuple[float, float]:
        """Of the left and the right picture that is covered."""
        return float(self.left.mean()), float(self.right.mean())

    def missing(self) -> list[str]:
        """Where nothing was seen, in words: "upper left of the left picture"."""
        return [
            f"{where} of the {side} picture"
            for side, seen in (("left", self.left), ("right", self.right))
            for where in _bare(seen)
        ]

    def missing_tilts(self, least: int) -> list[str]:
        """The tilts of which there are fewer than ``least`` views."""
        return [name for name, count in zip(TILTS, self.tilts, strict=True) if count < least]


def coverage(board: Board, views: Iterable[tuple[Sighting, Sighting]], size: tuple[int, int]) -> Coverage:
    """Of views (left, right) in pictures of ``size``."""
    left, right = np.zeros(CELLS[::-1], bool), np.zeros(CELLS[::-1], bool)
    tilts = np.zeros(4, int)
    for sightings in views:
        for seen, found in zip((left, right), sightings, strict=True):
            column, row = (found.pixels * np.array(CELLS) / np.array(size)).astype(int).T
            inside = (column >= 0) & (column < CELLS[0]) & (row >= 0) & (row < CELLS[1])
            seen[row[inside], column[inside]] = True
        tilts += tilted(board, sightings[0], size)
    return Coverage(left, right, (int(tilts[0]), int(tilts[1]), int(tilts[2]), int(tilts[3])))


def tilted(board: Board, found: Sighting, size: tuple[int, int]) -> NDArray[np.int64]:
    """(4,) of 0 and 1: whether the board is tilted in each way of TILTS."""
    if len(found.ids) < 6:
        return np.zeros(4, dtype=np.int64)
    focal = _FOCAL * size[0]
    camera = np.array([[focal, 0, (size[0] - 1) / 2], [0, focal, (size[1] - 1) / 2], [0, 0, 1]])
    points = board.points[found.ids]
    solved, turned, _ = cv2.solvePnP(points, found.pixels, camera, None, flags=cv2.SOLVEPNP_IPPE)
    if not solved:
        return np.zeros(4, dtype=np.int64)
    normal = cv2.Rodrigues(turned)[0][:, 2]
    normal = normal * (np.sign(normal[2]) or 1.0)  # away from the camera, however the board lies
    yaw, pitch = np.arctan2(normal[0], normal[2]), np.arctan2(normal[1], normal[2])
    return np.array([yaw > _TILTED, yaw < -_TILTED, pitch > _TILTED, pitch < -_TILTED], dtype=np.int64)


def _bare(seen: NDArray[np.bool_]) -> list[str]:
    """Ninths of the picture of which less than half was seen, in words."""
    found = []
    for down, rows in (("upper", slice(0, 1)), ("", slice(1, 3)), ("lower", slice(3, 4))):
        for across, columns in (("left", slice(0, 2)), ("", slice(2, 4)), ("right", slice(4, 6))):
            if seen[rows, columns].mean() < 0.5:
                found.append(f"{down} {across}".strip() or "middle")
    return found
