"""The position at the time of a frame, against drives whose truth is known."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from estimators.odometry import Odometer, bridge, destep, step_of

Array = NDArray[np.float64]
SEEDS = range(6)


class Drive:
    """A crawler that drives at changing speeds up to 0.25 m/s, halts, turns round, and never runs evenly."""

    def __init__(self, seed: int, seconds: float = 120.0) -> None:
        rng = np.random.default_rng(seed)
        tick = 0.01
        self.times = np.arange(0.0, seconds, tick)
        wanted = np.zeros(len(self.times))
        at = 0
        while at < len(wanted):
            stretch = int(rng.uniform(2.0, 12.0) / tick)
            kind = rng.random()
            wanted[at : at + stretch] = 0.0 if kind < 0.2 else rng.uniform(0.04, 0.25) * (-0.7 if kind < 0.28 else 1.0)
            at += stretch
        self.speeds = np.zeros(len(self.times))
        sway = 0.0
        for k in range(1, len(self.times)):
            sway += -sway * tick / 1.5 + 0.02 * math.sqrt(tick) * rng.standard_normal()
            change = wanted[k] * (1 + 3 * sway) - self.speeds[k - 1]
            self.speeds[k] = self.speeds[k - 1] + np.clip(change, -0.3 * tick, 0.3 * tick)
        self.positions = rng.uniform(-0.05, 0.05) + np.cumsum(self.speeds) * tick
        self._rng = rng

    def truth(self, times: Array) -> Array:
        return np.interp(times, self.times, self.positions)

    def moves(self, times: Array) -> NDArray[np.bool_]:
        return np.abs(np.interp(times, self.times, self.speeds)) > 0.01

    def readings(self, hz: float, quantum: float) -> tuple[Array, Array]:
        times = np.arange(0.1, self.times[-1] - 0.1, 1.0 / hz)
        times = times + self._rng.uniform(-0.05, 0.05, len(times)) / hz
        return times, np.round(self.truth(times) / quantum) * quantum


class TestDestep:
    @pytest.mark.parametrize(("hz", "most", "most_moving"), [(25.0, 0.017, 0.007), (10.0, 0.017, 0.009)])
    def test_a_tenth_of_a_metre_becomes_two_centimetres(self, hz: float, most: float, most_moving: float) -> None:
        errors, sigmas, moving = [], [], []
        for seed in SEEDS:
            drive = Drive(seed)
            times, shown = drive.readings(hz, 0.1)
            positions, std = destep(times, shown)
            errors.append(positions - drive.truth(times))
            sigmas.append(errors[-1] / std)
            moving.append(drive.moves(times))
        error, sigma, moves = np.concatenate(errors), np.concatenate(sigmas), np.concatenate(moving)
        assert np.sqrt(np.mean(error**2)) < most  # the counter's own is 0.1 / sqrt 12 = 0.029
        assert np.sqrt(np.mean(error[moves] ** 2)) < most_moving
        assert abs(np.mean(error)) < 0.004
        # honest: as large as stated, and hardly ever beyond three times it
        assert 0.6 < np.sqrt(np.mean(sigma**2)) < 1.1
        assert np.mean(np.abs(sigma) < 2) > 0.94
        assert np.mean(np.abs(sigma) < 3) > 0.995

    @pytest.mark.parametrize(("quantum", "hz", "most"), [(0.1, 1.0, 0.028), (0.01, 20.0, 0.0026), (0.0005, 50.0, 0.0003)])
    def test_seldom_read_and_fine_counters(self, quantum: float, hz: float, most: float) -> None:
        errors, sigmas = [], []
        for seed in range(4):
            drive = Drive(seed)
            times, shown = drive.readings(hz, quantum)
            positions, std = destep(times, shown, quantum)
            errors.append(positions - drive.truth(times))
            sigmas.append(errors[-1] / std)
        assert np.sqrt(np.mean(np.concatenate(errors) ** 2)) < most
        assert 0.5 < np.sqrt(np.mean(np.concatenate(sigmas) ** 2)) < 1.1

    def test_an_even_drive_is_a_straight_line(self) -> None:
        times = np.arange(0.0, 20.0, 0.04)
        positions, std = destep(times, np.round(0.15 * times / 0.1) * 0.1)
        inner = slice(20, -20)
        assert np.max(np.abs(positions - 0.15 * times)[inner]) < 0.006  # 0.04 s at 0.15 m/s
        assert np.all(std[inner] < 0.007)

    def test_a_halt_stands_in_the_middle_and_says_that_it_does_not_know(self) -> None:
        times = np.arange(0.0, 60.0, 0.05)
        truth = np.where(times < 20, 0.15 * times, np.where(times < 40, 3.0, 3.0 + 0.15 * (times - 40)))
        shown = np.round(truth / 0.1) * 0.1
        positions, std = destep(times, shown)
        standing = (times > 22) & (times < 38)
        assert np.ptp(positions[standing]) < 1e-9
        assert np.allclose(std[standing], 0.1 / math.sqrt(12), atol=2e-3)
        assert np.all(np.diff(positions) > -1e-9)

    def test_a_turn_stays_within_the_step(self) -> None:
        times = np.arange(0.0, 40.0, 0.05)
        truth = 2.0 - np.abs(0.15 * (times - 20.0))
        positions, _ = destep(times, np.round(truth / 0.1) * 0.1)
        assert np.max(np.abs(positions - truth)[20:-20]) < 0.04
        assert abs(times[np.argmax(positions)] - 20.0) < 0.3

    def test_a_counter_that_shows_what_has_been_passed(self) -> None:
        times = np.arange(0.0, 20.0, 0.04)
        positions, _ = destep(times, np.floor(0.15 * times / 0.1 + 1e-9) * 0.1, rounding="down")
        assert np.max(np.abs(positions - 0.15 * times)[20:-20]) < 0.006

    def test_a_jump_is_not_smeared_over_its_neighbours(self) -> None:
        times = np.arange(0.0, 20.0, 0.1)
        truth = 0.15 * times
        shown = np.round(truth / 0.1) * 0.1
        shown[100:] -= 1.2
        positions, _ = destep(times, shown, 0.1)
        shifted = truth - np.where(np.arange(len(times)) >= 100, 1.2, 0.0)
        assert np.max(np.abs(positions - shifted)) < 0.06

    def test_series_of_one_none_and_a_constant(self) -> None:
        assert destep(np.array([]), np.array([]))[0].shape == (0,)
        for values in ([5.0], [5.0, 5.0, 5.0]):
            positions, std = destep(np.arange(float(len(values))), np.array(values), 0.1)
            assert np.allclose(positions, 5.0)
            assert np.allclose(std, 0.1 / math.sqrt(12))

    @pytest.mark.parametrize(
        ("times", "values"),
        [([0.0, 0.0], [1.0, 2.0]), ([0.0, 1.0], [1.0, math.nan]), ([0.0], [1.0, 2.0])],
    )
    def test_what_is_no_series_is_refused(self, times: list[float], values: list[float]) -> None:
        with pytest.raises(ValueError, match="times"):
            destep(np.array(times), np.array(values))

    @given(
        st.lists(st.tuples(st.floats(1e-3, 30.0), st.integers(-3, 3)), min_size=1, max_size=60),
        st.sampled_from([0.1, 0.01, 1.0]),
    )
    def test_whatever_the_counter_does_the_path_stays_within_what_it_shows(
        self, moves: list[tuple[float, int]], quantum: float
    ) -> None:
        times = np.cumsum([wait for wait, _ in moves])
        values = quantum * np.cumsum([steps for _, steps in moves])
        positions, std = destep(times, values, quantum)
        assert np.all(np.abs(positions - values) <= quantum / 2 + 1e-9)
        assert np.all(np.isfinite(std))
        assert np.all(std >= 0)

    def test_the_odometry_of_the_paper(self, data_dir: Path) -> None:
        with (data_dir / "cctv_pipe1" / "sewerPipe_groundTruthAnomaly.csv").open(newline="") as file:
            shown = np.array([float(row["Distance"]) for row in csv.DictReader(file)])
        assert step_of(shown) == pytest.approx(0.1)
        positions, std = destep(np.arange(len(shown)) / 25.0, shown)
        steps = np.diff(positions)
        assert np.all(steps > -1e-9)  # this crawler never drives back
        assert np.max(np.abs(positions - shown)) <= 0.05 + 1e-9
        # smooth: the counter stands in six frames of seven and then leaps by 0.1 m
        driving = slice(2500, 4300)
        assert np.percentile(steps[driving], 99) < 0.04
        assert np.mean(steps[driving] > 1e-4) > 0.95
        assert np.median(std[driving]) < 0.01


class TestStepOf:
    def test_it_is_the_smallest_change(self) -> None:
        assert step_of(np.array([0.0, 0.0, 0.3, 0.2, 0.2])) == pytest.approx(0.1)
        assert step_of(np.array([7.0, 7.0])) == 0.0
        assert step_of(np.array([])) == 0.0


class TestOdometer:
    def run(
        self, drive: Drive, hz: float, quantum: float, delay: float = 0.0, stated: float | None = None
    ) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Errors, errors in standard deviations, and whether it knew that the crawler stood, at 25 frames a second."""
        times, shown = drive.readings(hz, quantum)
        odometer = Odometer(quantum if stated is None else stated)
        errors, sigmas, right = [], [], []
        fed = 0
        for moment in np.arange(4.0, drive.times[-1] - 1.0, 0.04):
            while fed < len(times) and times[fed] <= moment + delay:
                odometer.add(times[fed], shown[fed])
                fed += 1
            found = odometer.at(float(moment))
            errors.append(found.chainage - float(drive.truth(moment)))
            sigmas.append(errors[-1] / found.std)
            right.append(found.standing != bool(drive.moves(moment)))
        return np.array(errors), np.array(sigmas), np.array(right)

    @pytest.mark.parametrize(("hz", "most"), [(25.0, 0.022), (10.0, 0.024)])
    def test_live_it_sees_through_a_tenth_of_a_metre(self, hz: float, most: float) -> None:
        runs = [self.run(Drive(seed), hz, 0.1) for seed in SEEDS]
        error, sigma, right = (np.concatenate(found) for found in zip(*runs, strict=True))
        assert np.sqrt(np.mean(error**2)) < most
        assert abs(np.mean(error)) < 0.006
        assert 0.6 < np.sqrt(np.mean(sigma**2)) < 1.2
        assert np.mean(np.abs(sigma) < 2) > 0.93
        assert np.mean(right) > 0.9

    def test_a_frame_that_waits_for_readings_knows_more(self) -> None:
        live = np.concatenate([self.run(Drive(seed), 10.0, 0.1)[0] for seed in range(4)])
        late = np.concatenate([self.run(Drive(seed), 10.0, 0.1, delay=2.0)[0] for seed in range(4)])
        assert np.sqrt(np.mean(late**2)) < 0.85 * np.sqrt(np.mean(live**2))

    @pytest.mark.parametrize("stated", [0.0005, 0.0])
    def test_a_fine_counter(self, stated: float) -> None:
        runs = [self.run(Drive(seed, 60.0), 50.0, 0.0005, stated=stated) for seed in range(2)]
        error, sigma, right = (np.concatenate(found) for found in zip(*runs, strict=True))
        assert np.sqrt(np.mean(error**2)) < 0.002
        assert np.sqrt(np.mean(sigma**2)) < 1.3
        assert np.mean(right) > 0.97

    def test_it_says_how_fast_and_which_way(self) -> None:
        for speed in (0.15, -0.08):
            odometer = Odometer(0.1)
            for moment in np.arange(0.0, 20.0, 0.05):
                odometer.add(moment, round(speed * moment / 0.1) * 0.1)
            found = odometer.at(20.0)
            assert found.speed == pytest.approx(speed, rel=0.15)
            assert not found.standing
            assert found.chainage == pytest.approx(speed * 20.0, abs=0.02)

    def test_between_two_steps_it_moves_on_but_never_beyond_the_next(self) -> None:
        odometer = Odometer(0.1)
        for moment in np.arange(0.0, 10.0, 0.05):
            odometer.add(moment, round(0.15 * moment / 0.1) * 0.1)
        before = odometer.at(9.9).chainage
        places = []
        for moment in np.arange(10.0, 14.0, 0.05):  # and from here on it stands
            odometer.add(moment, 1.5)
            places.append(odometer.at(float(moment)).chainage)
        assert max(places) < 1.55
        assert before < 1.55
        assert odometer.at(14.0).standing
        assert odometer.at(14.0).chainage == pytest.approx(1.5)
        assert odometer.at(14.0).std == pytest.approx(0.1 / math.sqrt(12), rel=0.1)

    def test_before_the_first_step_it_is_somewhere_in_the_first_value(self) -> None:
        odometer = Odometer(0.1)
        assert not odometer.ready
        with pytest.raises(ValueError, match="no reading"):
            odometer.at(0.0)
        odometer.add(1.0, 7.0)
        found = odometer.at(1.0)
        assert odometer.ready
        assert (found.chainage, found.speed, found.standing) == (7.0, 0.0, True)
        assert found.std == pytest.approx(0.1 / math.sqrt(12))

    def test_an_encoder_that_falls_silent_is_less_and_less_sure(self) -> None:
        odometer = Odometer(0.01)
        for moment in np.arange(0.0, 10.0, 0.05):
            odometer.add(moment, round(0.15 * moment / 0.01) * 0.01)
        stds = [odometer.at(10.0 + late).std for late in (0.0, 0.5, 2.0, 5.0, 20.0)]
        assert stds == sorted(stds)
        assert stds[0] < 0.01
        assert stds[-1] > 2.0
        assert abs(odometer.at(30.0).chainage - 1.5) < 0.5  # and is not carried off for ever

    def test_a_counter_that_jumps_back_is_noted_and_bridged(self) -> None:
        odometer = Odometer(0.1)
        truth = {}
        for moment in np.arange(0.0, 40.0, 0.1):
            position = 0.15 * moment
            truth[moment] = position
            odometer.add(moment, round((position - (0.8 if moment >= 20.0 else 0.0)) / 0.1) * 0.1)
        (jump,) = odometer.jumps
        assert jump[0] == pytest.approx(20.0)
        assert jump[1] == pytest.approx(-0.8, abs=0.11)
        found = odometer.at(39.9)
        assert found.chainage == pytest.approx(0.15 * 39.9, abs=3 * found.std)
        assert found.std > 0.04  # where within its step the counter began anew is not known
        assert odometer.at(15.0).chainage == pytest.approx(2.25, abs=0.03)

    def test_or_followed(self) -> None:
        odometer = Odometer(0.1, bridge=False)
        for moment in np.arange(0.0, 40.0, 0.1):
            odometer.add(moment, round((0.15 * moment - (3.0 if moment >= 20.0 else 0.0)) / 0.1) * 0.1)
        assert len(odometer.jumps) == 1
        assert odometer.at(39.9).chainage == pytest.approx(0.15 * 39.9 - 3.0, abs=0.03)

    def test_one_wrong_reading_changes_nothing_in_the_end(self) -> None:
        odometer = Odometer(0.1)
        for moment in np.arange(0.0, 20.0, 0.1):
            odometer.add(moment, 88.8 if abs(moment - 10.0) < 0.01 else round(0.15 * moment / 0.1) * 0.1)
        assert len(odometer.jumps) == 2
        found = odometer.at(19.9)
        assert found.chainage == pytest.approx(0.15 * 19.9, abs=3 * found.std)
        assert found.chainage == pytest.approx(0.15 * 19.9, abs=0.12)

    def test_a_gap_without_a_jump_is_no_jump(self) -> None:
        odometer = Odometer(0.1)
        for moment in (*np.arange(0.0, 10.0, 0.1), *np.arange(14.0, 20.0, 0.1)):
            odometer.add(moment, round(0.15 * moment / 0.1) * 0.1)
        assert odometer.jumps == []
        middle = odometer.at(12.0)
        assert middle.chainage == pytest.approx(1.8, abs=0.1)
        assert middle.std > 2 * odometer.at(16.0).std

    def test_readings_out_of_order_are_passed_over(self) -> None:
        odometer = Odometer(0.1)
        odometer.add(5.0, 1.0)
        odometer.add(4.0, 9.0)
        odometer.add(5.0, 9.0)
        assert odometer.at(5.0).chainage == 1.0
        assert odometer.jumps == []

    @pytest.mark.parametrize("wrong", [-0.1, math.nan, math.inf])
    def test_an_impossible_step_is_refused(self, wrong: float) -> None:
        with pytest.raises(ValueError, match="step"):
            Odometer(wrong)
        with pytest.raises(ValueError, match="two numbers"):
            Odometer(0.1).add(0.0, math.nan)

    @given(
        st.lists(st.tuples(st.floats(1e-3, 5.0), st.integers(-30, 30), st.floats(-10.0, 10.0)), min_size=1, max_size=40),
        st.sampled_from([0.1, 0.0]),
        st.booleans(),
    )
    def test_whatever_comes_it_answers_with_numbers(
        self, moves: list[tuple[float, int, float]], quantum: float, bridge: bool
    ) -> None:
        odometer = Odometer(quantum, bridge=bridge)
        moment, value = 0.0, 0.0
        for wait, steps, asked in moves:
            moment += wait
            value += 0.1 * steps
            odometer.add(moment, value)
            found = odometer.at(moment + asked)
            assert all(math.isfinite(number) for number in (found.chainage, found.std, found.speed))
            assert found.std >= 0


