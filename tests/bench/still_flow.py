"""The focus of expansion from two stills a second apart: flow of half a picture's width, matched after a warp.

Between both stills the wall point at rho from the focus of expansion c1 goes to rho' from c2 with 1/rho' = 1/rho - e, e being
the way over f R; a camera off the axis has e (1 - slope . direction) instead. The picture before is warped so by the counter's
way about the dark of the pipe; what is left is small and found patch by patch. Then c1, c2, e, roll and slope are fitted to all
matches, robustly: unlike eqs. 6 and 7 this holds for large steps and while the camera pans. Only the first guess is the dark.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from estimators.rings import dark_centre

Array = NDArray[np.float64]
Gray = NDArray[np.uint8]
Image = NDArray[np.float32]

REACH = (16, 8)
"""How far (px, at half size) a patch is sought, in the first round and in the second."""
PATCH, EVERY = 11, 9
LEAST_PEAK, LEAST_CONTRAST = 0.5, 0.8
"""Correlation of a match, and the most that a second one may have of it."""
FEWEST = 30
STANDS_PX = 0.7
"""What moves less is text, or a spot on the lens."""
MATCH_STD = 1.5
BLIND_PX = 25
"""Around the focus nothing is seen of the wall."""
CENTRE_STD, PAN_STD, WAY_SHARE, ROLL_STD, SLOPE_STD = 60.0, 20.0, 0.15, 0.02, 0.3
"""Priors: of the dark as a centre, of how it goes from one still to the other (px), of the counter, and of the camera."""


@dataclass(frozen=True)
class StillFlow:
    """``before`` and ``after`` (2,): the focus of expansion in both stills (px) with their ``std``; ``slope`` (2,), the pipe's
    axis from the camera in radii; ``matches`` and the ``share`` that agrees."""

    before: Array
    after: Array
    std: tuple[float, float]
    slope: Array
    matches: int
    share: float


def still_flow(before: Gray, after: Gray, expansion: float, aspect: float) -> StillFlow | None:
    """``expansion`` e (1/px along u) as the counter has it, ``aspect`` fx / fy; None where too little is found again."""
    scale = np.array([0.5, 0.5 * aspect])
    first, second = (_prepared(gray, aspect) for gray in (before, after))
    c1, c2 = (np.array(dark_centre(gray)) * scale for gray in (before, after))
    x = np.r_[c1, c2, expansion / 0.5, np.zeros(3)]
    guess = x.copy()
    for reach in REACH:
        points, found = _matches(first, second, x, reach)
        if len(points) < FEWEST:
            return None
        x, covariance, share = _fit(points, found, x, guess)
    stds = [float(np.sqrt(np.trace(covariance[k : k + 2, k : k + 2]) / 2)) / 0.5 for k in (0, 2)]
    return StillFlow(x[:2] / scale, x[2:4] / scale, (stds[0], stds[1]), x[6:8], len(points), share)


def _prepared(gray: Gray, aspect: float) -> Image:
    """Half size, square pixels, and the light taken off: only texture is left."""
    size = gray.shape[1] // 2, round(0.5 * aspect * gray.shape[0])
    small = np.log(cv2.resize(gray, size, interpolation=cv2.INTER_AREA).astype(np.float32) + 8)
    texture = small - cv2.GaussianBlur(small, (0, 0), 10)
    return np.asarray(texture / (np.sqrt(cv2.GaussianBlur(texture**2, (0, 0), 12)) + np.float32(0.015)), np.float32)


def _matches(first: Image, second: Image, x: Array, reach: int) -> tuple[Array, Array]:
    """Points (n, 2) of the still before and where each is in the one after."""
    height, width = second.shape
    v, u = np.mgrid[:height, :width].astype(np.float32)
    du, dv = u - np.float32(x[2]), v - np.float32(x[3])
    shrink = 1 / (1 + np.float32(x[4]) * np.hypot(du, dv))
    source_u, source_v = np.float32(x[0]) + du * shrink, np.float32(x[1]) + dv * shrink
    warped = np.asarray(cv2.remap(first, source_u, source_v, cv2.INTER_LINEAR), np.float32)
    margin = PATCH + reach + 3
    points, found = [], []
    for row in range(margin, height - margin, EVERY):
        for column in range(margin, width - margin, EVERY):
            if np.hypot(column - x[2], row - x[3]) < BLIND_PX:
                continue
            patch = second[row - PATCH : row + PATCH + 1, column - PATCH : column + PATCH + 1]
            wide = PATCH + reach
            place = _peak(cv2.matchTemplate(warped[row - wide : row + wide + 1, column - wide : column + wide + 1], patch, 5))
            if place is None:
                continue
            at = (float(column + place[0] - reach), float(row + place[1] - reach))
            points.append([float(cv2.getRectSubPix(source, (1, 1), at)[0, 0]) for source in (source_u, source_v)])
            found.append([float(column), float(row)])
    start, end = np.array(points).reshape(-1, 2), np.array(found).reshape(-1, 2)
    moves = np.hypot(*(end - start).T) > STANDS_PX
    return start[moves], end[moves]


def _peak(likeness: Image) -> tuple[float, float] | None:
    """(u, v) of the one peak of a correlation (2 reach + 1, 2 reach + 1), to parts of a pixel; None where there is not one."""
    _, peak, _, (u, v) = cv2.minMaxLoc(likeness)
    last = likeness.shape[0] - 1
    if peak < LEAST_PEAK or not (0 < u < last and 0 < v < last):
        return None
    others = likeness.copy()
    others[max(v - 3, 0) : v + 4, max(u - 3, 0) : u + 4] = -1
    if others.max() > LEAST_CONTRAST * peak:
        return None
    across, down = likeness[v, u - 1 : u + 2], likeness[v - 1 : v + 2, u]
    part = [float(0.5 * (line[0] - line[2]) / min(line[0] - 2 * line[1] + line[2], -1e-6)) for line in (across, down)]
    return u + part[0], v + part[1]


def _fit(points: Array, found: Array, start: Array, guess: Array) -> tuple[Array, Array, float]:
    """[c1, c2, e, roll, slope] with covariance (8, 8), and the share of matches that agree."""

    def off(x: Array) -> Array:
        d = points - x[:2]
        rho = np.hypot(*d.T)
        lean = 1 - (d @ x[6:8]) / np.maximum(rho, 1.0)
        turned = d + x[5] * np.stack([-d[:, 1], d[:, 0]], axis=1)
        return np.asarray((x[2:4] + turned / np.maximum(1 - x[4] * rho * lean, 0.05)[:, None] - found) / MATCH_STD)

    def residuals(x: Array) -> Array:
        matches = off(x)
        robust = matches / np.sqrt(1 + (matches**2).sum(axis=1, keepdims=True) / 9)
        known = [
            [(x[4] - guess[4]) / (WAY_SHARE * abs(guess[4]) + 4e-4), x[5] / ROLL_STD],
            x[6:8] / SLOPE_STD,
            (x[2:4] - x[:2] - guess[2:4] + guess[:2]) / PAN_STD,
            (x[2:4] - guess[2:4]) / CENTRE_STD,
        ]
        return np.concatenate([robust.ravel(), *known])

    units = np.array([5, 5, 5, 5, 5e-4, 0.01, 0.1, 0.1])
    shifts = [(0.0, 0.0), (15.0, 0.0), (-15.0, 0.0), (0.0, 15.0), (0.0, -15.0)]
    starts = [start + np.r_[shift, np.zeros(6)] for shift in shifts]
    best = min((least_squares(residuals, one, x_scale=units, max_nfev=60) for one in starts), key=lambda fit: float(fit.cost))
    share = float(np.mean(np.hypot(*off(best.x).T) < 3))
    return best.x, np.linalg.inv(best.jac.T @ best.jac), share
