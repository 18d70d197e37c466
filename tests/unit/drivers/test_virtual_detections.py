"""Detections of the virtual sewer: the ideal ones lie where the truth is, the corrupted ones are as bad as was asked for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from drivers.virtual.camera import CctvCamera, on_wall
from drivers.virtual.detections import FAR_M, TABLE_II, Detector, corrupted, ideal, ideal_at, recorded
from drivers.virtual.drive import Drive, Go, Halt, Wander, demo_drive
from drivers.virtual.landmarks import LABELS, Connection, LandmarkTruth, Patch
from drivers.virtual.profile import circular
from drivers.virtual.rig import Pose
from drivers.virtual.world import VirtualSewer

CAMERA = CctvCamera()
CLEAN = replace(Detector(), noise_px=0.0, bursty=0.0, table=dict.fromkeys(LABELS, (1.0, 1.0)), absent_rate=0.0)
INVERT = np.pi / 2


# --- ideal ---


def test_a_connection_is_seen_where_it_is_projected_and_only_in_view() -> None:
    sewer = VirtualSewer(circular(0.3), 20.0, things=(Connection(5.0, -1.0, 0.1),))
    drive = Drive(sewer, (Go(8.0, 0.25),), wander=Wander(), seed=2)
    seen_at = []
    for t in np.arange(0, drive.length_s, 0.2):
        found = ideal(drive, float(t))
        pixel = CAMERA.project(drive.pose(t), on_wall(0.15, np.array([5.0]), np.array([-1.0])))
        ahead = 5.0 - drive.position(t)
        assert bool(found) == bool(0.4 <= ahead <= FAR_M and CAMERA.holds(pixel)[0])
        if found:
            seen_at.append(ahead)
            assert (found[0].u, found[0].v) == pytest.approx(tuple(pixel[0]))
            assert (found[0].label, found[0].landmark_id) == ("connection", 0)
    assert len(seen_at) > 20


def test_of_a_long_deposit_the_part_in_view_counts() -> None:
    # far beyond both ends of the view: the part from 0.4 to 2.5 m ahead
    long = LandmarkTruth(0, "deposit", 0.0, 30.0, INVERT - 0.3, INVERT + 0.3)
    seen = ideal_at(CAMERA, Pose(chainage=10.0), 0.15, [long])[0]
    v = np.array([point[1] for point in seen.outline]) - CAMERA.cy
    assert CAMERA.fy * 0.15 / v.max() == pytest.approx(0.4, rel=0.02)
    assert CAMERA.fy * 0.15 * np.cos(0.3) / v.min() == pytest.approx(2.5, rel=0.02)
    # a trapezium from y = 27.6 to y = 172.5 whose width grows as y: centroid at 2/3 (b^3 - a^3) / (b^2 - a^2), the curve of
    # the edges aside
    a, b = CAMERA.fy * 0.15 / np.array([2.5, 0.4])
    assert seen.v - CAMERA.cy == pytest.approx(2 / 3 * (b**3 - a**3) / (b**2 - a**2), rel=0.05)
    assert seen.u == pytest.approx(CAMERA.cx, abs=0.5)


def test_a_deposit_that_leaves_the_picture_is_cut_at_its_border() -> None:
    near = LandmarkTruth(0, "deposit", 0.0, 30.0, INVERT - 0.6, INVERT + 0.6)
    seen = ideal_at(CAMERA, Pose(chainage=10.0, pitch=-0.3), 0.15, [near])[0]
    points = np.array(seen.outline)
    assert np.all(CAMERA.holds(points))
    assert points[:, 1].max() == pytest.approx(575.0)
    assert CAMERA.holds(np.array([[seen.u, seen.v]]))[0]


def test_what_lies_behind_or_far_ahead_is_not_seen() -> None:
    for chainage in (4.0, 5.3, 7.6, 20.0):
        assert ideal_at(CAMERA, Pose(chainage=5.0), 0.15, [LandmarkTruth(0, "roots", chainage, chainage, 0.0, 0.5)]) == []


# --- corrupted ---


def test_nothing_to_corrupt_changes_nothing() -> None:
    drive = demo_drive(1)
    for t in (12.0, 30.0, 60.0):
        assert corrupted(drive, t, np.random.default_rng(1), CLEAN) == ideal(drive, t)


def test_precision_and_recall_are_those_of_the_table() -> None:
    drive = demo_drive(3)
    detector, rng = Detector(), np.random.default_rng(3)
    visible, right, wrong = (dict.fromkeys(LABELS, 0) for _ in range(3))
    for number in range(0, int(drive.length_s * 25), 2):
        t = number / 25
        for one in ideal(drive, t):
            visible[one.label] += 1
        for one in corrupted(drive, t, rng, detector):
            (wrong if one.landmark_id is None else right)[one.label] += 1
    for label, (precision, recall) in TABLE_II.items():
        assert visible[label] > 100
        assert right[label] / visible[label] == pytest.approx(recall, abs=0.12)
        assert right[label] / (right[label] + wrong[label]) == pytest.approx(precision, abs=0.12)
    assert sum(right.values()) / sum(visible.values()) == pytest.approx(0.83, abs=0.06)


def test_half_of_what_goes_wrong_lasts_and_stays_fixed_in_the_picture() -> None:
    landmark = LandmarkTruth(0, "connection", 2.0, 2.0, -0.5, -0.5)
    detector = Detector(noise_px=0.0)
    frames = recorded(CAMERA, 0.15, np.full(20_000, 1.0), [landmark], np.random.default_rng(5), detector)
    hit = np.array([any(one.landmark_id == 0 for one in frame) for frame in frames])
    assert hit.mean() == pytest.approx(0.88, abs=0.02)
    edges = np.flatnonzero(np.diff(~hit, prepend=False, append=False))
    lengths = edges[1::2] - edges[::2]
    assert lengths[lengths >= 5].sum() / lengths.sum() == pytest.approx(0.5, abs=0.1)
    places: dict[tuple[float, float], int] = {}
    for frame in frames:
        for one in frame:
            if one.landmark_id is None:
                places[one.u, one.v] = places.get((one.u, one.v), 0) + 1
    lasting = [count for count in places.values() if count > 1]
    assert min(lasting) >= 5
    assert max(lasting) <= 20
    assert sum(lasting) / sum(places.values()) == pytest.approx(0.5, abs=0.06)


def test_noise_is_that_of_the_pixels() -> None:
    landmark = LandmarkTruth(0, "connection", 2.0, 2.0, -0.5, -0.5)
    frames = recorded(CAMERA, 0.15, np.full(2000, 1.0), [landmark], np.random.default_rng(6))
    found = np.array([(one.u, one.v) for frame in frames for one in frame if one.landmark_id == 0])
    truth = CAMERA.project(Pose(chainage=1.0), on_wall(0.15, np.array([2.0]), np.array([-0.5])))[0]
    assert np.allclose(found.mean(axis=0), truth, atol=1.5)
    assert np.allclose(found.std(axis=0), 15.0, rtol=0.1)


def test_a_recorded_way_sees_each_landmark_as_it_passes() -> None:
    truths = [LandmarkTruth(0, "connection", 3.0, 3.0, -1.0, -1.0), LandmarkTruth(1, "deposit", 5.0, 6.0, 1.3, 1.8)]
    frames = recorded(CAMERA, 0.3, np.arange(0, 8, 0.02), truths, np.random.default_rng(1), CLEAN)
    first, last = ([k * 0.02 for k, frame in enumerate(frames) if any(one.landmark_id == i for one in frame)] for i in (0, 1))
    assert first[0] == pytest.approx(0.5, abs=0.03)
    assert first[-1] < 3.0 - 0.4
    assert last[0] == pytest.approx(2.5, abs=0.03)
    assert 5.0 < last[-1] < 6.0


def test_seeds_settle_everything() -> None:
    def run(drive_seed: int, seed: int) -> list[object]:
        drive, rng = demo_drive(drive_seed), np.random.default_rng(seed)
        return [corrupted(drive, t, rng) for t in np.arange(10, 20, 0.2)]

    assert run(1, 2) == run(1, 2)
    assert run(1, 2) != run(1, 3)
    assert run(1, 2) != run(4, 2)


def test_lasting_faults_do_not_hang_on_the_order_of_asking() -> None:
    drive = demo_drive(2)
    frozen = replace(Detector(), noise_px=0.0, bursty=1.0)
    times = [20.0, 30.0, 41.0]
    there = [corrupted(drive, t, np.random.default_rng(1), frozen) for t in times]
    back = [corrupted(drive, t, np.random.default_rng(9), frozen) for t in reversed(times)]
    assert there == back[::-1]


# --- the demo ---


@pytest.mark.parametrize("seed", range(5))
def test_the_demo_has_all_classes_apart_from_each_other(seed: int) -> None:
    drive = demo_drive(seed)
    landmarks = drive.truth.landmarks
    assert {landmark.label for landmark in landmarks} == set(LABELS)
    assert all(1.0 < landmark.chainage <= landmark.chainage_to < 24.0 for landmark in landmarks)
    assert [landmark.id for landmark in landmarks] == list(range(len(landmarks)))
    centres = [landmark.centre[0] for landmark in landmarks]
    assert centres == sorted(centres)
    assert np.diff(centres).min() > 0.2
    seen = {one.landmark_id for t in np.arange(0, drive.length_s / 2, 0.5) for one in ideal(drive, float(t))}
    assert len(seen) == len(landmarks), "the way there passes every one of them"
    assert 100 < drive.length_s < 240
    assert drive.position(drive.length_s) == drive.position(0.0)


def test_a_standing_crawler_sees_the_same() -> None:
    sewer = VirtualSewer(circular(0.3), 20.0, things=(Patch(2.0, 3.0),))
    drive = Drive(sewer, (Go(1.0), Halt(4.0)), seed=1)
    assert ideal(drive, drive.length_s - 2.0) == ideal(drive, drive.length_s - 1.0) != []
