"""What every tether encoder must do, subclassed once for each driver. What passes on a twin is what the real one must pass."""

from __future__ import annotations

import threading
import time
from abc import ABC, abstractmethod
from itertools import pairwise

import pytest

from drivers.base import DriverError, EndOfRecording, FrameTimeout, SensorLost, SensorMissing
from drivers.encoder.base import Encoder, Reading

READ_S = 5.0
"""Enough for a reading on a busy machine. A test that waits for it has failed."""


class Rig(ABC):
    """An encoder and the wheel it counts."""

    encoder: Encoder

    @abstractmethod
    def turn_to(self, value: float) -> None:
        """Turn the wheel, so that later readings are ``value`` in the encoder's own unit, to within its step."""

    @abstractmethod
    def close(self) -> None: ...


class LiveRig(Rig):
    """An encoder that may fall silent, go away and come back."""

    @abstractmethod
    def fall_silent(self) -> None:
        """Send nothing more, while still plugged in."""

    @abstractmethod
    def unplug(self) -> None: ...

    @abstractmethod
    def plug_in(self) -> None: ...


class EncoderContract:
    """Subclass with a fixture ``rig`` that gives a Rig, its encoder not yet open, and closes it afterwards."""

    def test_readings_say_where_the_wheel_is(self, rig: Rig) -> None:
        rig.encoder.open()
        for value in (0.0, 250.0, 1000.0, 990.0, -40.0):
            rig.turn_to(value)
            assert _settled(rig.encoder, value).value == pytest.approx(value, abs=1e-6 + rig.encoder.read(READ_S).quantum)

    def test_a_reading_is_whole(self, rig: Rig) -> None:
        rig.encoder.open()
        reading = rig.encoder.read(READ_S)
        assert isinstance(reading.value, float)
        assert reading.unit in ("counts", "m")
        assert reading.quantum > 0
        assert rig.encoder.name

    def test_times_grow_and_are_those_of_the_host(self, rig: Rig) -> None:
        rig.encoder.open()
        readings = [rig.encoder.read(READ_S) for _ in range(4)]
        assert all(later.time_s > earlier.time_s for earlier, later in pairwise(readings))
        assert all(later.monotonic_ns >= earlier.monotonic_ns for earlier, later in pairwise(readings))
        assert abs(time.monotonic_ns() - readings[-1].monotonic_ns) < READ_S * 1e9

    def test_reading_a_closed_encoder_says_so(self, rig: Rig) -> None:
        with pytest.raises(SensorLost, match="not open"):
            rig.encoder.read(0.1)
        rig.encoder.open()
        rig.encoder.close()
        with pytest.raises(SensorLost, match="not open"):
            rig.encoder.read(0.1)

    def test_closes_twice_and_opens_again(self, rig: Rig) -> None:
        rig.encoder.close()
        for _ in range(3):
            rig.encoder.open()
            assert isinstance(rig.encoder.read(READ_S), Reading)
            rig.encoder.close()
            rig.encoder.close()

    def test_opening_an_open_encoder_starts_it_anew(self, rig: Rig) -> None:
        rig.encoder.open()
        rig.encoder.read(READ_S)
        rig.encoder.open()
        assert isinstance(rig.encoder.read(READ_S), Reading)

    def test_a_reset_leaves_it_closed_and_fit_to_open(self, rig: Rig) -> None:
        rig.encoder.open()
        rig.encoder.read(READ_S)
        rig.encoder.reset()
        with pytest.raises(SensorLost):
            rig.encoder.read(0.1)
        rig.encoder.open()
        assert isinstance(rig.encoder.read(READ_S), Reading)


class LiveEncoderContract(EncoderContract):
    """Also for encoders on a wire: ``rig`` is a LiveRig."""

    def test_silence_is_a_timeout_within_its_bound(self, rig: LiveRig) -> None:
        rig.encoder.open()
        rig.encoder.read(READ_S)
        rig.fall_silent()
        with pytest.raises(FrameTimeout, match="no reading"):
            _drain(rig.encoder, 0.3)
        started = time.monotonic()
        with pytest.raises(FrameTimeout):
            rig.encoder.read(0.3)
        assert 0.2 < time.monotonic() - started < 2.0

    def test_unplugging_is_noticed_and_survived(self, rig: LiveRig) -> None:
        rig.encoder.open()
        rig.turn_to(500.0)
        before = _settled(rig.encoder, 500.0)
        rig.unplug()
        with pytest.raises(SensorLost) as caught:
            _drain(rig.encoder, 0.3)
        assert str(caught.value).endswith(".")
        started = time.monotonic()
        rig.encoder.close()
        with pytest.raises((SensorMissing, SensorLost)):
            rig.encoder.open()
        with pytest.raises(SensorLost):
            rig.encoder.read(0.1)
        assert time.monotonic() - started < 10.0
        rig.plug_in()
        rig.encoder.open()
        assert rig.encoder.read(READ_S).value == pytest.approx(before.value, abs=before.quantum)

    def test_an_encoder_that_never_came_is_missing(self, rig: LiveRig) -> None:
        rig.unplug()
        with pytest.raises(SensorMissing) as caught:
            rig.encoder.open()
        assert str(caught.value).endswith(".")

    def test_closing_wakes_a_reader_that_waits(self, rig: LiveRig) -> None:
        rig.encoder.open()
        rig.encoder.read(READ_S)
        rig.fall_silent()
        found: list[Exception] = []

        def read() -> None:
            try:
                while True:
                    rig.encoder.read(20.0)
            except Exception as error:  # noqa: BLE001 - whatever it is, the test looks at it
                found.append(error)

        thread = threading.Thread(target=read)
        thread.start()
        time.sleep(0.3)
        rig.encoder.close()
        thread.join(5.0)
        assert not thread.is_alive()
        assert isinstance(found[0], DriverError)


class RecordingContract(EncoderContract):
    """Also for recordings, whose wheel nobody turns: ``readings_in_recording`` readings, and then the end."""

    readings_in_recording: int

    def test_readings_say_where_the_wheel_is(self, rig: Rig) -> None:
        pytest.skip("nobody turns the wheel of a recording")

    def test_plays_every_reading_once_and_then_ends(self, rig: Rig) -> None:
        rig.encoder.open()
        readings = [rig.encoder.read(READ_S) for _ in range(self.readings_in_recording)]
        assert all(reading.media_s is not None for reading in readings)
        for _ in range(2):
            with pytest.raises(EndOfRecording):
                rig.encoder.read(READ_S)
        rig.encoder.open()
        assert rig.encoder.read(READ_S).value == readings[0].value


def _settled(encoder: Encoder, value: float) -> Reading:
    """The first reading that shows the wheel's new place: older ones may have been under way."""
    deadline = time.monotonic() + READ_S
    reading = encoder.read(READ_S)
    while abs(reading.value - value) > reading.quantum and time.monotonic() < deadline:
        reading = encoder.read(READ_S)
    return reading


def _drain(encoder: Encoder, timeout_s: float) -> None:
    """Read until something is raised: readings that were under way may still come."""
    for _ in range(100):
        encoder.read(timeout_s)
    pytest.fail("the encoder goes on sending readings")
