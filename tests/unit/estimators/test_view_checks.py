"""Pictures built by hand: a wall of noise that is driven along, and what spoils it."""

from collections.abc import Iterator
from functools import lru_cache

import cv2
import numpy as np
import pytest

from estimators.flow import Flow
from estimators.flow import flow as flow_between
from estimators.foe import Foe
from estimators.view_checks import (
    Standing,
    Watch,
    Way,
    dirty_lens,
    expansion,
    image_stands,
    off_axis,
    signal_lost,
    slip,
    standing,
    too_bright,
    too_dark,
    too_fast,
)

SHAPE = (288, 360)
CENTRE = (170.0, 150.0)
U, V = np.meshgrid(np.arange(SHAPE[1]), np.arange(SHAPE[0]))
AWAY = np.maximum(np.hypot(U - CENTRE[0], V - CENTRE[1]), 1.0)
FOCAL_RADIUS = 40.0
"""f R (px m) of the pipe below: a point at AWAY is FOCAL_RADIUS / AWAY metres ahead."""


ANGLE = np.arctan2(V - CENTRE[1], U - CENTRE[0])
LIGHT = (110 * np.minimum(AWAY / 80, 1)).astype(np.float32)
AROUND = ((ANGLE + np.pi) * (1023 / (2 * np.pi))).astype(np.float32)
AHEAD = (256 * FOCAL_RADIUS / AWAY).astype(np.float32)


@lru_cache(maxsize=2)
def unrolled(seed: int) -> np.ndarray:
    """(1024, 1024): 4 m of wall along, once around."""
    noise = cv2.GaussianBlur(np.random.default_rng(seed).normal(size=(1024, 1024)).astype(np.float32), (0, 0), 3)
    return np.asarray(noise / noise.std())


def wall(chainage: float, seed: int = 0) -> np.ndarray:
    """(H, W) uint8 at ``chainage`` (m): noise that sticks to the wall, brighter near the camera."""
    along = (np.float32(256 * chainage) + AHEAD) % np.float32(1023)
    texture = cv2.remap(unrolled(seed), AROUND, along, cv2.INTER_LINEAR)
    return np.clip(LIGHT + 25 * texture, 0, 255).astype(np.uint8)


def spots(image: np.ndarray) -> np.ndarray:
    """Six drops of dirt on the lens, out of focus."""
    return np.asarray(cv2.multiply(image, LET_THROUGH, scale=1 / 255), np.uint8)


def _let_through() -> np.ndarray:
    light = np.full(SHAPE, 255.0)
    for u, v in ((60, 60), (300, 70), (60, 220), (290, 230), (180, 40), (240, 260)):
        light *= 1 - 0.8 / (1 + np.exp((np.hypot(U - u, V - v) - 20) / 2))
    return light.astype(np.uint8)


LET_THROUGH = _let_through()


def text(image: np.ndarray) -> np.ndarray:
    """A black box with white text, as recorders burn it in."""
    written = image.copy()
    cv2.rectangle(written, (10, 240), (130, 275), 0, -1)
    cv2.putText(written, "0042.3 m", (14, 265), cv2.FONT_HERSHEY_SIMPLEX, 0.7, 255, 2)
    return written


def foe(travel: float) -> Foe:
    """What the fit says of a wall that was driven along by ``travel`` (m)."""
    return Foe(np.array(CENTRE), np.eye(2), 0.9, 200, rate=travel / FOCAL_RADIUS)


def a_flow(length: float = 3.0, points: int = 200, tried: int = 220) -> Flow:
    rng = np.random.default_rng(0)
    return Flow(rng.uniform(0, 280, (points, 2)), np.tile([length, 0.0], (points, 1)), tried)


def driven(pictures: int, spoil=lambda image: image, step: float = 0.05) -> Standing:
    seen = None
    for k in range(pictures):
        seen = standing(spoil(wall(step * k)), CENTRE, seen)
    assert seen is not None
    return seen


def test_expansion_is_the_motion_a_quarter_of_the_diagonal_out() -> None:
    away = 0.25 * np.hypot(*SHAPE)
    depth = FOCAL_RADIUS / away
    moved = FOCAL_RADIUS / (depth - 0.001) - away
    assert expansion(foe(0.001), SHAPE) == pytest.approx(moved, rel=0.01)


def test_a_wheel_that_slips() -> None:
    assert slip(Way(0.0, 0.01, 40.0, 400.0)).failed
    assert slip(Way(0.0, 0.01, -40.0, 400.0)).failed  # driving back
    assert not slip(Way(0.1, 0.01, 40.0, 400.0)).failed
    assert not slip(Way(0.0, 0.1, 40.0, 400.0)).failed  # a counter that steps by 0.1 m has yet to step
    assert not slip(Way(0.0, 0.1, 40.0)).failed
    assert slip(Way(0.0, 0.0, 40.0)).failed


def test_a_cable_that_is_pulled() -> None:
    assert image_stands(Way(0.4, 0.1, 2.0, 400.0)).failed
    assert image_stands(Way(-0.4, 0.1, -2.0)).failed
    assert not image_stands(Way(0.4, 0.1, 150.0, 400.0)).failed
    assert not image_stands(Way(0.1, 0.1, 0.0, 400.0)).failed  # one step of the counter
    assert not image_stands(Way(0.4, 0.1, 60.0)).failed  # of a wide pipe, where the picture moves little


def test_too_fast_by_length_and_by_what_is_lost() -> None:
    assert not too_fast(a_flow(3.0), (576, 720)).failed
    assert too_fast(a_flow(45.0), (576, 720)).failed
    assert too_fast(a_flow(3.0, points=60), (576, 720)).failed
    assert not too_fast(a_flow(3.0, points=3, tried=10), (576, 720)).failed  # hardly any texture says nothing
    assert not too_fast(Flow(np.empty((0, 2)), np.empty((0, 2)), 0), (576, 720)).failed


