"""Pictures of the anomaly survey: the deviation on the reference picture, and the unrolled wall as a heat map with its
scale."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from device.pictures import in_colour
from estimators.anomaly.deviation import DeviationMap
from estimators.anomaly.pair import PairFindings

Picture = NDArray[np.uint8]

FULL_SCALE_M = 0.010
"""Deviation at which the colour is full: red inwards, blue outwards."""
_QUIET_M = 0.0015
_WIDTH = 960
_END_COLOUR = (0, 200, 255)
_UNSEEN = (90, 90, 90)
_HIDDEN = (200, 200, 200)
_MARGIN = 46


def reference_picture(left: Picture) -> tuple[Picture, float]:
    """The left picture (H, W) or (H, W, 3) to draw on, in colour and at most 960 pixels wide, and how many times smaller."""
    step = max(left.shape[1] / _WIDTH, 1.0)
    size = round(left.shape[1] / step), round(left.shape[0] / step)
    return in_colour(np.asarray(cv2.resize(left, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)), step


def deviation_overlay(picture: Picture, step: float, findings: PairFindings) -> Picture:
    """``picture`` (h, w, 3), ``step`` times smaller than the reference picture, with the deviation on it and the band's
    ends."""
    followed = findings.followed
    grid = followed.grid
    height, width = picture.shape[:2]
    v, u = np.mgrid[0:height, 0:width].astype(np.float32)
    camera = followed.wall.rig.intrinsics
    wall, middle = followed.wall, (grid.depth[0] + grid.depth[-1]) / 2
    ray_x, ray_y = ((u + 0.5) * step - 0.5 - camera.ppx) / camera.fx, ((v + 0.5) * step - 0.5 - camera.ppy) / camera.fy
    depth = wall.meet(ray_x, ray_y, np.minimum(wall.first_guess(ray_x, ray_y), 3 * middle))
    theta = wall.about(ray_x, ray_y, depth)[0]
    row = grid.row_of(depth).astype(np.float32)
    column = ((theta + np.pi) / grid.cell[1] - 0.5).astype(np.float32)
    inside = (row >= 0) & (row < len(grid.depth) - 1)

    def there(values: NDArray[np.float32]) -> NDArray[np.float32]:
        found = cv2.remap(values, column, row, cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT, borderValue=(float("nan"),))
        return np.asarray(found, dtype=np.float32)

    deviation = np.where(inside, there(findings.points.deviation), np.nan)
    shown = np.isfinite(deviation)
    strength = np.where(shown, np.clip((np.abs(deviation) - _QUIET_M) / (FULL_SCALE_M - _QUIET_M), 0, 1), 0.0)
    colour = np.where((deviation < 0)[..., None], (40, 40, 255), (255, 120, 30)).astype(np.float32)
    mixed = picture * (1 - 0.85 * strength[..., None]) + colour * (0.85 * strength[..., None])
    on_wall = np.where(inside, there(followed.ends.inside.astype(np.float32)), 0.0) > 0.5
    edge = cv2.morphologyEx(on_wall.astype(np.uint8), cv2.MORPH_GRADIENT, np.ones((3, 3), np.uint8)) > 0
    out = np.clip(mixed, 0, 255).astype(np.uint8)
    out[edge] = _END_COLOUR
    return np.asarray(out, dtype=np.uint8)


def wall_colours(deviation: NDArray[np.float32], hidden: NDArray[np.bool_], wall: NDArray[np.bool_]) -> Picture:
    """An unrolled wall (Z, A) in colours (Z, A, 3): crown in the middle, near at the bottom; grey what was not measured, pale
    grey what is hidden, black what is no wall."""
    quarter = deviation.shape[1] // 4  # from 9 o'clock to 6
    deviation = np.roll(deviation, quarter, axis=1)[::-1]
    level = np.clip(deviation / FULL_SCALE_M, -1, 1)
    pale = 235 * (1 - np.abs(np.nan_to_num(level)))
    inward, outward = (np.clip(sign * np.nan_to_num(level), 0, 1) for sign in (-1, 1))
    colours = np.stack(
        [pale + 255 * outward + 40 * inward, pale + 120 * outward + 40 * inward, pale + 30 * outward + 255 * inward], 2
    )
    image = np.asarray(np.clip(colours, 0, 255), dtype=np.uint8)
    image[~np.isfinite(deviation)] = _UNSEEN
    image[np.roll(hidden, quarter, axis=1)[::-1]] = _HIDDEN
    image[~np.roll(wall, quarter, axis=1)[::-1]] = 0
    return image


def heat_map(found: DeviationMap, size: tuple[int, int] = (720, 360)) -> Picture:
    """The unrolled wall (h, w, 3): crown in the middle, near at the bottom, with clock hours, metres and a scale in mm."""
    image = wall_colours(found.deviation, found.hidden, found.wall)
    plain = cv2.resize(image, size, interpolation=cv2.INTER_NEAREST)
    framed: Picture = np.asarray(
        cv2.copyMakeBorder(plain, 8, _MARGIN, _MARGIN, 12, cv2.BORDER_CONSTANT, value=(255, 255, 255)), dtype=np.uint8
    )
    for hour, share in ((6, 0.0), (9, 0.25), (12, 0.5), (3, 0.75)):
        _write(framed, str(hour), _MARGIN + int(share * size[0]) - 6, size[1] + 24)
    for share in (0.0, 0.5, 1.0):
        metres = found.depth[0] + share * (found.depth[-1] - found.depth[0])
        _write(framed, f"{metres:.2f}", 4, 8 + int((1 - share) * (size[1] - 12)) + 10)
    reach = 1000 * FULL_SCALE_M
    _write(framed, f"clock; m; red {reach:.0f} mm inwards, blue {reach:.0f} mm outwards", _MARGIN, size[1] + 42)
    return framed


def _write(picture: NDArray[np.uint8], text: str, x: int, y: int) -> None:
    cv2.putText(picture, text, (x, y), cv2.FONT_HERSHEY_SIMPLEX, 0.4, (40, 40, 40), 1, cv2.LINE_AA)
