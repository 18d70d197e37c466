"""Displaced joints by hand, on maps whose truth is written into them, and in a virtual pair."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from drivers.virtual.landmarks import DisplacedJoint
from drivers.virtual.profile import circular
from drivers.virtual.rig import Pose
from drivers.virtual.stereo_camera import StereoLens, StereoLook, StereoPainter
from drivers.virtual.world import Joint as Gap
from drivers.virtual.world import VirtualSewer
from estimators.anomaly.deviation import DeviationMap
from estimators.anomaly.displaced import ring_shifts, with_displaced
from estimators.anomaly.joints import Joint
from estimators.anomaly.pair import inspect_pair
from estimators.pinhole import Intrinsics
from estimators.stereo.rig import StereoRig

ANGLES, ROWS, RADIUS = 180, 100, 0.2


def flat(noise: float = 0.0003) -> DeviationMap:
    """A map of 1 m of a pipe of 200 mm radius from 0.5 m on, everywhere measured."""
    shape = ROWS, ANGLES
    theta = (np.arange(ANGLES) + 0.5) * (2 * np.pi / ANGLES) - np.pi
    depth = 0.5 + (np.arange(ROWS) + 0.5) / ROWS
    everywhere = np.ones(shape, bool)
    deviation = np.random.default_rng(1).normal(0, noise, shape).astype(np.float32)
    return DeviationMap(
        theta,
        depth,
        deviation,
        np.full(shape, 0.0003, np.float32),
        everywhere,
        ~everywhere,
        np.full(shape, RADIUS * 2 * np.pi / ANGLES / ROWS, np.float32),
        np.full(shape, RADIUS, np.float32),
        np.full(shape, 0.3, np.float32),
        np.full(shape, 2e-4, np.float32),
    )


def displaced(by: float, towards: float) -> DeviationMap:
    """The same, whose second half stands ``by`` (m) further ``towards`` (rad)."""
    found = flat()
    found.deviation[50:] += np.float32(by) * np.cos(found.theta - towards).astype(np.float32)
    return found


@pytest.mark.parametrize(("by", "towards"), [(0.006, 0.0), (0.015, np.pi / 2), (0.025, -2.5)])
def test_a_displacement_is_told_with_its_size_and_side(by: float, towards: float) -> None:
    (joint,) = with_displaced(displaced(by, towards), [])
    assert joint.depth == pytest.approx(1.0, abs=0.03)
    assert joint.first < 1.0 < joint.last
    assert joint.offset == pytest.approx(by, rel=0.05)
    assert joint.offset_theta == pytest.approx(towards, abs=0.05)
    assert np.isnan(joint.gap), "no gap was seen"


def test_a_ring_is_displaced_by_what_the_whole_wall_behind_it_says_with_a_sigma() -> None:
    smeared = Joint(1.01, 0.99, 1.03, 0.03, 0.005, 0.004, 0.3)
    (joint,) = with_displaced(displaced(0.012, 0.5), [smeared])
    assert (joint.depth, joint.step) == (1.01, 0.005)
    assert (joint.offset, joint.offset_theta) == (pytest.approx(0.012, rel=0.05), pytest.approx(0.5, abs=0.05))
    assert abs(joint.offset - 0.012) < 3 * joint.offset_std < 0.002


def test_a_wall_without_one_has_none() -> None:
    assert with_displaced(flat(), []) == []
    leaning = flat()
    leaning.deviation[:] += (0.02 * (leaning.depth[:, None] - 1.0) * np.cos(leaning.theta)).astype(np.float32)
    assert with_displaced(leaning, []) == [], "a wall that was fitted askew is askew everywhere"


def test_a_deposit_that_begins_somewhere_is_no_joint() -> None:
    found = flat()
    found.deviation[50:, 110:150] -= 0.03
    assert with_displaced(found, []) == []


def test_a_wider_pipe_behind_is_not_displaced() -> None:
    found = flat()
    found.deviation[50:] += 0.01
    assert with_displaced(found, []) == []


@pytest.mark.parametrize("unseen", [(slice(None), slice(0, 100)), (slice(52, None), slice(None))], ids=["one side", "behind"])
def test_what_was_not_measured_on_both_sides_is_not_told(unseen: tuple[slice, slice]) -> None:
    found = displaced(0.015, 0.5)
    found.deviation[unseen] = np.nan
    assert with_displaced(found, []) == []


def test_shifts_of_a_ring_that_is_not_round() -> None:
    """An ellipse drawn exactly, and drawn exactly once more a little aside: the shift is what was done to it."""
    found = flat(0.0)
    aside = np.array([0.003, -0.002])

    def radius(theta: np.ndarray, x: float, y: float) -> np.ndarray:
        # the ray from the origin meets the ellipse about (x, y): a quadratic in r
        a, b = 0.2, 0.3
        p = (np.cos(theta) / a) ** 2 + (np.sin(theta) / b) ** 2
        q = np.cos(theta) * x / a**2 + np.sin(theta) * y / b**2
        return (q + np.sqrt(q**2 - p * ((x / a) ** 2 + (y / b) ** 2 - 1))) / p

    plain = radius(found.theta, 0.0, 0.0)
    found = replace(found, radius=np.broadcast_to(plain, (ROWS, ANGLES)).astype(np.float32))
    found.deviation[:] = (radius(found.theta, *aside) - plain).astype(np.float32)
    assert ring_shifts(found) == pytest.approx(np.broadcast_to(aside, (ROWS, 2)), abs=1e-4)


def test_a_displaced_joint_in_a_virtual_pair() -> None:
    lens = StereoLens(Intrinsics(640, 400, 373.0, 373.0, 319.5, 199.5), 0.06)
    # the pipe behind stands in by 14 mm at half past four, so it is displaced towards half past ten
    things = (DisplacedJoint(2.6, np.pi / 4, 0.014),)
    sewer = VirtualSewer(circular(0.4), 4.0, joints=(Gap(2.59, 0.02, 0.01),), things=things)
    left, right = StereoPainter(sewer, lens, StereoLook(), 3).pair(Pose(0.01, -0.01, 2.0, 0.01, 0.0), np.random.default_rng(2))
    found = inspect_pair(left, right, StereoRig(lens.intrinsics, lens.baseline_m, 0.0), np.random.default_rng(2))
    (joint,) = [joint for joint in found.joints if abs(joint.depth - 0.6) < 0.06]
    assert joint.offset == pytest.approx(0.014, abs=0.002)
    assert joint.offset_theta == pytest.approx(-3 * np.pi / 4, abs=0.1)
