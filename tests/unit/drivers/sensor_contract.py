"""What every sensor must do, whatever it reads: the contracts of cameras, grabbers and encoders build on this one.

A rig names its sensor by what it is (``camera``, ``grabber``, ``encoder``); ``sensor`` is the same thing under the common name.
"""

from __future__ import annotations

import threading
import time
from abc import ABC, abstractmethod
from itertools import pairwise
from typing import Any, ClassVar

import numpy as np
import pytest
from numpy.typing import NDArray

from drivers.base import DriverError, FrameTimeout, SensorLost, SensorMissing

READ_S = 8.0
"""Enough for a reading on a busy machine. A test that waits for it has failed."""


class SensorRig(ABC):
    """A sensor, not yet open."""

    @property
    @abstractmethod
    def sensor(self) -> Any: ...

    @abstractmethod
    def close(self) -> None: ...


class Plug(ABC):
    """The hand on a sensor that may fall silent, go away and come back."""

    @abstractmethod
    def fall_silent(self) -> None:
        """Send nothing more, while still plugged in."""

    @abstractmethod
    def unplug(self) -> None: ...

    @abstractmethod
    def plug_in(self) -> None: ...


class TwinPlug(Plug):
    """The plug of a virtual sensor: its injected faults."""

    twin: Any

    def fall_silent(self) -> None:
        self.twin.faults.trigger("never comes")

    def unplug(self) -> None:
        self.twin.faults.trigger("disconnect")

    def plug_in(self) -> None:
        self.twin.faults.trigger("reconnect")


class SensorContract:
    """Subclass with a fixture ``rig`` that gives a SensorRig and closes it afterwards."""

    reads: ClassVar[type]
    """What reading gives."""
    clocks: ClassVar[tuple[str, ...]] = ("number", "monotonic_ns")
    """What grows from reading to reading."""

    def pictures(self, reading: Any) -> list[NDArray[Any]]:
        """The arrays of a reading, none of them empty of light, each its own memory."""
        return []

    def is_sound(self, reading: Any) -> bool:
        return isinstance(reading, self.reads) and all(picture.any() for picture in self.pictures(reading))

    def test_numbers_and_times_grow(self, rig: Any) -> None:
        rig.sensor.open()
        readings = [rig.sensor.read(READ_S) for _ in range(4)]
        for earlier, later in pairwise(readings):
            for clock in self.clocks:
                assert getattr(later, clock) > getattr(earlier, clock), clock
            assert later.monotonic_ns >= earlier.monotonic_ns
        assert abs(time.monotonic_ns() - readings[-1].monotonic_ns) < READ_S * 1e9

    def test_readings_do_not_share_memory(self, rig: Any) -> None:
        rig.sensor.open()
        first = self.pictures(rig.sensor.read(READ_S))
        before = [picture.copy() for picture in first]
        others = [picture for _ in range(3) for picture in self.pictures(rig.sensor.read(READ_S))]
        assert all(np.array_equal(picture, copy) for picture, copy in zip(first, before, strict=True))
        assert not any(np.shares_memory(picture, other) for k, picture in enumerate(first) for other in [*others, *first[:k]])

    def test_every_reading_says_where_it_came_from(self, rig: Any) -> None:
        rig.sensor.open()
        assert getattr(rig.sensor.read(READ_S), "source", "a counter has no file")
        assert rig.sensor.name

    def test_reading_a_closed_sensor_says_so(self, rig: Any) -> None:
        with pytest.raises(SensorLost, match="not open"):
            rig.sensor.read(0.1)
        rig.sensor.open()
        rig.sensor.close()
        with pytest.raises(SensorLost, match="not open"):
            rig.sensor.read(0.1)

    def test_closes_twice_and_opens_again(self, rig: Any) -> None:
        rig.sensor.close()
        for _ in range(3):
            rig.sensor.open()
            assert self.is_sound(rig.sensor.read(READ_S))
            rig.sensor.close()
            rig.sensor.close()

    def test_opening_an_open_sensor_starts_it_anew(self, rig: Any) -> None:
        rig.sensor.open()
        rig.sensor.read(READ_S)
        rig.sensor.open()
        assert self.is_sound(rig.sensor.read(READ_S))

    def test_a_reset_leaves_it_closed_and_fit_to_open(self, rig: Any) -> None:
        rig.sensor.open()
        rig.sensor.read(READ_S)
        rig.sensor.reset()
        with pytest.raises(SensorLost):
            rig.sensor.read(0.1)
        rig.sensor.open()
        assert self.is_sound(rig.sensor.read(READ_S))


class LiveSensorContract(SensorContract):
    """Also for sensors on a plug: ``rig`` is a Plug as well."""

    notices_s: ClassVar[float] = 0.3
    """How long a read that is to notice an unplugged sensor may wait."""
    silence: ClassVar[str] = "no picture"
    """What a time-out says there was none of."""
    gone: ClassVar[tuple[type[DriverError], ...]] = (SensorMissing,)
    """What opening an unplugged sensor again may raise."""

    def test_silence_is_a_timeout_within_its_bound(self, rig: Any) -> None:
        rig.sensor.open()
        rig.sensor.read(READ_S)
        rig.fall_silent()
        with pytest.raises(FrameTimeout, match=self.silence) as caught:
            drain(rig.sensor, 0.3)
        assert str(caught.value).endswith(".")
        started = time.monotonic()
        with pytest.raises(FrameTimeout):
            rig.sensor.read(0.3)
        assert 0.2 < time.monotonic() - started < 2.0

    def test_unplugging_is_noticed_and_survived(self, rig: Any) -> None:
        rig.sensor.open()
        rig.sensor.read(READ_S)
        rig.unplug()
        with pytest.raises(SensorLost) as caught:
            drain(rig.sensor, self.notices_s)
        assert str(caught.value).endswith(".")
        with pytest.raises(SensorLost):  # and stays so until it is opened again
            rig.sensor.read(0.1)
        started = time.monotonic()
        rig.sensor.close()
        with pytest.raises(self.gone):
            rig.sensor.open()
        assert time.monotonic() - started < 10.0
        rig.plug_in()
        rig.sensor.open()
        assert self.is_sound(rig.sensor.read(READ_S))

    def test_a_sensor_that_never_came_is_missing(self, rig: Any) -> None:
        rig.unplug()
        with pytest.raises(SensorMissing) as caught:
            rig.sensor.open()
        assert str(caught.value).endswith(".")


class WakingContract(LiveSensorContract):
    """Also for sensors whose reader may wait for long."""

    def test_closing_wakes_a_reader_that_waits(self, rig: Any) -> None:
        rig.sensor.open()
        rig.sensor.read(READ_S)
        rig.fall_silent()
        found: list[Exception] = []

        def read() -> None:
            try:
                while True:
                    rig.sensor.read(20.0)
            except Exception as error:  # noqa: BLE001 - whatever it is, the test looks at it
                found.append(error)

        thread = threading.Thread(target=read)
        thread.start()
        time.sleep(0.3)
        rig.sensor.close()
        thread.join(5.0)
        assert not thread.is_alive()
        assert isinstance(found[0], DriverError)


def drain(sensor: Any, timeout_s: float) -> None:
    """Read until something is raised: what was under way may still come."""
    for _ in range(300):
        sensor.read(timeout_s)
    pytest.fail("the sensor goes on sending")
