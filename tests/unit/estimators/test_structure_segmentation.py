"""Planes, pipes and objects of a scan, from shapes whose truth is known."""

from __future__ import annotations

import numpy as np
import pytest

from estimators.structure.apart import take_apart, undistorted
from estimators.structure.cloud import surface_of
from estimators.structure.coverage import Coverage
from estimators.structure.pipes import find_pipes, merged
from estimators.structure.planes import find_planes, off_planes
from estimators.structure.types import PIPE_RADIUS, Array, Segment


def half_pipe(start: Array, end: Array, noise: float, rng: np.random.Generator, radius: float = PIPE_RADIUS) -> Array:
    """The side of a pipe that faces the origin, every 8 mm, with noise along the view."""
    axis = (end - start) / np.linalg.norm(end - start)
    first = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
    first /= np.linalg.norm(first)
    second = np.cross(axis, first)
    along, turn = np.meshgrid(np.arange(0, np.linalg.norm(end - start), 0.008), np.arange(0, 2 * np.pi, 0.2))
    normals = np.cos(turn.ravel())[:, None] * first + np.sin(turn.ravel())[:, None] * second
    points = start + along.ravel()[:, None] * axis + radius * normals
    faces = np.einsum("ij,ij->i", normals, -points / np.linalg.norm(points, axis=1, keepdims=True)) > 0.2
    points = points[faces]
    return points * (1 + rng.normal(0, noise, (len(points), 1)) / np.linalg.norm(points, axis=1, keepdims=True))


def floor(rng: np.random.Generator, noise: float = 0.005) -> Array:
    x, z = (grid.ravel() for grid in np.meshgrid(np.arange(-1, 1, 0.02), np.arange(1.5, 3.5, 0.02)))
    return np.column_stack([x, 0.8 + rng.normal(0, noise, len(x)), z])


def test_a_floor_is_a_plane_and_a_pipe_is_none() -> None:
    rng = np.random.default_rng(0)
    pipe = half_pipe(np.array([-0.6, 0.0, 2.5]), np.array([0.6, 0.0, 2.5]), 0.004, rng)
    points = np.vstack([floor(rng), pipe])
    planes = find_planes(surface_of(points, 16))
    assert len(planes) == 1
    assert abs(planes[0][0][1]) > 0.999
    assert abs(planes[0][1]) == pytest.approx(0.8, abs=0.005)
    kept = off_planes(points, planes, 0.03)
    assert kept[len(points) - len(pipe) :].mean() == 1.0
    assert kept[: len(points) - len(pipe)].mean() < 0.01


def _found(points: Array, rng: np.random.Generator) -> list[Segment]:
    surface = surface_of(points, 24)
    return find_pipes(surface.points, surface.normals, rng)[0]


def test_pipes_are_found_where_they_are_with_their_ends() -> None:
    rng = np.random.default_rng(1)
    truths = [
        (np.array([-0.6, 0.1, 2.5]), np.array([0.6, 0.1, 2.5])),
        (np.array([0.3, -0.9, 2.7]), np.array([0.3, -0.1, 2.7])),
        (np.array([-0.5, -0.5, 2.2]), np.array([-0.5, -0.5, 3.0])),
    ]
    found = _found(np.vstack([half_pipe(*ends, 0.004, rng) for ends in truths]), rng)
    assert len(found) == 3
    for start, end in truths:
        axis = (end - start) / np.linalg.norm(end - start)
        best = min(
            found, key=lambda s: float(np.linalg.norm(np.cross(s.middle - start, axis)) + abs(1 - abs(s.direction @ axis)))
        )
        assert np.linalg.norm(np.cross(best.middle - start, axis)) < 0.004
        assert abs(best.direction @ axis) > np.cos(np.radians(0.8))
        assert best.length == pytest.approx(np.linalg.norm(end - start), abs=0.05)
        assert np.linalg.eigvalsh(best.covariance).min() > 0


