"""Joints as rings in the picture: a pipe of 200 mm radius about the optical axis, painted by hand."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from estimators.anomaly.deviation import DeviationMap
from estimators.anomaly.joints import Joint
from estimators.anomaly.seams import Seam, find_seams, with_seams
from estimators.pinhole import Intrinsics
from estimators.radial_profile.fit import Wall
from estimators.stereo.rig import StereoRig

R, NAN = 0.2, float("nan")
CAMERA = Intrinsics(960, 600, 560.0, 560.0, 479.5, 299.5)
WALL = Wall(np.r_[R, np.zeros(5)], 1e-8 * np.eye(6), StereoRig(CAMERA, 0.06), 0.2, 1.0, (0.4, 1.4))


def plain(standing_m: float = 0.0) -> DeviationMap:
    """From 0.4 to 1.4 m; the pipe stands off the wall by so much behind 0.75 m."""
    shape = 200, 90
    depth = 0.4 + (np.arange(200) + 0.5) / 200
    theta = (np.arange(90) + 0.5) * (2 * np.pi / 90) - np.pi
    full, everywhere = np.ones(shape, np.float32), np.ones(shape, bool)
    deviation = np.where(depth[:, None] > 0.75, np.float32(standing_m), np.float32(0)) * full
    return DeviationMap(theta, depth, deviation, 3e-4 * full, everywhere, ~everywhere, full, R * full, full, full)


def picture(first: float, last: float, bright: float, around: float = 1.0) -> NDArray[np.uint8]:
    """The wall with noise, and a ring between two depths (m) on so much of the way around."""
    v, u = np.mgrid[0:600, 0:960]
    x, y = u - CAMERA.ppx, v - CAMERA.ppy
    z = CAMERA.fx * R / np.maximum(np.hypot(x, y), 1.0)
    ring = (z > first) & (z < last) & (np.abs(np.arctan2(y, x)) < around * np.pi)
    grey = np.where(ring, 110 * bright, 110.0) * np.random.default_rng(1).normal(1, 0.1, z.shape)
    return np.clip(grey, 0, 255).astype(np.uint8)


@pytest.mark.parametrize("bright", [0.35, 1.8])
@pytest.mark.parametrize("gap", [0.008, 0.03])
def test_a_gap_is_as_long_as_its_ring(gap: float, bright: float) -> None:
    (seam,) = find_seams(picture(0.75, 0.75 + gap, bright), WALL, plain())
    assert seam.gap == pytest.approx(gap, abs=0.0015)
    assert abs(seam.gap - gap) < 3 * seam.gap_std < 0.006
    assert seam.depth == pytest.approx(0.75 + gap / 2, abs=0.003)


def test_no_ring_no_gap_and_a_stain_on_half_of_the_wall_is_none() -> None:
    assert find_seams(picture(0.0, 0.0, 1.0), WALL, plain()) == []
    assert find_seams(picture(0.75, 0.77, 0.4, around=0.5), WALL, plain()) == []


def test_the_edge_of_a_wider_pipe_is_farther_than_it_seems() -> None:
    """Its rim at 0.77 m and 204 mm is seen where the fitted wall is at 0.77 x 200 / 204."""
    (seam,) = find_seams(picture(0.74, 0.77 * R / 0.204, 0.4), WALL, plain(0.004))
    assert seam.gap == pytest.approx(0.03, abs=0.002)


def test_a_ring_tells_its_gap_a_displaced_joint_does_not_and_a_ring_alone_is_a_joint() -> None:
    displaced = Joint(0.75, 0.72, 0.78, NAN, NAN, 0.006, 1.0, offset_std=0.0004)
    ring = Joint(0.95, 0.94, 0.96, 0.02, 0.006, None, None)
    seams = [Seam(0.76, 0.012, 0.001), Seam(0.95, 0.011, 0.001), Seam(1.1, 0.02, 0.001)]
    told = with_seams([displaced, ring], seams)
    assert (told[0].depth, told[0].offset, np.isnan(told[0].gap)) == (0.75, 0.006, True)
    assert [(one.depth, one.gap, one.gap_std, one.offset) for one in told[1:]] == [
        (0.95, 0.011, 0.001, None),
        (1.1, 0.02, 0.001, None),
    ]
    assert told[2].first == pytest.approx(1.09)


def test_a_ring_of_deviations_as_long_as_a_window_tells_no_gap() -> None:
    short, long = (
        Joint(at, at - length / 2, at + length / 2, length, 0.006, None, None) for at, length in ((0.6, 0.02), (1, 0.06))
    )
    told = with_seams([short, long], [Seam(1.0, 0.01, 0.001)])
    assert np.isnan(told[0].gap)
    assert told[1].gap == 0.06  # of so long a gap the picture shows the far face
