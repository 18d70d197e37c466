"""What is drawn into the CCTV picture lies where the projection says."""

from __future__ import annotations

import math

import numpy as np

from device.landmarks.overlay import Mark, Scene, draw
from estimators.landmarks.projection import PipeCamera, View, project

CAMERA = PipeCamera(400.0, 400.0, 0.15, 320, 240)
BLACK = np.zeros((240, 320, 3), np.uint8)
VIEW = View(2.4, (160.0, 120.0))


def changed(picture: np.ndarray, u: float, v: float) -> bool:
    """Whether anything was drawn within two pixels."""
    return bool(picture[round(v) - 2 : round(v) + 3, round(u) - 2 : round(u) + 3].any())


def test_the_grid_has_a_ring_at_each_metre_and_the_picture_itself_stays() -> None:
    drawn = draw(BLACK, Scene(CAMERA, VIEW))
    assert not BLACK.any()
    for metre in (3.0, 4.0, 5.0):
        u, v = project(CAMERA, VIEW, np.array([[metre, math.radians(17.0)]]))[0]
        assert changed(drawn, u, v), metre
    u, v = project(CAMERA, VIEW, np.array([[3.5, math.radians(45.0)]]))[0]
    assert not changed(drawn, u, v)  # between two rings and two hours


def test_a_landmark_is_drawn_where_it_should_be_seen() -> None:
    u, v = project(CAMERA, VIEW, np.array([[3.1, 0.3]]))[0]
    bare = draw(BLACK, Scene(CAMERA, VIEW))
    marked = draw(BLACK, Scene(CAMERA, VIEW, [Mark("7 connection", "confirmed", 3.1, 0.3)]))
    rows, columns = np.nonzero((marked != bare).any(axis=2))
    assert len(rows) > 50
    assert abs(columns.min() - (u - 14)) < 4
    assert abs((rows.min() + rows.max()) / 2 - v) < 8


def test_what_lies_behind_or_outside_is_not_drawn_and_nothing_breaks() -> None:
    marks = [Mark("a", "passed", 1.0, 0.0), Mark("b", "candidate", 2.45, 1.0), Mark("c", "confirmed", float("nan"), 0.0)]
    assert np.array_equal(draw(BLACK, Scene(CAMERA, VIEW, marks)), draw(BLACK, Scene(CAMERA, VIEW)))
    draw(BLACK, Scene(CAMERA, View(2.4, (5000.0, -3000.0)), marks, [((math.nan, 1.0), (3.0, 3.0), 0.0)]))


def test_without_a_known_focal_length_only_joints_and_the_centre_are_drawn() -> None:
    drawn = draw(BLACK, Scene(None, VIEW, joints=[((160.0, 120.0), (100.0, 90.0), 0.0)]))
    assert changed(drawn, 210.0, 120.0)
    assert changed(drawn, 160.0, 120.0)
    assert not changed(drawn, 250.0, 60.0)
