"""The rules by which the box begins and ends surveys by itself, on timetables of what it sees."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from device.autonomy.machine import REASONS, Action, Aiming, Autonomy, Condition, Crawling, Rules, Seen, wants_after
from estimators.pipe_view import pipe_view

STEP_S = 0.5


@dataclass(frozen=True)
class Phase:
    """``seconds`` at ``speed`` (m/s) with this before the camera; None for a picture or a counter that is lost."""

    seconds: float
    speed: float | None = 0.0
    pipe: bool | None = True
    lit: bool | None = True
    condition: Condition = field(default_factory=Condition)
    ended_by_hand: bool = False


NODE = Phase(6.0, 0.15, pipe=False)
DRIVE = Phase(60.0, 0.2)


def run(phases: Sequence[Phase], machine: Autonomy | None = None, start_s: float = 100.0) -> list[tuple[str, float, str]]:
    """(what, when since the start, why) of every action, with a device that does as it is told."""
    machine = machine or Autonomy()
    found: list[Action] = []
    now, way, busy = start_s, 5.0, False
    for phase in phases:
        if phase.ended_by_hand:
            busy = False
        for _ in range(round(phase.seconds / STEP_S)):
            way += (phase.speed or 0.0) * STEP_S
            crawling = Crawling(phase.lit, phase.pipe, None if phase.speed is None else way, busy)
            for action in machine.step(Seen(now, crawling, None, phase.condition)):
                found.append(action)
                busy = {"begin": True, "end": False, "drop": False}.get(action.what, busy)
            now += STEP_S
    assert all(action.reason in REASONS for action in found)
    return [(action.what, action.at_s - start_s, action.reason) for action in found]


def test_a_drive_begins_when_a_pipe_has_been_in_view_and_ends_at_the_node() -> None:
    found = run([NODE, DRIVE, NODE, DRIVE, NODE])
    assert [(what, why) for what, _, why in found] == [("begin", "pipe_seen"), ("end", "node")] * 2
    # each at the moment that it is about (and that most pictures of a second say so), though it is known only later
    assert [at for _, at, _ in found] == [9.0, 67.0, 75.0, 133.0]


def test_a_halt_does_not_split_and_a_standstill_does() -> None:
    assert [what for what, _, _ in run([DRIVE, Phase(80.0), DRIVE])] == ["begin"]
    found = run([DRIVE, Phase(100.0), DRIVE])
    assert [(what, why) for what, _, why in found] == [("begin", "pipe_seen"), ("end", "standstill"), ("begin", "pipe_seen")]
    assert found[1][1] == pytest.approx(60.0, abs=1.0)  # when it stopped
    assert found[2][1] == pytest.approx(163.0, abs=2.0)  # when it moved again, not when the pipe came into view


def test_a_flicker_of_the_lamp_does_not_split_and_darkness_does() -> None:
    dark = Phase(8.0, 0.2, pipe=False, lit=False)
    assert [what for what, _, _ in run([DRIVE, dark, DRIVE])] == ["begin"]
    found = run([DRIVE, replace(dark, seconds=15.0), DRIVE])
    assert found[1] == ("end", 60.0, "darkness")
    assert found[2] == ("begin", 78.0, "pipe_seen")


def test_a_camera_that_looks_aside_at_a_halt_has_not_left_the_pipe() -> None:
    assert [what for what, _, _ in run([DRIVE, Phase(60.0, 0.0, pipe=False), DRIVE])] == ["begin"]


def test_a_crawler_that_turns_back_has_reached_the_end_and_its_way_back_is_no_survey() -> None:
    found = run([DRIVE, Phase(60.0, -0.2), NODE, DRIVE])
    assert [(what, why) for what, _, why in found] == [
        ("begin", "pipe_seen"),
        ("end", "turned_back"),
        ("begin", "pipe_seen"),
    ]
    assert found[1][1] == pytest.approx(60.0, abs=1.0)
    assert found[2][1] == 129.0


def test_a_counter_that_runs_backwards_is_a_direction_like_the_other() -> None:
    assert [what for what, _, _ in run([Phase(60.0, -0.2)])] == ["begin"]


def test_a_little_way_back_is_no_end() -> None:
    assert [what for what, _, _ in run([DRIVE, Phase(5.0, -0.2), DRIVE])] == ["begin"]


def test_nothing_is_begun_in_the_dark_nor_in_the_open() -> None:
    assert run([Phase(100.0, 0.04, pipe=False), Phase(100.0, 0.5, pipe=False, lit=False)]) == []


def test_a_crawler_in_a_pipe_that_the_picture_does_not_show_is_surveyed_by_its_way() -> None:
    found = run([Phase(60.0, 0.2, pipe=False)])
    assert [(what, why) for what, _, why in found] == [("begin", "moved")]


def test_a_crawler_that_never_moved_leaves_no_survey() -> None:
    found = run([Phase(200.0), DRIVE])
    assert [(what, why) for what, _, why in found] == [("begin", "pipe_seen"), ("drop", "standstill"), ("begin", "pipe_seen")]


def test_what_somebody_ends_is_not_begun_again_in_the_same_pipe() -> None:
    found = run([DRIVE, replace(DRIVE, ended_by_hand=True), NODE, DRIVE])
    assert [(what, why) for what, _, why in found] == [("begin", "pipe_seen"), ("end", "ended"), ("begin", "pipe_seen")]


def test_it_stands_aside_while_somebody_drives_by_hand() -> None:
    machine = Autonomy()
    for k in range(100):
        assert machine.step(Seen(k * STEP_S, Crawling(True, True, 0.1 * k, busy=True))) == []
    assert machine.state == "aside"


@pytest.mark.parametrize(
    ("condition", "reason"),
    [(Condition(disk_low=True), "disk"), (Condition(too_hot=True), "heat"), (Condition(voltage_low=True), "voltage")],
)
def test_a_box_in_trouble_ends_cleanly_rests_and_goes_on(condition: Condition, reason: str) -> None:
    found = run([DRIVE, Phase(100.0, 0.2, condition=condition), Phase(100.0, 0.2)])
    assert [(what, why) for what, _, why in found] == [
        ("begin", "pipe_seen"),
        ("held", reason),
        ("end", reason),
        ("released", reason),
        ("begin", "pipe_seen"),
    ]
    rules = Rules()
    late = rules.voltage_s if reason == "voltage" else 0.0
    assert [at for _, at, _ in found[1:]] == pytest.approx([60.0 + late] * 2 + [160.0 + late, 162.0 + late], abs=STEP_S)


def test_a_dip_of_the_voltage_ends_nothing() -> None:
    assert [what for what, _, _ in run([DRIVE, Phase(10.0, 0.2, condition=Condition(voltage_low=True)), DRIVE])] == ["begin"]


def test_a_lost_picture_or_counter_ends_a_drive_after_a_minute() -> None:
    blind = Phase(50.0, 0.2, pipe=None, lit=None)
    assert [what for what, _, _ in run([DRIVE, blind, DRIVE])] == ["begin"]
    for lost in (replace(blind, seconds=70.0), Phase(70.0, None)):
        found = run([DRIVE, lost, DRIVE])
        assert found[1] == ("end", 60.0, "signal_lost")
        assert found[2][0] == "begin"


def test_after_a_power_cut_it_goes_on_where_it_was() -> None:
    assert run([DRIVE], Autonomy(resumes=True))[0][2] == "power_back"
    assert run([NODE, DRIVE], Autonomy(resumes=True))[0][2] == "pipe_seen"  # it came back elsewhere
    # cut while it stood at the end of a drive: it is not begun again before it moves
    assert run([Phase(60.0)], Autonomy(wants=wants_after("standstill"))) == []


def test_a_drive_that_could_not_begin_is_tried_again_and_still_goes_on_where_it_was() -> None:
    machine, begun = Autonomy(resumes=True), list[tuple[float, str]]()
    for k in range(40):
        for action in machine.step(Seen(k * STEP_S, Crawling(True, True, 0.1 * k, busy=False))):
            begun.append((action.at_s, action.reason))
            machine.refused()
    assert len(begun) >= 3
    assert {reason for _, reason in begun} == {"power_back"}


def test_measures_once_for_each_pipe_that_comes_into_view_and_a_few_times_where_refused() -> None:
    def measured(accepted: bool) -> list[float]:
        machine, found, busy_until, now = Autonomy(), [], 0.0, 0.0
        for pipe, seconds in ((False, 5.0), (True, 120.0), (False, 3.0), (True, 30.0), (False, 8.0), (True, 60.0)):
            for _ in range(round(seconds / STEP_S)):
                for action in machine.step(Seen(now, aiming=Aiming(pipe, now < busy_until, accepted))):
                    assert action.what == "measure"
                    found.append(action.at_s)
                    busy_until = now + 8.0
                now += STEP_S
        return found

    assert measured(True) == [7.0, 168.0]
    assert len(measured(False)) == 2 * Rules().tries


@settings(max_examples=60, deadline=None)
@given(
    st.lists(
        st.builds(
            Phase,
            st.floats(1, 120),
            st.sampled_from((None, -0.2, 0.0, 0.2)),
            st.sampled_from((None, True, False)),
            st.sampled_from((None, True, False)),
            st.builds(Condition, st.booleans(), st.booleans(), st.booleans()),
        ),
        max_size=8,
    )
)
def test_whatever_comes_drives_do_not_overlap_and_time_goes_on(phases: list[Phase]) -> None:
    open_since: float | None = None
    for what, at, _ in run(phases):
        if what == "begin":
            assert open_since is None
            open_since = at
        elif what in ("end", "drop"):
            assert open_since is not None
            assert at >= open_since or what == "drop"
            open_since = None


READ_BY_EYE = (
    (59, 13.8),
    (67, 13.8),
    (68, 14.0),
    (93.9, 14.0),
    (94, 0.0),
    (100, 0.3),
    (150, 16.5),
    (243, 50.4),
    (250, 52.5),
    (262, 53.0),
    (280, 53.0),
)
"""Second of the real run, and the counter burned into its picture."""


def test_a_real_run_is_one_drive_from_the_pipe_to_the_manhole(data_dir: Path) -> None:
    """It looks aside at a crack first, drives down the pipe, looks aside at a tap, and comes out into a manhole."""
    seconds, counter = zip(*READ_BY_EYE, strict=True)
    machine, found, busy = Autonomy(), list[Action](), False
    for file in sorted((data_dir / "cctv_run").rglob("*.jpg"), key=lambda path: int(path.stem)):
        now = int(file.stem) / 1000
        gray = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE)
        assert gray is not None
        view = pipe_view(np.asarray(gray, np.uint8))
        way = float(np.interp(now, seconds, counter))
        for action in machine.step(Seen(now, Crawling(view.lit, view.pipe, way, busy))):
            found.append(action)
            busy = action.what == "begin"
    assert [(action.what, action.reason) for action in found] == [("begin", "pipe_seen"), ("end", "node")]
    assert found[0].at_s == pytest.approx(98, abs=3)
    assert found[1].at_s == pytest.approx(249, abs=5)


def test_switching_off_ends_a_drive_cleanly() -> None:
    machine = Autonomy()
    assert machine.switch_off(1.0) == []
    run([DRIVE], machine)
    assert [action.what for action in machine.switch_off(200.0)] == ["end"]