def test_what_is_too_short_is_no_pipe() -> None:
    rng = np.random.default_rng(2)
    short = half_pipe(np.array([0.0, 0, 2.5]), np.array([0.22, 0, 2.5]), 0.003, rng)
    assert _found(short, rng) == []
    assert find_pipes(np.zeros((3, 3)), np.zeros((3, 3)), rng)[0] == []


def test_a_fitting_does_not_pull_the_axis() -> None:
    """A pipe of 0.7 m whose one half is hidden in a fitting that is 7 mm thicker."""
    rng = np.random.default_rng(3)
    plain = half_pipe(np.array([-0.35, 0, 2.5]), np.array([0.1, 0, 2.5]), 0.004, rng)
    fitting = half_pipe(np.array([0.1, 0, 2.5]), np.array([0.35, 0, 2.5]), 0.004, rng, radius=0.0385)
    found = _found(np.vstack([plain, fitting]), rng)
    assert len(found) == 1
    assert np.linalg.norm(np.cross(found[0].middle - [0, 0, 2.5], [1.0, 0, 0])) < 0.004
    assert abs(found[0].direction[0]) > np.cos(np.radians(1.0))


def _segment(start: list[float], end: list[float]) -> Segment:
    a, b = np.array(start), np.array(end)
    axis = (b - a) / np.linalg.norm(b - a)
    first = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
    first /= np.linalg.norm(first)
    return Segment(
        a, b, np.array([first, np.cross(axis, first)]), np.eye(4) * 1e-6, np.arange(0.01, np.linalg.norm(b - a), 0.02)
    )


def test_collinear_and_doubled_segments_are_one_parallel_ones_two() -> None:
    """Fig. 8."""
    one = merged([_segment([0, 0, 2], [0.5, 0, 2]), _segment([1.2, 0.01, 2], [0.7, 0.01, 2])])
    assert len(one) == 1
    assert one[0].length == pytest.approx(1.2, abs=0.01)
    assert one[0].bins.min() >= 0
    assert one[0].bins.max() <= 1.2
    assert len(merged([_segment([0, 0, 2], [1, 0, 2]), _segment([0.1, 0.01, 2], [0.9, 0.01, 2])])) == 1
    assert len(merged([_segment([0, 0, 2], [1, 0, 2]), _segment([0, 0.1, 2], [1, 0.1, 2])])) == 2
    assert len(merged([_segment([0, 0, 2], [1, 0, 2]), _segment([2, 0, 2], [3, 0, 2])])) == 2
    assert len(merged([_segment([0, 0, 2], [1, 0, 2]), _segment([0.5, -0.5, 2], [0.5, 0.5, 2])])) == 2


def test_a_pipe_along_the_near_sides_of_two_valves_is_none() -> None:
    """Seen as a second pipe, it takes the valves off the one that they sit on."""
    pipe = _segment([0, 0, 2], [0.9, 0, 2])
    for near in (0.01, 0.026, 0.041):
        (kept,) = merged([pipe, _segment([0.1, 0, 2 - near], [0.55, 0, 2 - near])])
        assert kept is pipe
    assert len(merged([pipe, _segment([0.1, 0, 2 - 2.1 * PIPE_RADIUS], [0.55, 0, 2 - 2.1 * PIPE_RADIUS])])) == 2
    rng = np.random.default_rng(5)
    pieces = ((-0.45, -0.1, PIPE_RADIUS), (-0.1, 0.0, 0.0605), (0.0, 0.25, PIPE_RADIUS), (0.25, 0.45, 0.0555))
    points = [half_pipe(np.array([a, 0, 2.5]), np.array([b, 0, 2.5]), 0.004, rng, radius) for a, b, radius in pieces]
    (found,) = _found(np.vstack(points), rng)
    assert np.linalg.norm(np.cross(found.middle - [0, 0, 2.5], [1.0, 0, 0])) < 0.004


