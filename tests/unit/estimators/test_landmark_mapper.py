"""The mapper on small drives made by hand."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pytest

from estimators.detections import Detection
from estimators.landmarks.mapper import Mapper
from estimators.landmarks.projection import PipeCamera, View, project
from estimators.landmarks.types import Landmark, Observation

CAMERA = PipeCamera(500.0, 500.0, 0.3, 720, 576)
CENTRE = (360.0, 288.0)
CROWN, INVERT, RIGHT = -np.pi / 2, np.pi / 2, 0.0


def sighting(
    chainage: float, angle: float, position: float, label: str = "connection", noise: object = None
) -> list[Detection]:
    """What a perfect detector says of one landmark: nothing beyond 3 m or outside the picture."""
    if not 0.02 < chainage - position < 3.0:
        return []
    u, v = project(CAMERA, View(position, CENTRE), np.array([[chainage, angle]]))[0]
    if isinstance(noise, np.random.Generator):
        u, v = np.array([u, v]) + noise.normal(0, 15.0, 2)
    return [Detection(float(u), float(v), label)] if 0 <= u < 720 and 0 <= v < 576 else []


def drive(positions: Sequence[float] | np.ndarray, detect: Callable[[int, float], list[Detection] | None]) -> Mapper:
    mapper = Mapper(CAMERA)
    for k, position in enumerate(positions):
        found = detect(k, float(position))
        detections = None if found is None else tuple(found)
        mapper.update(Observation(k, k * 0.04, View(float(position), CENTRE), detections, 0.005, 2.0))
    return mapper


def only(landmarks: list[Landmark]) -> Landmark:
    assert len(landmarks) == 1
    return landmarks[0]


def test_one_landmark_on_a_straight_drive() -> None:
    rng = np.random.default_rng(0)
    mapper = drive(np.arange(0, 6, 0.015), lambda _, x: sighting(5.0, CROWN, x, noise=rng))
    found = only(mapper.landmarks())
    assert found.label == "connection"
    assert found.status == "passed"
    assert found.chainage == pytest.approx(5.0, abs=0.03)
    assert found.angle == pytest.approx(CROWN, abs=0.05)
    assert found.chainage_from == found.chainage_to == found.chainage
    assert found.belief["connection"] > 0.99
    assert found.belief["false"] < 1e-3
    assert 120 < found.hits <= len(found.sightings) <= 170
    assert found.evidence.frame > found.first_frame
    assert np.hypot(found.evidence.u - 360, found.evidence.v - 288) > 150, "the best picture is one from near by"


def test_a_burst_fixed_in_the_picture_is_no_landmark_but_the_same_sightings_moving_with_the_wall_are() -> None:
    rng = np.random.default_rng(1)

    def fixed(k: int, x: float) -> list[Detection]:
        return [Detection(480 + rng.normal(0, 5), 300 + rng.normal(0, 5), "connection")] if 50 <= k < 70 else []

    def moving(k: int, x: float) -> list[Detection]:
        return sighting(2.0, RIGHT, x, noise=rng) if 50 <= k < 90 else []

    positions = np.arange(0, 4, 0.015)
    assert drive(positions, fixed).landmarks() == []
    assert only(drive(positions, moving).landmarks()).chainage == pytest.approx(2.0, abs=0.1)


def test_standing_still_is_no_evidence() -> None:
    rng = np.random.default_rng(2)
    positions = np.concatenate([np.arange(0, 2.5, 0.015), np.full(500, 2.5)])
    mapper = drive(positions, lambda k, x: sighting(5.0, CROWN, x, noise=rng) if k > 163 else [])
    assert mapper.landmarks() == [], "seen 500 times from the same place, three times while driving"
    assert all(track.hits < 8 for track in mapper.landmarks(include_candidates=True))


def test_misses_count_only_where_the_detector_looked() -> None:
    rng = np.random.default_rng(3)
    every_third = drive(np.arange(0, 6, 0.015), lambda k, x: sighting(5.0, CROWN, x, noise=rng) if k % 3 == 0 else None)
    assert only(every_third.landmarks()).misses <= 3, "but for the sightings beyond the gate"
    unseen = drive(np.arange(0, 6, 0.015), lambda k, x: sighting(5.0, CROWN, x, noise=rng) if k % 3 else [])
    assert only(unseen.landmarks()).misses > 20


def test_neighbours_on_different_clocks_stay_two() -> None:
    rng = np.random.default_rng(4)
    mapper = drive(
        np.arange(0, 6, 0.015),
        lambda _, x: sighting(5.0, CROWN, x, noise=rng) + sighting(5.3, RIGHT, x, noise=rng),
    )
    near, far = mapper.landmarks()
    assert (near.chainage, far.chainage) == (pytest.approx(5.0, abs=0.04), pytest.approx(5.3, abs=0.04))
    assert (near.angle, far.angle) == (pytest.approx(CROWN, abs=0.1), pytest.approx(RIGHT, abs=0.1))


def test_driving_back_finds_the_same_landmark_again() -> None:
    rng = np.random.default_rng(5)
    out = np.arange(0, 6, 0.015)
    mapper = drive(np.concatenate([out, out[::-1], out]), lambda _, x: sighting(5.0, CROWN, x, noise=rng))
    found = only(mapper.landmarks())
    assert found.hits > 400
    assert found.chainage == pytest.approx(5.0, abs=0.03)


def test_a_wrong_label_now_and_then_is_the_same_landmark() -> None:
    rng = np.random.default_rng(6)

    def confused(k: int, x: float) -> list[Detection]:
        return sighting(5.0, CROWN, x, "deposit" if k % 4 == 0 else "connection", rng)

    found = only(drive(np.arange(0, 6, 0.015), confused).landmarks())
    assert found.label == "connection"
    assert {s.label for s in found.sightings} == {"connection", "deposit"}


def test_a_class_nobody_listed_is_a_class() -> None:
    rng = np.random.default_rng(7)
    found = only(drive(np.arange(0, 6, 0.015), lambda _, x: sighting(5.0, CROWN, x, "intruding sealing", rng)).landmarks())
    assert found.label == "intruding sealing"


def test_a_long_deposit_is_one_landmark_with_an_extent() -> None:
    rng = np.random.default_rng(8)

    def patch(_: int, x: float) -> list[Detection]:
        low, high = max(4.0, x + 0.55), min(7.0, x + 3.0)
        return sighting(rng.uniform(low, high), INVERT, x, "deposit", rng) if high > low else []

    found = only(drive(np.arange(0, 9, 0.015), patch).landmarks())
    assert found.chainage_from < 5.2
    assert found.chainage_to > 6.2
    assert found.angle == pytest.approx(INVERT, abs=0.05)


def test_outlines_give_the_extent_round_the_pipe_and_along_it() -> None:
    rng = np.random.default_rng(10)

    def patch(_: int, x: float) -> list[Detection]:
        low, high = max(4.0, x + 0.55), min(5.0, x + 3.0)
        if high - low < 0.05:
            return []
        edge = np.array([[c, INVERT + t] for c in (low, high) for t in (-0.5, 0.0, 0.5)])
        points = project(CAMERA, View(x, CENTRE), edge) + rng.normal(0, 3.0, (6, 2))
        u, v = points.mean(axis=0)
        outline = tuple((float(a), float(b)) for a, b in points)
        return [Detection(float(u), float(v), "deposit", 1.0, 900.0, outline)]

    found = only(drive(np.arange(0, 6, 0.015), patch).landmarks())
    assert found.angle_from == pytest.approx(INVERT - 0.5, abs=0.1)
    assert found.angle_to == pytest.approx(INVERT + 0.5, abs=0.1)
    assert found.chainage_from == pytest.approx(4.0, abs=0.1)
    assert found.chainage_to == pytest.approx(5.0, abs=0.1)


def test_status_goes_from_candidate_to_confirmed_to_passed_and_finish_drops_candidates() -> None:
    rng = np.random.default_rng(9)
    mapper = Mapper(CAMERA)
    seen: list[str] = []
    for k, position in enumerate(np.arange(0, 6, 0.015)):
        found = tuple(sighting(5.0, CROWN, position, noise=rng))
        mapper.update(Observation(k, k * 0.04, View(position, CENTRE), found, 0.005, 2.0))
        for landmark in mapper.landmarks(include_candidates=True):
            if landmark.id == 1 and (not seen or seen[-1] != landmark.status):
                seen.append(landmark.status)
    assert seen == ["candidate", "confirmed", "passed"]
    mapper.update(Observation(999, 40.0, View(6.0, CENTRE), (Detection(500.0, 300.0, "roots"),)))
    assert "candidate" in [landmark.status for landmark in mapper.landmarks(include_candidates=True)]
    mapper.finish()
    assert only(mapper.landmarks(include_candidates=True)).status == "passed"


def test_empty_frames_and_an_empty_pipe() -> None:
    assert drive(np.arange(0, 2, 0.1), lambda k, x: []).landmarks(include_candidates=True) == []
