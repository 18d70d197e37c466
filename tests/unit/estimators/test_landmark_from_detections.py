"""A map from a table of detections."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from estimators.landmarks.from_detections import Rig, Rows, counter_step, map_detections, observations_of
from tests.bench.landmark_scenes import TABLE_II, Detector, Truth, compare, detect, table_rows

RIG = Rig(500.0, 500.0, 360.0, 288.0, 0.3, 720, 576)
CROWN, INVERT, RIGHT = -np.pi / 2, np.pi / 2, 0.0
PIPE = (Truth("connection", 4.0, 4.0, CROWN), Truth("connection", 4.3, 4.3, RIGHT), Truth("deposit", 5.5, 7.5, INVERT))


def rows_of(
    positions: np.ndarray, truths: tuple[Truth, ...] = PIPE, seed: int = 0, step: float = 0.0, **detector: object
) -> Rows:
    seen = detect(RIG, positions, truths, replace(Detector(TABLE_II), **detector), np.random.default_rng(seed))  # type: ignore[arg-type]
    shown = np.round(positions / step) * step if step else positions
    return table_rows(seen, shown, np.arange(len(positions)) / 25)


DRIVE = np.arange(0.0, 9.0, 0.0155)


@pytest.mark.parametrize("law", ["anywhere", "centroid", "middle"])
def test_all_is_found_and_nothing_else_under_the_errors_of_the_paper(law: str) -> None:
    matched, false = compare(PIPE, map_detections(rows_of(DRIVE, law=law), RIG))
    assert false == []
    for found in matched:
        assert found.landmark is not None, found.truth
        assert found.along < (0.1 if found.truth.label == "deposit" else 0.04)
        assert found.around < np.radians(4)
    deposit = matched[2].landmark
    assert deposit is not None
    assert deposit.chainage_from == pytest.approx(5.5, abs=0.15)
    assert deposit.chainage_to == pytest.approx(7.5, abs=0.15)
    assert deposit.belief["deposit"] > 0.99


def test_back_and_forth_over_a_counter_of_decimetres_doubles_nothing() -> None:
    back = np.concatenate([DRIVE[:450], DRIVE[200:450][::-1], DRIVE[200:]])
    landmarks = map_detections(rows_of(back, step=0.1), RIG)
    matched, false = compare(PIPE, landmarks)
    assert false == []
    assert all(m.landmark is not None and m.along < 0.1 for m in matched)
    assert all(landmark.covariance[0, 0] >= 0.025**2 for landmark in landmarks), "which way the counter rounds is not known"


def test_an_empty_pipe_gives_an_empty_map() -> None:
    assert map_detections(rows_of(DRIVE, (), absent_rate=0.3), RIG) == []
    nothing = Rows(
        np.arange(3), np.arange(3) / 25, np.zeros(3), np.full(3, np.nan), np.full(3, np.nan), ["", "", ""], np.full(3, np.nan)
    )
    assert map_detections(nothing, RIG) == []


def test_sigma_covers_the_error() -> None:
    inside = total = 0
    for seed in range(6):
        matched, _ = compare(PIPE[:2], map_detections(rows_of(DRIVE, PIPE[:2], seed=seed), RIG))
        for found in matched:
            if found.landmark is not None:
                total += 1
                inside += found.along < 3 * np.sqrt(found.landmark.covariance[0, 0])
    assert total >= 11
    assert inside >= total - 1


def test_principal_point_per_frame_counts_and_that_of_the_rig_fills_in() -> None:
    rows = rows_of(DRIVE[:4])
    foe = np.full((len(rows.frame), 2), np.nan)
    foe[rows.frame == 1] = (300.0, 200.0)
    observations, _ = observations_of(replace(rows, foe=foe), RIG)
    assert [o.view.centre for o in observations] == [(360.0, 288.0), (300.0, 200.0), (360.0, 288.0), (360.0, 288.0)]


def test_frames_without_detections_are_frames_in_which_the_detector_looked() -> None:
    rows = Rows(
        frame=np.array([7, 7, 9]),
        time_s=np.array([0.28, 0.28, 0.36]),
        chainage=np.array([1.0, 1.0, 1.1]),
        u=np.array([10.0, 20.0, np.nan]),
        v=np.array([30.0, 40.0, np.nan]),
        label=["roots", "deposit", ""],
        score=np.array([0.5, np.nan, np.nan]),
    )
    first, second = observations_of(rows, RIG)[0]
    assert (first.frame, second.frame) == (7, 9)
    assert [(d.u, d.label, d.score) for d in first.detections or ()] == [(10.0, "roots", 0.5), (20.0, "deposit", 1.0)]
    assert second.detections == ()


@pytest.mark.parametrize(
    ("shown", "step"),
    [
        ([0.0, 0.0, 0.1, 0.1, 0.3, 0.2], 0.1),
        ([0.0, 0.05, 0.05, 0.1], 0.05),
        ([0.0, 0.0131, 0.0289, 0.0401, 0.0567], 0.0),
        ([1.0, 1.0, 1.0], 0.0),
    ],
)
def test_step_of_the_counter_is_found_from_what_it_shows(shown: list[float], step: float) -> None:
    assert counter_step(np.array(shown)) == pytest.approx(step, abs=1e-9)


def test_a_table_that_makes_no_sense_is_refused_with_a_sentence() -> None:
    rows = rows_of(DRIVE[:4])
    with pytest.raises(ValueError, match="without a chainage"):
        map_detections(replace(rows, chainage=np.full(len(rows.frame), np.nan)), RIG)
    with pytest.raises(ValueError, match="radius_m of the rig must be a positive number"):
        map_detections(rows, replace(RIG, radius=0.0))
    with pytest.raises(ValueError, match="different lengths"):
        map_detections(replace(rows, u=rows.u[:-1]), RIG)


def test_a_drive_towards_zero_is_mapped_by_what_grows_in_the_picture() -> None:
    rows = rows_of(DRIVE[:310], PIPE[:2])
    falling = replace(rows, chainage=50.0 - rows.chainage)
    found = map_detections(falling, RIG)
    assert [round(one.chainage, 1) for one in found] == [45.7, 46.0]
    assert all(one.chainage > seen.view.position - 5 for one in found for seen in one.sightings)


def test_a_crawler_at_one_speed_is_no_counter_that_steps() -> None:
    assert counter_step(np.arange(200) * 0.0155) == 0.0
    assert counter_step(np.floor(np.arange(200) * 0.0155 / 0.1) * 0.1) == pytest.approx(0.1)


def test_where_the_focus_of_expansion_wanders_unseen_the_map_says_so() -> None:
    rows = rows_of(DRIVE[:310], PIPE[:2])
    turn = rows.frame / 60.0
    wandering = replace(rows, u=rows.u + 30 * np.sin(turn), v=rows.v + 25 * np.cos(1.3 * turn))
    for still, astray in zip(map_detections(rows, RIG), map_detections(wandering, RIG), strict=True):
        assert astray.ends_std[0] > 2 * still.ends_std[0]
        assert abs(astray.chainage - still.chainage) < 2 * astray.ends_std[0]


@pytest.mark.parametrize(
    ("broken", "said"),
    [
        (lambda rows: replace(rows, chainage=rows.chainage + (np.arange(len(rows.frame)) == 300)), "two chainages"),
        (lambda rows: replace(rows, chainage=1000 * rows.chainage), "m/s"),
    ],
)
def test_a_table_that_contradicts_itself_is_refused(broken: Callable[[Rows], Rows], said: str) -> None:
    rows = rows_of(DRIVE)
    assert (rows.frame[299:302] == rows.frame[300]).sum() > 1
    with pytest.raises(ValueError, match=said):
        map_detections(broken(rows), RIG)