def test_the_end_of_a_valve_beside_a_pipes_line_is_no_piece_of_the_pipe() -> None:
    rng = np.random.default_rng(3)
    pipe = half_pipe(np.array([0.2, -0.8, 2.5]), np.array([0.2, -0.1, 2.5]), 0.003, rng)
    valve = half_pipe(np.array([0.2, 0.12, 2.5]), np.array([0.2, 0.23, 2.5]), 0.003, rng)
    (found,) = _found(np.vstack([pipe, valve]), rng)
    assert found.length == pytest.approx(0.7, abs=0.03)


def test_objects_stand_where_pipes_meet_and_where_they_are_thick() -> None:
    rng = np.random.default_rng(4)
    corner = np.array([-0.6, 0.0, 2.5])
    points = np.vstack(
        [
            half_pipe(corner, np.array([0.9, 0.0, 2.5]), 0.004, rng),
            half_pipe(corner, np.array([-0.6, -0.8, 2.5]), 0.004, rng),
            half_pipe(np.array([0.3, 0, 2.5]), np.array([0.45, 0, 2.5]), 0.004, rng, radius=0.055),
            floor(rng),
        ]
    )
    parts = take_apart(points, rng)
    assert len(parts.segments) == 2
    places = {sighting.kind: sighting for sighting in parts.sightings}
    assert np.linalg.norm(places["junction"].position - corner) < 0.01
    assert len(places["junction"].pipes) == 2
    assert np.linalg.norm(places["inline"].position - [0.375, 0, 2.5]) < 0.02
    assert len(parts.sightings) == 2


@pytest.mark.parametrize("level", [True, False])
def test_what_sits_at_the_end_of_one_pipe_is_not_at_the_end_of_another_that_points_past_it(level: bool) -> None:
    """A valve at the end of a level pipe, under the end of an upright one; without the level pipe as when it points away."""
    rng = np.random.default_rng(6)
    valve, half = np.array([0.0, 0.2, 2.5]), np.array([0.045, 0, 0])
    upright = half_pipe(np.array([0.1, -0.7, 2.5]), np.array([0.1, 0.02, 2.5]), 0.004, rng)
    body = half_pipe(valve - half, valve + half, 0.004, rng, radius=0.0605)
    pipe = half_pipe(np.array([-0.7, 0.2, 2.5]), valve - half, 0.004, rng)
    sightings = take_apart(np.vstack([upright, body, pipe] if level else [upright, body]), rng).sightings
    assert [seen.kind for seen in sightings] == ["end"] * level
    assert all(np.linalg.norm(seen.position - valve) < 0.04 for seen in sightings)


def test_nothing_makes_no_parts() -> None:
    rng = np.random.default_rng(0)
    assert take_apart(np.zeros((0, 3)), rng).segments == ()
    assert take_apart(floor(rng), rng).segments == ()
    assert take_apart(rng.normal(size=(3, 3)), rng).sightings == ()


def test_motion_is_undone() -> None:
    """A point at rest, seen 0.2 s late by a sensor that moves right at 0.1 m/s and turns, is where it was."""
    point = np.array([[0.3, 0.2, 2.0]])
    velocity, rate = np.array([0.1, 0.0, 0.0]), np.array([0.0, 0.02, 0.0])
    late = np.array([0.2])
    seen = point - late[:, None] * (velocity + np.cross(rate, point))
    np.testing.assert_allclose(undistorted(seen, late, velocity, rate), point, atol=2e-4)  # what is left is of second order
    np.testing.assert_array_equal(undistorted(seen, None, velocity, rate), seen)


def test_coverage_keeps_what_was_seen_more_than_once() -> None:
    coverage = Coverage()
    for _ in range(5):
        coverage.add(np.arange(-0.3, 0.5, 0.02))
    coverage.add(np.arange(0.5, 0.8, 0.02))
    low, high = coverage.ends()
    assert low == pytest.approx(-0.3, abs=0.03)
    assert high == pytest.approx(0.5, abs=0.03)
    assert Coverage().ends() == (0.0, 0.0)
