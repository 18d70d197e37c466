"""The second look at a whole drive: whose ids go on, and what only lived on a neighbour's strays."""

import numpy as np

from estimators.landmarks.projection import View
from estimators.landmarks.refine import same_ids
from estimators.landmarks.refine.doubles import echoes
from estimators.landmarks.refine.run import Spot
from estimators.landmarks.types import Evidence, Landmark, Sighting


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
