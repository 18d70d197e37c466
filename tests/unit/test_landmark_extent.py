"""How far a long thing reaches, under each law of what a detector makes of it."""

import numpy as np
import pytest

from estimators.landmarks.extent import Patches, depth_std, fit_extent, grow, turn_towards, wall_patches
from estimators.landmarks.projection import PipeCamera, View, project
from estimators.landmarks.tracks import Tracks

CAMERA = PipeCamera(500.0, 500.0, 0.3, 720, 576)
CENTRE = (360.0, 288.0)
NEAR, FAR, STD = 150 / 288, 3.0, 15 / 150


def sightings(law: str, low: float, high: float, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    positions = np.arange(0.0, high + 1.0, 0.0155)
    first, last = np.maximum(low - positions, NEAR), np.minimum(high - positions, FAR)
    shows = last >= first
    positions, first, last = positions[shows], first[shows], last[shows]
    if law == "anywhere":
        inverse = 1 / rng.uniform(first, last)
    elif law == "middle":
        inverse = 2 / (first + last)
    elif law == "outline":
        inverse = (1 / first + 1 / last) / 2
    else:  # the mean of 1/Z over a patch whose picture is 1/Z^3 dense
        inverse = np.empty(len(first))
        for k, (a, b) in enumerate(zip(first, last, strict=True)):
            depth = np.linspace(a, b, 200)
            inverse[k] = np.average(1 / depth, weights=depth**-3)
    return positions, inverse + rng.normal(0, STD, len(inverse))


@pytest.mark.parametrize("law", ["anywhere", "middle", "centroid", "outline"])
@pytest.mark.parametrize(("low", "high"), [(4.0, 7.2), (5.0, 5.8), (4.0, 9.0)])
def test_both_ends_are_found_whatever_the_detector_does(law: str, low: float, high: float) -> None:
    rng = np.random.default_rng(1)
    positions, inverse = sightings(law, low, high, rng)
    seen = rng.random(len(positions)) < 0.75
    before = np.arange(0.0, positions[0], 0.0155)
    after = np.arange(positions[-1] + 0.0155, positions[-1] + 2, 0.0155)
    unseen = np.concatenate([before, positions[~seen], after])
    found = fit_extent(positions[seen], inverse[seen], np.full(seen.sum(), STD), unseen, (NEAR, FAR))
    assert found.low == pytest.approx(low, abs=0.12)
    assert found.high == pytest.approx(high, abs=0.08)
    assert 0 < found.std < 0.1


def test_a_point_is_a_point() -> None:
    rng = np.random.default_rng(2)
    positions = np.arange(2.0, 4.48, 0.0155)
    inverse = 1 / (5.0 - positions) + rng.normal(0, STD, len(positions))
    found = fit_extent(positions, inverse, np.full(len(positions), STD), np.zeros(0), (NEAR, FAR))
    assert found.high - found.low < 0.12
    assert (found.low + found.high) / 2 == pytest.approx(5.0, abs=0.03)


def test_stray_sightings_do_not_stretch_it() -> None:
    rng = np.random.default_rng(3)
    positions, inverse = sightings("anywhere", 4.0, 6.0, rng)
    stray = rng.uniform(0, 6.0, 20)
    positions, inverse = np.concatenate([positions, stray]), np.concatenate([inverse, rng.uniform(0.4, 1.9, 20)])
    found = fit_extent(positions, inverse, np.full(len(positions), STD), np.zeros(0), (NEAR, FAR))
    assert found.low == pytest.approx(4.0, abs=0.15)
    assert found.high == pytest.approx(6.0, abs=0.1)


def test_an_end_grows_slowly_towards_near_sightings_and_not_to_far_ones() -> None:
    tracks = Tracks(state=np.array([[1.0, 0.0]]), below=np.zeros(1), above=np.zeros(1))
    rows, beyond = np.array([0]), np.array([1.3])
    grow(CAMERA, View(-1.7, CENTRE), tracks, rows, beyond, 15.0)
    assert 0.0 < tracks.above[0] < 0.01
    for _ in range(30):
        grow(CAMERA, View(0.6, CENTRE), tracks, rows, beyond, 15.0)
        grow(CAMERA, View(0.6, CENTRE), tracks, rows, np.array([np.nan]), 15.0)
    assert tracks.above[0] == pytest.approx(0.3, abs=0.01)
    assert tracks.below[0] == 0.0


def test_depth_is_known_worse_with_its_square() -> None:
    np.testing.assert_allclose(depth_std(CAMERA, np.array([1.0, 3.0]), 15.0), [0.1, 0.9])


def test_an_outline_covers_the_patch_of_wall_it_was_drawn_round() -> None:
    view = View(1.0, CENTRE, (0.02, -0.03))
    corners = np.array([[1.8, 3.0], [2.4, 3.0], [2.4, 3.6], [1.8, 3.6]])  # across the seam of the angle at pi
    others = np.array([[3.0, 0.1], [3.2, 0.3]])
    about = project(CAMERA, view, np.array([[2.0, 3.3], [3.1, 0.2]]))
    outlines = [[(float(u), float(v)) for u, v in project(CAMERA, view, points)] for points in (corners, others)]
    outlines[0].append((CENTRE[0] + 0.5, CENTRE[1]))  # next to the focus of expansion: nowhere
    found = wall_patches(CAMERA, view, outlines, about)
    np.testing.assert_allclose(found.low, [1.8, 3.0])
    np.testing.assert_allclose(found.high, [2.4, 3.2])
    np.testing.assert_allclose(found.before, [-0.3, -0.1])
    np.testing.assert_allclose(found.after, [0.3, 0.1])
    lost = wall_patches(CAMERA, view, [[(CENTRE[0] + 0.5, CENTRE[1])]], about[:1])
    assert np.isnan([lost.low[0], lost.before[0]]).all()


def test_extent_round_the_pipe_starts_at_the_first_outline_and_follows_the_others() -> None:
    tracks = Tracks(state=np.zeros((1, 2)), before=np.zeros(1), after=np.zeros(1))
    rows = np.array([0])
    none = np.array([np.nan])
    turn_towards(tracks, rows, Patches(none, none, np.array([-0.4]), np.array([0.6])))
    assert (tracks.before[0], tracks.after[0]) == (-0.4, 0.6)
    turn_towards(tracks, rows, Patches(none, none, none, none))
    assert (tracks.before[0], tracks.after[0]) == (-0.4, 0.6)
    for _ in range(60):
        turn_towards(tracks, rows, Patches(none, none, np.array([-0.2]), np.array([0.8])))
    assert (tracks.before[0], tracks.after[0]) == (pytest.approx(-0.2, abs=1e-3), pytest.approx(0.8, abs=1e-3))
