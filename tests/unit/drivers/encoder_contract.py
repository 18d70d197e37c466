"""What every tether encoder must do, subclassed once for each driver. What passes on a twin is what the real one must pass."""

from __future__ import annotations

import time
from abc import abstractmethod

import pytest

from drivers.base import EndOfRecording, SensorLost, SensorMissing
from drivers.encoder.base import Encoder, Reading
from tests.unit.drivers.sensor_contract import READ_S, Plug, SensorContract, SensorRig, WakingContract, drain


class Rig(SensorRig):
    """An encoder and the wheel it counts."""

    encoder: Encoder

    @property
    def sensor(self) -> Encoder:
        return self.encoder

    @abstractmethod
    def turn_to(self, value: float) -> None:
        """Turn the wheel, so that later readings are ``value`` in the encoder's own unit, to within its step."""


class LiveRig(Rig, Plug):
    """An encoder that may fall silent, go away and come back."""


class EncoderContract(SensorContract):
    """Subclass with a fixture ``rig`` that gives a Rig, its encoder not yet open, and closes it afterwards."""

    reads = Reading
    clocks = ("time_s",)
    silence = "no reading"
    gone = (SensorMissing, SensorLost)

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


class LiveEncoderContract(EncoderContract, WakingContract):
    """Also for encoders on a wire: ``rig`` is a LiveRig."""

    def test_unplugged_and_back_it_has_not_lost_count(self, rig: LiveRig) -> None:
        rig.encoder.open()
        rig.turn_to(500.0)
        before = _settled(rig.encoder, 500.0)
        rig.unplug()
        with pytest.raises(SensorLost):
            drain(rig.encoder, 0.3)
        rig.encoder.close()
        rig.plug_in()
        rig.encoder.open()
        assert rig.encoder.read(READ_S).value == pytest.approx(before.value, abs=before.quantum)


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
