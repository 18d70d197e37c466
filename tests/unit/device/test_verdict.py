import dataclasses

import numpy as np
import pytest

from device.diameter.result import PipeContext, choose, diameter_result, frame_result, live_summary
from device.diameter.verdict import reasons_to_refuse, shipped
from device.prompts import PROMPTS
from estimators.frame import FrameEstimate, estimate_frame
from estimators.picture import PictureQuality
from estimators.recording import combine
from tests.unit.estimators.analytic_scenes import D435, UNIT_M, cone, cylinder, ellipse, plane, to_depth


def frames_of(z: np.ndarray, count: int = 6, noise: float = 0.006) -> list[FrameEstimate]:
    return [estimate_frame(to_depth(z, noise, seed), D435, UNIT_M, seed) for seed in range(count)]


@pytest.fixture(scope="module")
def good() -> list[FrameEstimate]:
    return frames_of(cylinder(0.1, end_wall=1.2))


@pytest.fixture(scope="module")
def wide() -> list[FrameEstimate]:
    return frames_of(cylinder(0.2, end_wall=1.6))


def test_a_good_recording_is_accepted(good: list[FrameEstimate]) -> None:
    result = diameter_result(good, PipeContext("concrete", 200))
    assert (result["verdict"], result["reasons"], result["prompts"]) == ("accept", [], [])
    assert result["diameter_mm"] == pytest.approx(200, abs=1)
    assert result["interval_mm"][0] < 200 < result["interval_mm"][1]
    assert result["dn"]["name"] == "DN 200"
    assert result["reference"] == {"dn": 200, "agrees": True}
    assert result["frames_used"] == 6


@pytest.mark.parametrize(
    ("scene", "reasons"),
    [
        (np.full((480, 848), np.inf), {"few_points"}),
        (plane((0.0, 0.0, 1.0), 0.8), {"no_pipe", "few_points"}),
        (cone(0.3, 0.2), {"unstable", "no_pipe"}),
        (ellipse(0.23, 0.17), {"shape"}),
    ],
    ids=["blind", "wall", "cone", "ellipse"],
)
def test_what_is_no_pipe_is_refused_with_its_reason(scene: np.ndarray, reasons: set[str]) -> None:
    result = diameter_result(frames_of(scene, 5), PipeContext())
    assert result["verdict"] == "retry"
    assert set(result["reasons"]) & reasons
    assert [prompt["code"] for prompt in result["prompts"]] == result["reasons"]


def test_each_threshold_refuses_by_itself(good: list[FrameEstimate]) -> None:
    thresholds, errors = shipped()
    recording = combine(good, errors)
    assert reasons_to_refuse(recording, thresholds) == ()
    for change, reason in (
        ({"max_radius_std_frames_mm": 0.0}, "unstable"),
        ({"max_taper": 0.0}, "unstable"),
        ({"min_inliers": 1e9}, "few_points"),
        ({"min_coverage_deg": 361.0}, "aim"),
        ({"min_orientation": 1.01}, "aim"),
        ({"max_sway_mm": -1.0}, "motion"),
        ({"max_half_interval_mm": 0.0}, "wide_interval"),
        ({"max_inside": -1.0}, "water"),
        ({"max_out_of_round": -1.0}, "shape"),
    ):
        assert reasons_to_refuse(recording, dataclasses.replace(thresholds, **change)) == (reason,), change


def test_a_moving_box_is_told_to_hold_still() -> None:
    frames = [
        estimate_frame(to_depth(cylinder(0.1, offset=(0.04 * (-1) ** k, 0.0), end_wall=1.2), 0.006), D435, UNIT_M)
        for k in range(6)
    ]
    assert "motion" in diameter_result(frames, PipeContext())["reasons"]


def test_wide_pipes_ask_for_a_second_position(good: list[FrameEstimate], wide: list[FrameEstimate]) -> None:
    ask = PipeContext(position="top", ask_second_position=True)
    assert diameter_result(good, ask)["reasons"] == []
    first = diameter_result(wide, ask)
    assert first["reasons"] == ["second_position"]
    second = diameter_result(wide[:5], dataclasses.replace(ask, position="middle"))
    chosen = choose([first, second])
    assert chosen["verdict"] == "accept"
    assert chosen["radius_std_mm"] == min(first["radius_std_mm"], second["radius_std_mm"])
    assert choose([first])["verdict"] == "retry"


def test_two_positions_that_disagree_settle_nothing(good: list[FrameEstimate], wide: list[FrameEstimate]) -> None:
    one = diameter_result(good, PipeContext(position="top"))
    other = diameter_result(wide, PipeContext(position="middle"))
    chosen = choose([one, other])
    assert chosen["verdict"] == "retry"
    assert chosen["warnings"][-1]["code"] == "positions_disagree"


def test_an_accepted_recording_is_taken_before_a_steadier_refused_one(good: list[FrameEstimate]) -> None:
    accepted = diameter_result(good, PipeContext())
    refused = {**accepted, "verdict": "retry", "reasons": ["aim"], "radius_std_mm": 0.0}
    assert choose([refused, accepted]) is accepted


def test_of_two_cameras_the_one_that_may_err_less_is_taken(good: list[FrameEstimate]) -> None:
    stereo = {**diameter_result(good, PipeContext()), "camera": "stereo"}
    flight = {**diameter_result(good, PipeContext(scale_std=0.02)), "camera": "time of flight", "radius_std_mm": 0.0}
    assert flight["interval_mm"][1] - flight["interval_mm"][0] > 3 * (stereo["interval_mm"][1] - stereo["interval_mm"][0])
    assert choose([flight, stereo]) is stereo


def test_the_map_is_contradicted_aloud(good: list[FrameEstimate]) -> None:
    result = diameter_result(good, PipeContext("concrete", 300))
    assert result["reference"] == {"dn": 300, "agrees": False}
    assert "reference" in [warning["code"] for warning in result["warnings"]]


def test_visual_questions_carry_what_was_measured(good: list[FrameEstimate]) -> None:
    blurred = PictureQuality(0.5, 0.0, 0.0, 0.0, ("blur",))
    questions = {q["code"]: q["measured"] for q in diameter_result(good, PipeContext(), blurred)["questions"]}
    assert questions == {"image_good": False, "cloud_is_pipe": True, "fit_aligned": True}


def test_one_frame_is_a_whole_survey() -> None:
    result = frame_result(to_depth(cylinder(0.1, end_wall=1.2), 0.006), D435, UNIT_M)
    assert result["verdict"] == "accept"
    assert result["radius_std_mm"] > 0


def test_live_summary_grades_and_explains(good: list[FrameEstimate]) -> None:
    live = live_summary(good)
    assert live["level"] == "good"
    assert live["trust"] >= 0.7
    assert live["prompt"] is None
    ring = np.array(live["circle"][0])
    assert np.abs(ring[0] - ring[-1]).max() < 1e-3
    nothing = live_summary(frames_of(np.full((480, 848), np.inf), 2))
    assert (nothing["level"], nothing["trust"], nothing["diameter_mm"]) == ("none", 0.0, None)
    assert nothing["prompt"]["remedy"]
    assert live_summary([])["level"] == "none"


def test_every_reason_has_two_sentences() -> None:
    for prompt in PROMPTS.values():
        for sentence in (prompt.reason, prompt.remedy):
            assert sentence.endswith(".")
            assert sentence.count(". ") == 0
