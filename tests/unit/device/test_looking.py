"""What the survey gives its estimators: the pixels' aspect, rings that are taken in."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import device.landmarks.looking
from device.landmarks.looking import Looking
from estimators.odometry import Position


@pytest.mark.parametrize(
    ("size", "known", "aspect"),
    [((576, 720), None, 0.9375), ((480, 720), None, 1.125), ((576, 720), 1.0, 1.0), ((720, 1280), None, 1.0)],
)
def test_the_focus_of_expansion_is_sought_in_square_pixels(
    monkeypatch: pytest.MonkeyPatch, size: tuple[int, int], known: float | None, aspect: float
) -> None:
    asked: list[float] = []

    def estimate(flow: object, rng: object, config: Any, around: object) -> None:
        asked.append(config.aspect)

    monkeypatch.setattr(device.landmarks.looking, "estimate", estimate)
    looking, rng = Looking(None, None, 0, aspect=known), np.random.default_rng(0)
    wall = rng.integers(0, 255, (size[0], size[1] + 40)).astype(np.uint8)
    for k in range(6):
        looking.look(wall[:, 6 * k : 6 * k + size[1]].copy(), k + 1, 0.04 * k, Position(0.01 * k, 0.01, 0.25, False))
    assert asked
    assert set(asked) == {aspect}
