"""The paper's line numbers: round trips, where they run away, and that the filter's own do not."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from estimators.structure.features import Line
from estimators.structure.orthonormal import frame, from_ends, into_sensor, into_world, pluecker
from estimators.structure.types import Array

seeds = st.integers(0, 100_000)


def _ends(seed: int) -> tuple[Array, Array]:
    rng = np.random.default_rng(seed)
    return rng.normal(size=3) + 1.0, rng.normal(size=3) - 1.0


@settings(max_examples=30, deadline=None)
@given(seeds)
def test_numbers_and_back(seed: int) -> None:
    start, end = _ends(seed)
    numbers = from_ends(start, end)
    direction, moment = pluecker(numbers)
    np.testing.assert_allclose(direction, (end - start) / np.linalg.norm(end - start), atol=1e-9)
    np.testing.assert_allclose(moment, np.cross(start, direction), atol=1e-8)
    assert numbers[3] == pytest.approx(np.linalg.norm(np.cross(start, direction)))
    np.testing.assert_allclose(frame(numbers) @ frame(numbers).T, np.eye(3), atol=1e-9)


@settings(max_examples=30, deadline=None)
@given(seeds)
def test_into_a_sensor_and_back_into_the_world(seed: int) -> None:
    start, end = _ends(seed)
    rotation = Rotation.random(random_state=seed).as_matrix()
    position = np.random.default_rng(seed + 1).normal(size=3)
    world = from_ends(start, end)
    seen = into_sensor(world, rotation, position)
    np.testing.assert_allclose(
        pluecker(seen)[1], pluecker(from_ends(rotation.T @ (start - position), rotation.T @ (end - position)))[1], atol=1e-8
    )
    np.testing.assert_allclose(pluecker(into_world(seen, rotation, position))[1], pluecker(world)[1], atol=1e-7)


def test_a_line_through_the_origin_has_none() -> None:
    with pytest.raises(ValueError, match="origin"):
        from_ends(np.array([1.0, 1, 1]), np.array([2.0, 2, 2]))


def _steepest(start: Array, end: Array) -> float:
    """How much the angles may change (rad) for a millimetre's change of the ends."""
    step = 1e-4
    angles = from_ends(start, end)[:3]
    changes = []
    for move in np.eye(6) * step:
        moved = from_ends(start + move[:3], end + move[3:])[:3] - angles
        changes.append(np.abs((moved + np.pi) % (2 * np.pi) - np.pi).max() / step)
    return max(changes) * 1e-3


def test_a_level_pipe_right_below_the_origin_makes_the_papers_angles_run_away_but_not_ours() -> None:
    beside = _steepest(np.array([-0.5, 1.0, 2.0]), np.array([0.5, 1.0, 2.0]))
    below = _steepest(np.array([-0.5, 1e-3, 2.0]), np.array([0.5, 1e-3, 2.0]))
    assert beside < 0.005
    assert below > 0.5
    # ours: the errors are the changes themselves, wherever the line is
    line = Line(np.array([0.0, 1e-3, 2.0]), np.array([1.0, 0, 0]), np.array([[0.0, 1, 0], [0, 0, 1]]))
    moved = line.moved(np.array([1e-3, 0, 2e-3, 0]))
    assert np.linalg.norm(moved.point - line.point) == pytest.approx(1e-3)
    assert np.linalg.norm(moved.direction - line.direction) == pytest.approx(2e-3, rel=1e-3)
