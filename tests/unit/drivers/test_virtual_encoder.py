"""The tether encoder's twin: an encoder like any other, with faults, and a recording."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from drivers.base import EndOfRecording
from drivers.encoder.base import Reading
from drivers.registry import open_encoder, open_grabber
from drivers.virtual.crawler import DriveClock
from drivers.virtual.drive import Drive, Go, Halt, Tether
from drivers.virtual.encoder import VirtualCount, VirtualEncoder
from drivers.virtual.faults import TETHER_FAULTS, Fault, FaultScript
from drivers.virtual.openers import crawler
from drivers.virtual.profile import circular
from drivers.virtual.world import VirtualSewer
from tests.unit.drivers.encoder_contract import LiveEncoderContract, LiveRig, RecordingContract, Rig
from tests.unit.drivers.sensor_contract import TwinPlug

PER_METRE = 1000.0


class HandWheel:
    """A wheel that a hand turns."""

    length_s, quantum = 60.0, 0.0

    def __init__(self) -> None:
        self.metres = 0.0

    def encoder(self, t: float) -> float:
        return self.metres


class Live(TwinPlug, LiveRig):
    def __init__(self) -> None:
        self.wheel = HandWheel()
        self.encoder = self.twin = VirtualEncoder(self.wheel, DriveClock(60.0), per_metre=PER_METRE, hz=100.0)

    def turn_to(self, value: float) -> None:
        self.wheel.metres = value / PER_METRE

    def close(self) -> None:
        self.encoder.close()


class TestLive(LiveEncoderContract):
    @pytest.fixture
    def rig(self) -> Iterator[Live]:
        rig = Live()
        yield rig
        rig.close()


def drive(tether: Tether | None = None) -> Drive:
    return Drive(VirtualSewer(circular(0.3), 20.0), (Go(3.0, 0.3), Halt(2.0), Go(0.0, 0.3)), tether=tether, seed=1)


class Recorded(Rig):
    def __init__(self) -> None:
        self.encoder = VirtualCount(drive())

    def turn_to(self, value: float) -> None:
        raise NotImplementedError

    def close(self) -> None:
        self.encoder.close()


class TestRecording(RecordingContract):
    readings_in_recording = int(drive().length_s * 20)

    @pytest.fixture
    def rig(self) -> Iterator[Recorded]:
        rig = Recorded()
        yield rig
        rig.close()


# --- what it counts ---


def read_all(count: VirtualCount) -> list[Reading]:
    count.open()
    found = []
    while True:
        try:
            found.append(count.read())
        except EndOfRecording:
            return found


def table(readings: list[Reading]) -> tuple[np.ndarray, np.ndarray]:
    return np.array([one.time_s for one in readings]), np.array([one.value for one in readings])


def test_it_counts_what_the_drive_says() -> None:
    there = drive(Tether(scale=1.02, quantum=0.1))
    readings = read_all(VirtualCount(there))
    assert all(one.value == pytest.approx(there.encoder(one.time_s)) for one in readings)
    assert {(one.unit, one.quantum) for one in readings} == {("m", 0.1)}


def test_counts_are_whole() -> None:
    readings = read_all(VirtualCount(drive(Tether(quantum=0.0)), per_metre=2048.5))
    assert all(one.value == round(one.value) for one in readings)
    assert max(one.value for one in readings) == pytest.approx(3.0 * 2048.5, abs=1)
    assert readings[0].unit == "counts"


def test_a_slip_is_way_that_is_never_counted() -> None:
    there = drive(Tether(quantum=0.0))
    time_s, value = table(read_all(VirtualCount(there, FaultScript([Fault("slip", 4.0, 1.0)]))))
    truth = np.array([there.encoder(float(t)) for t in time_s])
    assert np.allclose(value[time_s < 4.0], truth[time_s < 4.0])
    assert np.allclose((truth - value)[time_s > 5.1], 0.3, atol=0.02)
    inside = (time_s > 4.05) & (time_s < 4.95)
    assert np.ptp(value[inside]) == pytest.approx(0, abs=1e-9)
    assert np.ptp(truth[inside]) > 0.2


def test_it_jumps_back_once_and_counts_on() -> None:
    there = drive(Tether(quantum=0.0))
    time_s, value = table(read_all(VirtualCount(there, FaultScript([Fault("jump back", 5.0, 2.0)]))))
    truth = np.array([there.encoder(float(t)) for t in time_s])
    assert np.allclose((truth - value)[time_s >= 5.0], 1.0)


def test_garbage_is_counted_and_leaves_a_gap() -> None:
    count = VirtualCount(drive(), FaultScript([Fault("garbage", 2.0, 0.5)]))
    time_s, _ = table(read_all(count))
    assert count.rejected == 10
    assert np.diff(time_s).max() == pytest.approx(0.55)


def test_an_unplugged_counter_comes_back_with_the_way_that_was_gone() -> None:
    there = drive()
    time_s, value = table(read_all(VirtualCount(there, FaultScript([Fault("disconnect", 3.0, 2.0)]))))
    assert np.diff(time_s).max() == pytest.approx(2.05)
    assert value[time_s >= 5.0][0] == there.encoder(5.0)


def test_a_stalled_reading_tells_an_old_place_at_a_new_time() -> None:
    there = drive(Tether(quantum=0.0))
    time_s, value = table(read_all(VirtualCount(there, FaultScript([Fault("stall")]))))
    assert np.all(np.diff(time_s) > 0)
    late = np.array([there.encoder(float(t)) for t in time_s]) - value
    cruising = (time_s > 2) & (time_s < 9)
    assert (late[cruising] > 0.02).sum() == pytest.approx(7, abs=1)
    assert late[cruising].max() == pytest.approx(0.03, abs=1e-6)


def test_faults_of_a_live_counter() -> None:
    rig = Live()
    rig.encoder.open()
    rig.turn_to(100.0)
    rig.encoder.read()
    rig.twin.faults.trigger("freeze")
    shown = rig.encoder.read().value
    rig.turn_to(900.0)
    assert rig.encoder.read().value == shown
    rig.twin.faults.end()
    assert rig.encoder.read().value == 900.0
    rig.twin.faults.trigger("garbage", for_s=0.2)
    assert rig.encoder.read(2.0).value == 900.0
    assert rig.encoder.rejected > 3
    for name in TETHER_FAULTS:
        rig.twin.faults.trigger(name, for_s=0.01)
    rig.close()


def test_time_can_run_faster_than_it_does() -> None:
    clock = DriveClock(1e6, rate=1000.0)
    assert clock.now_s() == 0.0
    clock.begin()
    encoder = VirtualEncoder(drive(Tether(quantum=0.0)), clock, hz=50.0)
    encoder.open()
    for _ in range(4):
        last = encoder.read()
    assert last.value == 0.0, "it has come back"
    assert clock.now_s() > 20.0
    encoder.close()


def test_grabber_and_encoder_of_the_registry_are_on_one_crawler() -> None:
    grabber, encoder = open_grabber("virtual", seed=3), open_encoder("virtual", seed=3)
    footage, clock = crawler(3)
    assert (grabber._footage, grabber._clock) == (footage, clock)  # type: ignore[attr-defined]
    assert (encoder._counter._wheel, encoder._clock) == (footage.drive, clock)  # type: ignore[attr-defined]
