"""The navigation drivers on a wire: one contract for each, over a pty, with drop-outs and garbage."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from drivers.base import BadFrame, FrameTimeout, SensorLost, SensorMissing
from drivers.navigation.ahrs import VectorNavAhrs, XsensAhrs, mtdata2_message
from drivers.navigation.base import NavigationSensor
from drivers.navigation.dvl import WaterLinkedDvl, wrz_line
from drivers.navigation.pressure import NmeaPressure
from drivers.navigation.readings import Attitude, Depth, NavReading, Velocity
from drivers.navigation.sums import nmea_line
from tests.unit.drivers.wheel_on_a_pty import Wire

READ_S = 5.0


@dataclass
class Rig:
    wire: Wire
    sensor: NavigationSensor
    message: bytes
    says: Callable[[NavReading], bool]


def _velocity(reading: NavReading) -> bool:
    return isinstance(reading, Velocity) and reading.velocity == pytest.approx((0.1, -0.2, 0.03))


def _depth(reading: NavReading) -> bool:
    return isinstance(reading, Depth) and reading.depth == pytest.approx((1.5e5 - 101325) / (998 * 9.80665))


def _attitude(reading: NavReading) -> bool:
    return isinstance(reading, Attitude) and reading.angles == pytest.approx((0.0, 0.0, math.pi / 2), abs=1e-6)


RIGS = {
    "dvl": (WaterLinkedDvl, wrz_line((0.1, -0.2, 0.03), True, 0.01, 1), _velocity),
    "pressure": (NmeaPressure, nmea_line(b"YXXDR,P,1.5,B,DEPTH"), _depth),
    "ahrs text": (VectorNavAhrs, nmea_line(b"VNYMR,90,0,0,0,0,0,0,0,-9.8,0,0,0"), _attitude),
    "ahrs binary": (XsensAhrs, mtdata2_message((0.0, 0.0, math.pi / 2), (0.0, 0.0, 0.0)), _attitude),
}


@pytest.fixture(params=RIGS)
def rig(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Rig]:
    kind, message, says = RIGS[request.param]
    wire = Wire(tmp_path)
    sensor = kind(wire.port)
    yield Rig(wire, sensor, message, says)
    sensor.close()
    wire.unplug()


def test_a_reading_arrives_with_the_hosts_time(rig: Rig) -> None:
    rig.sensor.open()
    rig.wire.send(rig.message)
    reading = rig.sensor.read(READ_S)
    assert rig.says(reading)
    assert abs(time.monotonic() - reading.time_s) < READ_S


def test_a_message_in_pieces_is_whole_in_the_end(rig: Rig) -> None:
    rig.sensor.open()
    half = len(rig.message) // 2
    rig.wire.send(rig.message[:half])
    with pytest.raises(FrameTimeout, match="no reading"):
        rig.sensor.read(0.05)
    rig.wire.send(rig.message[half:])
    assert rig.says(rig.sensor.read(READ_S))


def test_garbage_is_counted_and_passed_over(rig: Rig) -> None:
    rig.sensor.open()
    broken = bytearray(rig.message)
    broken[len(broken) // 2] ^= 0x15
    rig.wire.send(b"\x00\x31garbage\r\n" + bytes(broken) + rig.message)
    assert rig.says(rig.sensor.read(READ_S))
    assert rig.sensor.rejected >= 1


def test_nothing_but_garbage_is_said_to_be_that(rig: Rig) -> None:
    rig.sensor.open()
    rig.wire.send(b"no such thing\r\n" * 3)
    with pytest.raises(BadFrame, match="baud"):
        rig.sensor.read(0.2)


def test_unplugging_is_noticed_and_survived(rig: Rig) -> None:
    rig.sensor.open()
    rig.wire.send(rig.message)
    rig.sensor.read(READ_S)
    rig.wire.unplug()
    with pytest.raises(SensorLost):
        rig.sensor.read(READ_S)
    rig.sensor.close()
    with pytest.raises(SensorMissing):
        rig.sensor.open()
    rig.wire.plug_in()
    rig.sensor.open()
    rig.wire.send(rig.message)
    assert rig.says(rig.sensor.read(READ_S))


def test_a_closed_sensor_says_so_and_closes_twice(rig: Rig) -> None:
    rig.sensor.close()
    with pytest.raises(SensorLost, match="not open"):
        rig.sensor.read(0.1)
    rig.sensor.open()
    rig.sensor.close()
    rig.sensor.close()


def test_closing_wakes_a_reader_that_waits(rig: Rig) -> None:
    rig.sensor.open()
    found: list[BaseException] = []

    def read() -> None:
        try:
            rig.sensor.read(20.0)
        except Exception as error:  # noqa: BLE001 - whatever it is, the test looks at it
            found.append(error)

    thread = threading.Thread(target=read)
    thread.start()
    time.sleep(0.2)
    rig.sensor.close()
    thread.join(READ_S)
    assert not thread.is_alive()
    assert isinstance(found[0], SensorLost)