def test_a_real_leap_is_too_fast_and_a_step_is_not() -> None:
    here = wall(0.0)
    assert not too_fast(flow_between(here, wall(0.002)), SHAPE).failed
    leap = too_fast(flow_between(here, wall(0.3)), SHAPE)
    assert leap.failed
    assert leap.numbers["lost_share"] > 0.6


def test_light() -> None:
    image = wall(0.0)
    assert not too_dark(image).failed
    assert not too_bright(image).failed
    assert too_dark((image * 0.15).astype(np.uint8)).failed
    assert too_bright(np.clip(image * 3.0, 0, 255).astype(np.uint8)).failed


def test_off_axis() -> None:
    assert not off_axis((380.0, 300.0), (576, 720)).failed
    assert off_axis((600.0, 288.0), (576, 720)).failed
    assert off_axis((360.0, 288.0), (576, 720), (0.1, 0.5)).failed
    numbers = off_axis((359.5, 287.5), (576, 720), (0.3, -0.4)).numbers
    assert numbers == pytest.approx({"aside": 0, "offset": 0.5})


def test_signal_lost() -> None:
    image = wall(0.0)
    snow = np.random.default_rng(0).integers(0, 255, SHAPE).astype(np.uint8)
    blue = np.full(SHAPE, 29, np.uint8)
    assert signal_lost(snow).failed
    assert signal_lost(blue).failed
    assert not signal_lost(image).failed
    grain = np.random.default_rng(1).normal(0, 8, SHAPE)
    assert not signal_lost(np.clip(image * 0.4 + grain, 0, 255).astype(np.uint8)).failed  # a bad camera is no lost one
    assert signal_lost(image, image.copy(), travel=0.2).failed
    assert not signal_lost(image, image.copy(), travel=0.0).failed  # a recording of a crawler that stands
    assert not signal_lost(image, wall(0.01), travel=0.2).failed


def test_dirt_stands_while_the_wall_moves() -> None:
    clean, dirty = dirty_lens(driven(25)), dirty_lens(driven(25, spots))
    assert not clean.failed
    assert dirty.failed
    assert dirty.numbers["share"] > 5 * clean.numbers["share"]


def test_text_and_lines_along_the_pipe_are_no_dirt() -> None:
    def water(image: np.ndarray) -> np.ndarray:
        return np.where(np.abs(ANGLE - np.pi / 2) < 0.5, image * 0.4, image).astype(np.uint8)

    assert not dirty_lens(driven(25, text)).failed
    assert not dirty_lens(driven(25, water)).failed
    assert dirty_lens(driven(25, lambda image: text(spots(image)))).failed


def test_little_is_said_of_few_pictures_or_of_a_camera_that_stands() -> None:
    assert not dirty_lens(driven(5, spots)).failed
    watch, image = Watch(), spots(wall(0.0))
    for k in range(200):  # nothing moves, so that all stands
        assert watch.add(image, k / 25, a_flow(0.02), None, CENTRE, 1.0) == ()


def watched(
    watch: Watch, seconds: float, speed: float, counted: float, spoil=lambda image: image, quantum: float = 0.0
) -> Iterator[set[str]]:
    """The codes told in each picture of a drive at ``speed`` (m/s), where the counter runs at ``counted`` (m/s)."""
    for k in range(int(seconds * 25)):
        image = spoil(wall(k * speed / 25))
        image[k % SHAPE[0]] ^= 1  # no two pictures of a camera are the same
        found = foe(speed / 25) if abs(speed) > 0.01 else None
        flow = a_flow(speed / 25 * 200)
        distance = k * counted / 25
        if quantum:
            distance = np.floor(distance / quantum) * quantum
        yield {check.code for check in watch.add(image, k / 25, flow, found, CENTRE, distance, quantum)}


@pytest.mark.parametrize("quantum", [0.0, 0.1])
def test_a_clean_drive_and_a_halt_are_quiet(quantum: float) -> None:
    assert not set.union(*watched(Watch(), 8, 0.2, 0.2, quantum=quantum))
    assert not set.union(*watched(Watch(), 4, 0.0, 0.0, quantum=quantum))


def test_slip_and_its_opposite_are_told_within_seconds() -> None:
    slipping = list(watched(Watch(), 4, 0.3, 0.0))
    assert slipping[-1] == {"slip"}
    assert slipping[20] == set()
    assert list(watched(Watch(), 4, 0.0, 0.2))[-1] == {"image_stands"}


def test_a_camera_that_pans_while_the_crawler_stands_is_no_slip() -> None:
    watch = Watch()
    for k in range(100):
        assert watch.add(np.roll(wall(0.0), 4 * k, axis=1), k / 25, a_flow(8.0), None, CENTRE, 1.0) == ()


def test_dirt_is_told_and_forgotten_once_the_lens_is_clean() -> None:
    watch = Watch()
    assert "dirty_lens" in list(watched(watch, 8, 0.3, 0.3, spots))[-1]
    assert "dirty_lens" not in list(watched(watch, 12, 0.3, 0.3))[-1]


def test_a_fault_has_to_last_and_a_lost_signal_silences_the_rest() -> None:
    watch = Watch()
    blue = np.full(SHAPE, 29, np.uint8)
    told = [{check.code for check in watch.add(blue, k / 25, None, None, CENTRE, 0.0)} for k in range(40)]
    assert told[10] == set()
    assert told[-1] == {"signal_lost"}
    assert watch.add(wall(0.0), 2.0, a_flow(), foe(0.008), CENTRE, 0.0) == ()
