"""The crawler's way, its camera and its tether, against what can be worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.virtual.camera import CctvCamera, on_wall
from drivers.virtual.drive import Drive, Go, Halt, Jump, Slip, Tether, Wander, straight_drive
from drivers.virtual.profile import circular
from drivers.virtual.rig import Pose
from drivers.virtual.world import VirtualSewer

SEWER = VirtualSewer(circular(0.3), 30.0)
STILL = Wander(centre_px=0.0, jitter_px=0.0, roll=0.0, offset=0.0, down=0.0)


def drive(*legs: Go | Halt, **more: object) -> Drive:
    return Drive(SEWER, legs, **more)  # type: ignore[arg-type]


# --- the way ---


def test_a_leg_takes_the_time_of_a_trapezium() -> None:
    # 0.25 m/s2 to 0.2 m/s: 0.8 s and 0.08 m at either end, the other 1.84 m at 0.2 m/s
    there = drive(Go(2.0, 0.2))
    assert there.length_s == pytest.approx(0.8 + 1.84 / 0.2 + 0.8)
    assert there.position(0.8) == pytest.approx(0.08)
    assert there.velocity(5.0) == pytest.approx(0.2)
    assert there.position(there.length_s) == pytest.approx(2.0)
    assert there.position(99.0) == pytest.approx(2.0), "after its end it stands there"


def test_a_short_leg_never_reaches_its_speed() -> None:
    assert drive(Go(0.01, 0.3)).length_s == pytest.approx(2 * np.sqrt(0.01 / 0.25))


@given(st.lists(st.tuples(st.floats(0, 20), st.floats(0.05, 0.3), st.floats(0, 5)), min_size=1, max_size=5))
@settings(max_examples=30, deadline=None)
def test_the_way_has_no_jolt_and_its_length_adds_up(legs: list[tuple[float, float, float]]) -> None:
    plan = [step for to, speed, rest in legs for step in (Go(to, speed), Halt(rest))]
    there = drive(*plan)
    t = np.linspace(0, there.length_s, 4000)
    step = t[1] - t[0]
    assert np.all(np.abs(np.diff(there.position(t))) <= 0.3 * step + 1e-9)
    assert np.all(np.abs(np.diff(there.velocity(t))) <= 0.25 * step + 1e-9)
    places = [0.0, *(to for to, _, _ in legs)]
    assert there.way_m == pytest.approx(np.abs(np.diff(places)).sum())


# --- the camera ---


@pytest.mark.parametrize("seed", range(4))
def test_the_axis_is_as_far_from_the_middle_as_in_table_one(seed: int) -> None:
    there = straight_drive(seed)
    middle = ((there.camera.width - 1) / 2, (there.camera.height - 1) / 2)
    moving = [t for t in np.linspace(0, there.length_s, 600) if abs(there.velocity(t)) > 0.05]
    far = [np.hypot(*np.subtract(there.truth.focus_of_expansion(t), middle)) for t in moving]
    assert np.mean(far) == pytest.approx(32.74, abs=4.0)


def test_the_picture_stands_when_the_crawler_does() -> None:
    there = drive(Go(1.0), Halt(3.0), Go(2.0), seed=4)
    stands = [t for t in np.arange(0, there.length_s, 0.1) if there.velocity(t) == 0 and 2 < t < 10]
    assert len(stands) > 20
    assert len({there.pose(t) for t in stands[:10]}) == 1
    assert there.pose(1.0) != there.pose(2.0)


def test_the_drift_is_slow() -> None:
    there = straight_drive(2)
    centres = np.array([there.truth.focus_of_expansion(t) for t in np.arange(0, there.length_s, 0.04)])
    assert np.abs(np.diff(centres, axis=0)).max() < 1.0, "px from one picture to the next"


def test_a_camera_that_looks_to_the_right_sees_the_axis_at_its_left() -> None:
    u, v = CctvCamera().vanishing_point(Pose(yaw=0.1))
    assert (u, v) == pytest.approx((359.5 - 431.25 * np.tan(0.1), 287.5))
    assert CctvCamera().vanishing_point(Pose(pitch=0.1))[1] == pytest.approx(287.5 - 460 * np.tan(0.1))


def test_the_view_projects_as_the_paper_does() -> None:
    # eq. 5 with the camera off the axis is exact for a camera that looks along it
    there = drive(Go(2.0), wander=Wander(0.0, 0.0, 0.0, 0.1, 0.1), seed=3)
    view, camera = there.truth.view(6.0), there.camera
    states = np.array([[view.position + 0.5, 0.3], [view.position + 2.0, -2.0]])
    seen = camera.project(there.pose(6.0), on_wall(0.15, states[:, 0], states[:, 1]))
    depth = states[:, 0] - view.position
    u = view.centre[0] + camera.fx * (view.axis[0] + 0.15 * np.cos(states[:, 1])) / depth
    v = view.centre[1] + camera.fy * (view.axis[1] + 0.15 * np.sin(states[:, 1])) / depth
    assert np.allclose(seen, np.stack([u, v], axis=1), atol=1e-6)


def test_a_looping_drive_comes_back_to_where_it_began() -> None:
    there = drive(Go(5.0), Go(0.0), seed=5)
    begin, end = there.pose(0.0), there.pose(there.length_s)
    assert np.allclose(begin.position, end.position, atol=1e-9)
    assert np.allclose(begin.rotation, end.rotation, atol=1e-9)


def test_seeds_settle_everything() -> None:
    assert straight_drive(7).pose(33.3) == straight_drive(7).pose(33.3) != straight_drive(8).pose(33.3)


# --- the tether ---


def test_the_counter_shows_whole_steps() -> None:
    there = drive(Go(2.0, 0.2), wander=STILL)
    shown = {round(there.encoder(t), 6) for t in np.arange(0, there.length_s + 1, 0.05)}
    assert shown == {round(0.1 * k, 6) for k in range(21)}


def test_scale_slip_and_jump_add_up() -> None:
    tether = Tether(1.02, (Slip(10.0, 0.3),), (Jump(40.0, 1.5),), quantum=0.0)
    there = drive(Go(10.0, 0.2), tether=tether)
    assert there.encoder(9.0) == pytest.approx(1.02 * there.position(9.0))
    assert there.encoder(10.7) == pytest.approx(there.encoder(10.0)), "the counter stands"
    assert there.position(10.7) > there.position(10.0) + 0.1, "while the crawler drives"
    assert there.encoder(30.0) == pytest.approx(1.02 * (there.position(30.0) - 0.3))
    assert there.encoder(39.99) - there.encoder(40.0) == pytest.approx(1.5, abs=0.01)
    assert there.encoder(there.length_s) == pytest.approx(1.02 * 9.7 - 1.5)


def test_a_slip_on_the_way_back_misses_the_way_back() -> None:
    there = drive(Go(3.0, 0.3), Go(0.0, 0.3), tether=Tether(slips=(Slip(15.0, 0.3),), quantum=0.0))
    assert there.velocity(15.0) < 0
    assert there.encoder(there.length_s) == pytest.approx(0.3)


def test_a_pull_counts_while_the_crawler_stands() -> None:
    there = drive(Go(1.0, 0.2), Halt(10.0), tether=Tether(slips=(Slip(8.0, -0.4),), quantum=0.0))
    assert there.encoder(7.9) == pytest.approx(1.0)
    assert there.encoder(12.0) == pytest.approx(1.4)
    assert there.position(12.0) == pytest.approx(1.0)
