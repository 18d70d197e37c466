"""The virtual campaign: the paper's, settled by its seed, and true to what it says of itself."""

from __future__ import annotations

import pickle
from collections import Counter
from itertools import islice

import numpy as np
import pytest

from drivers.depth.base import STEREO_SCALE_STD
from drivers.virtual.campaign import CAMERA, SIZES_MM, TROUBLES, campaign
from estimators.pinhole import rays


def test_it_mirrors_the_paper() -> None:
    found = campaign(7)
    assert len(found) == 101
    pipes = Counter(recording.pipe_id for recording in found)
    assert len(pipes) == 74
    assert sum(count == 2 for count in pipes.values()) == 27
    for recording in found:
        assert recording.dn in SIZES_MM
        assert (pipes[recording.pipe_id] == 2) == (recording.dn > 250)
        assert set(recording.troubles) <= set(TROUBLES)
    assert min(recording.dn for recording in found) == 150
    assert max(recording.dn for recording in found) == 1100
    assert {recording.position for recording in found} == {"top", "middle"}


def test_truth_is_the_mean_diameter_of_the_profile_and_near_its_size() -> None:
    for recording in campaign(7):
        assert recording.truth_diameter_m == recording.sewer.profile.mean_diameter
        assert recording.truth_diameter_m == pytest.approx(recording.dn / 1000, rel=0.06)


def test_the_two_recordings_of_a_pipe_look_into_the_same_pipe_with_the_same_camera() -> None:
    found = campaign(7)
    for first in found:
        for second in found:
            if first.pipe_id == second.pipe_id and first.id != second.id:
                assert first.truth_diameter_m == second.truth_diameter_m
                assert first.window.scale == second.window.scale
                assert first.pose != second.pose


def test_the_box_hangs_inside_the_pipe_above_the_water() -> None:
    for recording in campaign(8):
        pose, sewer = recording.pose, recording.sewer
        assert np.hypot(pose.right, pose.down) < np.mean(sewer.profile.radii)
        assert pose.down < sewer.profile.below() - sewer.water


def test_the_seed_settles_every_pixel_also_in_another_process() -> None:
    first, again = campaign(9, recordings=3), campaign(9, recordings=3)
    sent = pickle.loads(pickle.dumps(first))
    for recording, same, copy in zip(first, again, sent, strict=True):
        pictures = [[depth for depth, _, _ in islice(one.frames(), 2)] for one in (recording, same, copy)]
        for other in pictures[1:]:
            assert all(np.array_equal(a, b) for a, b in zip(pictures[0], other, strict=True))
        assert not np.array_equal(pictures[0][0], pictures[0][1])


def test_other_seeds_are_other_campaigns() -> None:
    one, other = campaign(10), campaign(11)
    assert [recording.dn for recording in one] != [recording.dn for recording in other]
    assert not {recording.truth_diameter_m for recording in one} & {recording.truth_diameter_m for recording in other}


def test_the_scale_error_is_as_large_as_the_device_is_told() -> None:
    scales = [recording.window.scale for seed in range(6) for recording in campaign(seed)[::2]]
    assert np.std(scales) == pytest.approx(STEREO_SCALE_STD, rel=0.2)
    assert abs(np.mean(scales)) < 0.3 * STEREO_SCALE_STD


def test_frames_show_the_pipe_they_come_from() -> None:
    checked = 0
    for recording in campaign(12):
        if not {"out of round", "dent", "poor light", "hopeless", "chamber in view", "hand motion"}.isdisjoint(
            recording.troubles
        ):
            continue
        depth, lens, unit = next(recording.frames(1))
        assert (lens, depth.shape, depth.dtype) == (CAMERA, (480, 640), np.uint16)
        z = depth * unit
        points = np.dstack([rays(lens)[..., 0] * z, rays(lens)[..., 1] * z, z])[(depth > 0) & (z < 1.5)]
        inside = points @ recording.pose.rotation.T + recording.pose.position
        radius = np.hypot(inside[:, 0], inside[:, 1])
        truth = recording.truth_diameter_m / 2
        near_wall = np.abs(radius - truth) < 0.05 * truth + 0.01
        assert near_wall.mean() > 0.3, recording.troubles
        checked += 1
        if checked == 8:
            return
    pytest.fail("too few plain recordings to look at")