class TestBridge:
    @pytest.mark.parametrize(("hz", "quantum"), [(25.0, 0.1), (10.0, 0.0), (1.0, 0.1), (1.0, 0.0)])
    def test_a_drive_that_halts_and_turns_has_no_jump(self, hz: float, quantum: float) -> None:
        for seed in SEEDS:
            drive = Drive(seed)
            times, shown = drive.readings(hz, quantum) if quantum else (np.arange(0.1, 119.0, 1 / hz), None)
            shown = drive.truth(times) if shown is None else shown
            same, jumps = bridge(times, shown, quantum)
            assert jumps == ()
            np.testing.assert_array_equal(same, shown)

    @given(
        seed=st.integers(0, 5),
        at=st.floats(0.0, 1.0),
        metres=st.floats(2.0, 60.0) | st.floats(-60.0, -2.0),
        hz=st.sampled_from([25.0, 1.0]),
    )
    def test_a_jump_is_taken_out_wherever_it_is(self, seed: int, at: float, metres: float, hz: float) -> None:
        drive = Drive(seed)
        times, shown = drive.readings(hz, 0.1)
        index = 1 + round(at * (len(times) - 2))
        metres = round(metres, 1)
        whole, (jump,) = bridge(times, shown + np.where(np.arange(len(times)) < index, 0.0, metres), 0.1)
        assert jump.index == index
        # what it drove from one reading to the next is taken for the usual
        assert jump.metres == pytest.approx(metres, abs=0.11 + 0.25 / hz)
        np.testing.assert_array_equal(whole[:index], shown[:index])
        np.testing.assert_allclose(np.diff(whole[index:]), np.diff(shown[index:]), atol=1e-9)
        assert abs(whole[-1] - shown[-1]) < 0.11 + 0.25 / hz

    def test_a_slip_of_the_reading_is_two_jumps_and_leaves_no_trace(self) -> None:
        times, shown = Drive(1).readings(25.0, 0.1)
        slipped = shown.copy()
        slipped[700:705] += 60.0
        whole, jumps = bridge(times, slipped, 0.1)
        assert [jump.index for jump in jumps] == [700, 705]
        np.testing.assert_allclose(whole, shown, atol=0.11)

    def test_few_readings_have_no_jump(self) -> None:
        assert bridge(np.array([0.0, 1.0]), np.array([5.0, 99.0]), 0.1)[1] == ()
