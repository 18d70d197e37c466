"""How far a long thing reaches, under each law of what a detector makes of it."""

import numpy as np
import pytest

from estimators.landmarks.extent import Patches, depth_std, grow, turn_towards, wall_patches
from estimators.landmarks.projection import PipeCamera, View, project
from estimators.landmarks.refine.centroids import Centroids, Window, fit_centroids
from estimators.landmarks.refine.edges import Edges, fit_edges
from estimators.landmarks.tracks import Tracks

CAMERA = PipeCamera(500.0, 500.0, 0.3, 720, 576)
CENTRE = (360.0, 288.0)
NEAR, FAR, STD = 150 / 288, 3.0, 15 / 150


def sightings(law: str, low: float, high: float, rng: np.random.Generator, near: float = NEAR) -> tuple[np.ndarray, np.ndarray]:
    positions = np.arange(0.0, high + 1.0, 0.0155)
    first, last = np.maximum(low - positions, near), np.minimum(high - positions, FAR)
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
    found = fit_centroids(Centroids(positions[seen], inverse[seen], np.full(seen.sum(), STD), unseen), Window(NEAR, FAR, 0.1))
    assert found.low == pytest.approx(low, abs=0.12)
    assert found.high == pytest.approx(high, abs=0.08)
    assert (np.sqrt(np.diag(found.covariance)) > 0.002).all()
    assert (np.sqrt(np.diag(found.covariance)) < 0.15).all()


@pytest.mark.parametrize("known", [True, False])
def test_a_detector_that_ceases_to_see_before_the_picture_ends_moves_no_end(known: bool) -> None:
    # it loses things 0.9 m ahead, though they would leave the picture at 0.52 m
    positions, inverse = sightings("centroid", 4.0, 6.0, np.random.default_rng(1), near=0.9)
    window = Window(0.9, FAR, 0.1) if known else Window(NEAR, FAR, 0.5)
    found = fit_centroids(Centroids(positions, inverse, np.full(len(positions), STD), np.zeros(0)), window)
    assert found.low == pytest.approx(4.0, abs=0.12)
    assert found.high == pytest.approx(6.0, abs=0.12)


def outlines(low: float, high: float, near: float, out: float, rng: np.random.Generator) -> Edges:
    """What outlines show that stand out by ``out`` (1/m), and are off as a whole by STD, of a thing seen from ``near`` on."""
    positions = np.arange(0.0, high + 1.0, 0.0155)
    first, last = np.maximum(low - positions, near), np.minimum(high - positions, FAR)
    shows = last >= first
    off = rng.normal(0, STD, shows.sum())
    return Edges(positions[shows], 1 / first[shows] + out + off, 1 / last[shows] - out + off, np.full(shows.sum(), STD))


@pytest.mark.parametrize("near", [NEAR, 0.9])
@pytest.mark.parametrize("out", [0.0, 0.08])
def test_outlines_tell_both_ends_wherever_they_are_cut_and_however_they_stand_out(near: float, out: float) -> None:
    errors, stds = [], []
    for seed in range(6):
        found = fit_edges(outlines(4.0, 5.5, near, out, np.random.default_rng(seed)), (0.7, FAR), 0.05, 0.03)
        errors.append([found.low - 4.0, found.high - 5.5])
        stds.append(np.sqrt(np.diag(found.covariance)))
    assert np.abs(errors).max() < 0.1
    assert np.abs(np.mean(errors, axis=0)).max() < 0.05
    # six runs say no more of a standard deviation than its size
    assert 0.2 < np.sqrt(np.mean(np.square(errors) / np.square(stds))) < 2.0


def test_an_end_that_was_never_seen_is_not_known() -> None:
    edges = outlines(4.0, 9.0, NEAR, 0.0, np.random.default_rng(2))
    begun = edges.positions < 4.0
    begun = Edges(edges.positions[begun], edges.near[begun], edges.far[begun], edges.std[begun])
    found = fit_edges(begun, (NEAR, FAR), 0.05, 0.03)
    low, high = np.sqrt(np.diag(found.covariance))
    assert found.low == pytest.approx(4.0, abs=0.1)
    assert low < 0.1
    assert high > 0.3


def test_a_point_is_a_point() -> None:
    rng = np.random.default_rng(2)
    positions = np.arange(2.0, 4.48, 0.0155)
    inverse = 1 / (5.0 - positions) + rng.normal(0, STD, len(positions))
    found = fit_centroids(Centroids(positions, inverse, np.full(len(positions), STD), np.zeros(0)), Window(NEAR, FAR, 0.1))
    assert found.high - found.low < 0.12
    assert (found.low + found.high) / 2 == pytest.approx(5.0, abs=0.03)


def test_stray_sightings_do_not_stretch_it() -> None:
    rng = np.random.default_rng(3)
    positions, inverse = sightings("anywhere", 4.0, 6.0, rng)
    stray = rng.uniform(0, 6.0, 20)
    positions, inverse = np.concatenate([positions, stray]), np.concatenate([inverse, rng.uniform(0.4, 1.9, 20)])
    found = fit_centroids(Centroids(positions, inverse, np.full(len(positions), STD), np.zeros(0)), Window(NEAR, FAR, 0.1))
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
