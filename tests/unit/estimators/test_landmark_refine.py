"""The second look at a whole drive: whose ids go on, what only lived on a neighbour's strays, and where things lie."""

from dataclasses import replace

import numpy as np
import pytest

from estimators.detections import Detection
from estimators.landmarks.mapper import Mapper
from estimators.landmarks.projection import PipeCamera, View, project
from estimators.landmarks.refine import refine, same_ids
from estimators.landmarks.refine.doubles import echoes
from estimators.landmarks.refine.run import Spot
from estimators.landmarks.types import Evidence, Landmark, Observation, Sighting


def landmark(number: int, frames: range, chainage: float = 1.0) -> Landmark:
    view = View(0.0, (360.0, 288.0))
    seen = tuple(Sighting(number, frame, 0.04 * frame, view, 400.0, 300.0 + frame, "connection", 1.0) for frame in frames)
    return Landmark(
        number, "connection", "passed", chainage, 0.0, np.eye(2), chainage, chainage, 0.0, 0.0,
        {"connection": 1.0}, len(seen), 0, frames[0], frames[-1], Evidence(frames[0], 400.0, 300.0, 50.0), seen,
    )  # fmt: skip


def test_a_landmark_keeps_the_id_that_most_of_its_sightings_had() -> None:
    found = [landmark(7, range(0, 10)), landmark(9, range(10, 14)), landmark(12, range(20, 30))]
    refined = [landmark(1, range(0, 14)), landmark(2, range(20, 30)), landmark(3, range(50, 60))]
    named = same_ids(refined, found)
    assert [one.id for one in named] == [7, 12, 13]  # 9 was a piece of 7, and nobody knew the last
    assert all(seen.landmark == one.id for one in named for seen in one.sightings)


def test_two_that_share_one_do_not_both_get_its_id() -> None:
    named = same_ids([landmark(1, range(0, 3)), landmark(2, range(3, 10))], [landmark(4, range(0, 10))])
    assert [one.id for one in named] == [5, 4]


def spot(chainage: float, label: int = 0) -> Spot:
    return Spot(chainage, chainage, 0.0, np.eye(2), label, np.ones(2) / 2, np.arange(3))


def test_an_echo_is_seen_seldom_and_beside_one_of_its_class() -> None:
    spots = [spot(5.0), spot(5.8), spot(6.0, label=1), spot(20.0), spot(7.0)]
    assert echoes(spots, [0.8, 0.2, 0.2, 0.2, 0.5], far=3.0) == [False, True, False, False, False]
    assert echoes([], [], far=3.0) == []


CAMERA = PipeCamera(430.0, 460.0, 0.15, 720, 576)
ROLL = 0.4
"""Where round the pipe (rad) everything here lies."""


def drive_past(
    chainage: float, spread: float = 0.0, burst: bool = False, noise_px: float = 6.0, seed: int = 1
) -> list[Observation]:
    """A crawler drives past a displaced joint at ``chainage`` that reaches ``spread`` (rad) to either side and is lost 0.4 m
    ahead; a ``burst`` of false detections then stands in the picture where a thing 0.25 m ahead would be."""
    rng = np.random.default_rng(seed)
    frames = []
    around = ROLL + np.linspace(-spread, spread, 9)
    for k, position in enumerate(np.arange(0.0, 7.0, 0.012)):
        view = View(float(position), (360.0, 288.0))
        found: tuple[Detection, ...] = ()
        if 0.4 < chainage - position < 2.5:
            states = np.stack([np.full(9, chainage), around], axis=1)
            points = project(CAMERA, view, states) + rng.normal(0, noise_px, 2)
            outline = tuple((float(u), float(v)) for u, v in points) if spread else ()
            u, v = points.mean(axis=0)
            found = (Detection(float(u), float(v), "displaced joint", outline=outline),)
        elif burst and 0.02 < chainage - position < 0.16:
            u, v = project(CAMERA, View(0.0, view.centre), np.array([[0.25, ROLL + 0.2]]))[0]
            found = (Detection(float(u), float(v), "displaced joint"),)
        frames.append(Observation(k, 0.04 * k, view, found, 0.002, 1.0))
    return frames


def mapped(frames: list[Observation]) -> Landmark:
    mapper = Mapper(CAMERA)
    for frame in frames:
        mapper.update(frame)
    mapper.finish()
    refined = refine(CAMERA, frames, mapper.landmarks(), mapper.config, mapper.names)
    assert len(refined.landmarks) == 1
    return refined.landmarks[0]


def test_a_burst_that_stands_beside_the_camera_does_not_drag_a_point_along() -> None:
    found = mapped(drive_past(5.0, burst=True))
    assert found.chainage == pytest.approx(5.0, abs=0.03)
    assert found.ends_std[0] < 0.05


def test_what_is_bent_round_the_pipe_lies_on_its_wall() -> None:
    # its centroid is 10 % nearer to the axis than the wall, as if it were 5 cm further on
    found = mapped(drive_past(5.0, spread=0.8))
    assert found.chainage == pytest.approx(5.0, abs=0.02)
    assert found.angle == pytest.approx(ROLL, abs=0.03)
    seen = found.sightings[-1]
    assert seen.on_wall is not None
    assert np.hypot(*np.subtract(seen.on_wall, seen.view.centre)) > 1.05 * np.hypot(seen.u - 360.0, seen.v - 288.0)


def test_what_all_of_a_landmark_shares_is_in_both_its_ends() -> None:
    long = replace(landmark(1, range(5)), covariance=np.diag([0.01, 0.1]), ends=np.diag([0.02, 0.03]))
    unsure = long.less_sure(0.06)
    assert unsure.ends_std == pytest.approx((np.sqrt(0.08), 0.3))
    assert unsure.covariance[0, 0] == pytest.approx(0.07)
    assert landmark(1, range(5)).less_sure(3.0).ends_std == pytest.approx((2.0, 2.0))
