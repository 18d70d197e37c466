"""What a sewer, a lamp and a recorder do to a picture without changing what lies in the pipe."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

Picture = NDArray[np.uint8]

BOX_COLORS = ((255, 0, 0), (0, 0, 0), (255, 255, 255), (128, 128, 128), (0, 0, 255))
LETTERS = "ABCDEFGHIJKLMNOPRSTUVWX0123456789.:/-+ "


def augmented(picture: Picture, size: tuple[int, int], rng: np.random.Generator, invert_matters: bool) -> Picture:
    """(h, w, 3) uint8 BGR to ``size`` (width, height). ``invert_matters`` where turning it upside down would turn a label
    false: a deposit lies at the invert, and what hangs from the crown is none."""
    found = _framed(picture, size, rng)
    if rng.random() < 0.5:
        found = found[:, ::-1]
    if not invert_matters and rng.random() < 0.1:
        found = found[::-1]
    found = np.ascontiguousarray(found)
    if rng.random() < 0.85:
        found = _lit(found, rng)
    if rng.random() < 0.25:
        found = _hazy(found, rng)
    if rng.random() < 0.35:
        found = _soft(found, rng)
    if rng.random() < 0.15:
        found = _interlaced(found, rng)
    if rng.random() < 0.3:
        noise = rng.normal(0, rng.uniform(2, 10), found.shape).astype(np.float32)
        found = np.clip(found + noise, 0, 255).astype(np.uint8)
    if rng.random() < 0.6:
        found = _written_on(found, rng)
    if rng.random() < 0.4:
        _, data = cv2.imencode(".jpg", found, [cv2.IMWRITE_JPEG_QUALITY, int(rng.integers(30, 90))])
        found = np.asarray(cv2.imdecode(data, cv2.IMREAD_COLOR), np.uint8)
    return found


def _framed(picture: Picture, size: tuple[int, int], rng: np.random.Generator) -> Picture:
    """A part of the picture, rolled and stretched a little: no less than about two thirds of it, or the defect is gone."""
    height, width = picture.shape[:2]
    share = rng.uniform(0.8, 1.0)
    stretch = math.exp(rng.uniform(-0.08, 0.08))
    w, h = min(width, width * share * stretch), min(height, height * share / stretch)
    left, top = rng.uniform(0, width - w), rng.uniform(0, height - h)
    angle = rng.normal(0, 0.1)
    # from the wanted frame to the picture: roll about the middle of the part
    cx, cy = left + w / 2, top + h / 2
    sx, sy = w / size[0], h / size[1]
    cos, sin = math.cos(angle), math.sin(angle)
    a = np.array([[cos * sx, -sin * sy], [sin * sx, cos * sy]])
    shift = np.array([cx, cy]) - a @ np.array([size[0] / 2, size[1] / 2])
    shrink = min(sx, sy)
    if shrink > 1.5:
        picture = np.asarray(cv2.GaussianBlur(picture, (0, 0), 0.35 * shrink), np.uint8)
    matrix = np.column_stack([a, shift])
    warped = cv2.warpAffine(
        picture, matrix, size, flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP, borderMode=cv2.BORDER_REPLICATE
    )
    return np.asarray(warped, np.uint8)


def _lit(picture: Picture, rng: np.random.Generator) -> Picture:
    """Another lamp, exposure and white balance; now and then a grey camera."""
    found = picture.astype(np.float32) / 255
    if rng.random() < 0.15:
        found = np.repeat(found.mean(axis=2, keepdims=True), 3, axis=2)
    height, width = picture.shape[:2]
    gain = math.exp(rng.normal(0, 0.25)) * np.exp(rng.normal(0, 0.08, 3)).astype(np.float32)
    x, y = np.meshgrid(np.linspace(-1, 1, width, dtype=np.float32), np.linspace(-1, 1, height, dtype=np.float32))
    slope = rng.normal(0, 0.15, 2)
    light = 1 + np.float32(slope[0]) * x + np.float32(slope[1]) * y
    found = np.clip(found * gain * light[..., None], 0, None) ** np.float32(math.exp(rng.normal(0, 0.2)))
    contrast = math.exp(rng.normal(0, 0.15))
    mean = float(found.mean())
    return np.clip(255 * ((found - mean) * contrast + mean), 0, 255).astype(np.uint8)


def _hazy(picture: Picture, rng: np.random.Generator) -> Picture:
    """Steam lit by the lamp, thickest where the pipe is far."""
    height, width = picture.shape[:2]
    cx, cy = rng.uniform(0.35, 0.65), rng.uniform(0.35, 0.65)
    x, y = np.meshgrid(np.linspace(0, 1, width, dtype=np.float32) - cx, np.linspace(0, 1, height, dtype=np.float32) - cy)
    thick = rng.uniform(0.1, 0.45) * np.exp(-(x * x + y * y) / rng.uniform(0.05, 0.5))
    fog = rng.uniform(90, 220)
    return np.clip(picture * (1 - thick[..., None]) + fog * thick[..., None], 0, 255).astype(np.uint8)


def _soft(picture: Picture, rng: np.random.Generator) -> Picture:
    """Out of focus, or moved along a line."""
    if rng.random() < 0.6:
        return np.asarray(cv2.GaussianBlur(picture, (0, 0), rng.uniform(0.5, 1.6)), np.uint8)
    length = int(rng.integers(3, 7))
    kernel = np.zeros((length, length), np.float32)
    if rng.random() < 0.5:
        kernel[length // 2] = 1 / length
    else:
        kernel[:, length // 2] = 1 / length
    return np.asarray(cv2.filter2D(picture, -1, kernel), np.uint8)


def _interlaced(picture: Picture, rng: np.random.Generator) -> Picture:
    """The odd lines were taken a moment later."""
    found = picture.copy()
    found[1::2] = np.roll(picture[1::2], int(rng.integers(-3, 4)), axis=1)
    return found


def _written_on(picture: Picture, rng: np.random.Generator) -> Picture:
    """Texts, their bars and redaction boxes at random places: every archive has its own, and none may tell a defect."""
    found = picture.copy()
    height, width = found.shape[:2]
    for _ in range(int(rng.integers(1, 5))):
        # mostly near the border, as real ones are
        y = float(rng.choice([rng.uniform(0, 0.2), rng.uniform(0.75, 1.0), rng.uniform(0, 1)]))
        x = rng.uniform(-0.1, 0.8)
        w, h = rng.uniform(0.08, 0.45), rng.uniform(0.03, 0.14)
        left, top = int(x * width), int(y * height)
        right, below = left + int(w * width), top + int(h * height)
        color = BOX_COLORS[int(rng.integers(len(BOX_COLORS)))]
        kind = rng.random()
        if kind < 0.6:
            cv2.rectangle(found, (left, top), (right, below), color, -1)
        if kind > 0.35:
            text = "".join(rng.choice(list(LETTERS), int(rng.integers(4, 22))))
            ink = (255, 255, 255) if sum(color) < 400 or kind >= 0.6 else (0, 0, 0)
            cv2.putText(found, text, (left + 2, below - 2), int(rng.integers(0, 4)), rng.uniform(0.25, 0.55), ink, 1)
    return found
