"""Optical flow of the wall: sparse pyramidal Lucas-Kanade on a grid, checked forwards and backwards."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Gray = NDArray[np.uint8]


@dataclass(frozen=True)
class FlowConfig:
    """The grid has about ``points``; ``window`` (px) and ``levels`` of the pyramid, ``agreement`` (px) between a point and
    where the way back ends, ``texture`` the least eigenvalue that a point is tracked with, ``least`` (px) the median motion
    that a step waits for, up to ``patience`` pictures, unless more than a share ``lossy`` of the points is lost meanwhile.
    Pixels are those of the picture that is tracked, ``width`` wide."""

    points: int = 200
    window: int = 13
    levels: int = 2
    agreement: float = 0.5
    texture: float = 2e-4
    least: float = 2.0
    patience: int = 5
    lossy: float = 0.15
    width: int = 360


@dataclass(frozen=True)
class Flow:
    """``points`` (n, 2) half way between both pictures and ``motion`` (n, 2), in px of the picture. ``tried`` points had
    texture to be followed by, so that 1 - n / tried were lost. ``span`` is how many pictures apart both are."""

    points: Array
    motion: Array
    tried: int
    span: int = 1

    @property
    def length(self) -> float:
        """Median motion (px), 0 where nothing was followed."""
        return float(np.median(np.hypot(self.motion[:, 0], self.motion[:, 1]))) if len(self.motion) else 0.0


NO_FLOW = Flow(np.empty((0, 2)), np.empty((0, 2)), 0)


def flow(previous: Gray, current: Gray, config: FlowConfig | None = None) -> Flow:
    """Motion of a grid of points from ``previous`` to ``current`` (H, W) uint8, those that come back to where they began."""
    config = config or FlowConfig()
    start = _grid(previous.shape, config.points)
    window = (config.window, config.window)
    found, ok, _ = cv2.calcOpticalFlowPyrLK(
        previous, current, start, np.empty_like(start), winSize=window, maxLevel=config.levels, minEigThreshold=config.texture
    )
    kept = ok.ravel() == 1
    if not kept.any():
        return NO_FLOW
    start, found = start[kept], found[kept]
    back, ok, _ = cv2.calcOpticalFlowPyrLK(
        current, previous, found, start.copy(), winSize=window, maxLevel=config.levels, flags=cv2.OPTFLOW_USE_INITIAL_FLOW
    )
    same = (ok.ravel() == 1) & (np.hypot(*(back - start).reshape(-1, 2).T) < config.agreement)
    first, second = (points[same].reshape(-1, 2).astype(np.float64) for points in (start, found))
    return Flow(0.5 * (first + second), second - first, len(start))


def _grid(shape: tuple[int, ...], points: int) -> NDArray[np.float32]:
    spacing = max(float(np.sqrt(shape[0] * shape[1] / points)), 4.0)
    columns, rows = (np.arange(0.75 * spacing, size - spacing / 2, spacing) for size in (shape[1], shape[0]))
    return np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 1, 2).astype(np.float32)


class Tracker:
    """Flow between pictures that are as far apart as the motion needs to tell a direction: what a flow errs by does not grow
    with its length. Large pictures are tracked at a part of their size."""

    def __init__(self, config: FlowConfig | None = None) -> None:
        self._config = config or FlowConfig()
        self._reference: Gray | None = None
        self._since = 0
        self._pace = np.inf
        """Motion (px) from picture to picture as it was last."""

    def step(self, gray: Gray) -> Flow | None:
        """The flow to ``gray`` (H, W) uint8, in px of ``gray``; None while there is nothing to compare with, or the motion is
        likely too small yet."""
        self._since += 1
        part = max(1, round(gray.shape[1] / self._config.width))
        size = gray.shape[1] // part, gray.shape[0] // part
        same = self._reference is not None and self._reference.shape == size[::-1]
        if same and self._since < self._config.patience and self._pace * self._since < self._config.least:
            return None
        small = np.asarray(cv2.resize(gray, size, interpolation=cv2.INTER_AREA), np.uint8) if part > 1 else gray.copy()
        if self._reference is None or not same:
            self._reference, self._since, self._pace = small, 0, np.inf
            return None
        found = flow(self._reference, small, self._config)
        # where many are lost, those that are left are the slow ones: what they say of the pace is not to be waited on
        reliable = len(found.points) > (1 - self._config.lossy) * found.tried
        self._pace = found.length / self._since if reliable else np.inf
        if reliable and found.length < self._config.least and self._since < self._config.patience:
            return None
        found = Flow(part * found.points + (part - 1) / 2, part * found.motion, found.tried, self._since)
        self._since, self._reference = 0, small
        return found
