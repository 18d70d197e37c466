"""The colour of a region against the wall about it, on pictures painted for the purpose."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import pytest

from device.anomaly.result import _region
from estimators.anomaly.colour import ATTACHED, RegionColour, named_by_colour, region_colours
from estimators.anomaly.regions import Region
from estimators.pinhole import Intrinsics, rays
from tests.unit.estimators.test_displaced_joints import ANGLES, RADIUS, ROWS, flat

CAMERA = Intrinsics(640, 400, 373.0, 373.0, 319.5, 199.5)
GREY, BROWN = np.array([118.0, 122.0, 125.0]), np.array([60.0, 95.0, 125.0])
"""Blue, green, red."""
WHERE = (0.75, 0.95, -0.4, 0.4)
"""Depth from, to (m) and angle from, to (rad) of the region: at three o'clock."""


def region(kind: str = "intrusion") -> Region:
    found = flat()
    inside = (found.depth[:, None] >= WHERE[0]) & (found.depth[:, None] < WHERE[1])
    inside = inside & (found.theta >= WHERE[2]) & (found.theta < WHERE[3])
    cells = np.flatnonzero(inside)
    return Region(0.03, -0.02, -0.0003, 0.85, 0.0, (WHERE[0], WHERE[1]), WHERE[3] - WHERE[2], kind, False, 1.0, cells)


def painted(wall: Any, thing: Any, shade: float = 1.0, mottled: float = 0.0) -> np.ndarray[Any, Any]:
    """A pipe of 200 mm radius from its axis, lit by a lamp there; ``shade`` is the thing's brightness against the wall's,
    ``mottled`` how much the wall's tint changes from place to place."""
    rng = np.random.default_rng(4)
    sight = rays(CAMERA).astype(np.float64)
    depth = RADIUS / np.maximum(np.hypot(sight[..., 0], sight[..., 1]), 1e-3)
    theta = np.arctan2(sight[..., 1], sight[..., 0])
    inside = (depth >= WHERE[0]) & (depth < WHERE[1]) & (theta >= WHERE[2]) & (theta < WHERE[3])
    stains = cv2.GaussianBlur(rng.normal(size=(400, 640)), (0, 0), 12)
    tint = np.exp(mottled * (stains / stains.std())[..., None] * [-1.0, 0.0, 1.0])
    colour = np.where(inside[..., None], np.asarray(thing) * shade, np.asarray(wall) * tint)
    light = np.clip(0.8 / np.maximum(depth, 0.3), 0.0, 1.6)[..., None]
    return np.asarray(np.clip(colour * light + rng.normal(0, 3, colour.shape), 0, 255), dtype=np.uint8)


def colour_of(picture: np.ndarray[Any, Any]) -> RegionColour | None:
    (found,) = region_colours(picture, flat(), CAMERA, [region()])
    return found


def test_a_thing_of_another_colour_is_told_and_named() -> None:
    found = colour_of(painted(GREY, BROWN))
    assert found is not None
    assert found.plain
    # ln(60/95) - ln(118/122) of blue, ln(125/95) - ln(125/122) of red
    assert found.tint == pytest.approx(np.hypot(-0.426, 0.250), abs=0.04)
    assert found.region[0] > found.region[2], "red, green, blue"
    assert max(found.wall) - min(found.wall) < 15
    (named,) = named_by_colour([region()], [found])
    assert named.kind == ATTACHED
    told = _region(named, found)
    assert (told["kind"], told["colour"]["plain"]) == (ATTACHED, True)


@pytest.mark.parametrize("kind", ["deposit", "loss", "object", "joint"])
def test_other_kinds_are_known_by_where_they_are(kind: str) -> None:
    (named,) = named_by_colour([region(kind)], [colour_of(painted(GREY, BROWN))])
    assert named.kind == kind


@pytest.mark.parametrize("shade", [0.5, 1.4])
def test_light_and_shade_are_no_colour(shade: float) -> None:
    found = colour_of(painted(GREY, GREY, shade))
    assert found is not None
    assert found.tint < 0.05
    assert not found.plain
    (named,) = named_by_colour([region()], [found])
    assert named.kind == "intrusion"


def test_on_a_mottled_wall_no_colour_is_plain() -> None:
    found = colour_of(painted(GREY, [90.0, 115.0, 125.0], mottled=0.25))
    assert found is not None
    assert found.spread > 0.08
    assert not found.plain


def test_without_colour_or_light_nothing_is_told() -> None:
    picture = painted(GREY, BROWN)
    grey = cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)
    assert colour_of(grey) is None
    assert colour_of(cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR)) is None
    assert colour_of(np.asarray(picture // 12, dtype=np.uint8)) is None
    assert _region(region(), None)["colour"] is None


def test_the_map_of_the_tests_is_what_the_picture_shows() -> None:
    assert flat().points.shape == (ROWS, ANGLES, 3)
    assert np.allclose(np.hypot(*flat(0.0).points[0, :, :2].T), RADIUS, atol=1e-6)
