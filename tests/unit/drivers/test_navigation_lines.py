"""What the lines and messages of DVL, pressure sensor and AHRS say, and what they do not say."""

from __future__ import annotations

import math
import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.navigation.ahrs import euler_rates, mtdata2_message, parse_mtdata2, parse_vnymr
from drivers.navigation.dvl import parse_wrz, wrz_line
from drivers.navigation.pressure import parse_xdr
from drivers.navigation.sums import crc8, nmea_body, nmea_line

small = st.floats(-3, 3)


def test_the_crc_is_that_of_the_polynomial_07() -> None:
    assert crc8(b"123456789") == 0xF4  # the check value of CRC-8 in every catalogue
    assert crc8(b"") == 0


@settings(max_examples=40, deadline=None)
@given(st.tuples(small, small, small), st.booleans(), st.floats(0.003, 0.5))
def test_a_velocity_comes_back(velocity: tuple[float, float, float], valid: bool, sigma: float) -> None:
    reading = parse_wrz(wrz_line(velocity, valid, sigma, 7).strip(), 2.0)
    assert reading is not None
    assert reading.velocity == pytest.approx(velocity, abs=0.0006)
    assert reading.valid is valid
    assert reading.sigma == pytest.approx(sigma, rel=1e-3)
    assert reading.time_s == 2.0


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 60), st.integers(1, 255))
def test_one_wrong_byte_is_no_velocity(place: int, change: int) -> None:
    line = bytearray(wrz_line((0.1, -0.2, 0.3), True, 0.01, 7).strip())
    place %= len(line) - 3
    line[place] ^= change
    assert parse_wrz(bytes(line), 0.0) is None


@pytest.mark.parametrize("line", [b"", b"wrz", b"wrz*00", b"wrp,1,2,3*aa", b"wrz,a,b,c,y,1,1,1,1,1,1,0*00", b"\xff\xfe*00"])
def test_other_lines_are_no_velocity(line: bytes) -> None:
    assert parse_wrz(line, 0.0) is None


def test_pressure_in_bar_and_pascal() -> None:
    assert parse_xdr(nmea_line(b"YXXDR,P,1.5,B,DEPTH").strip()) == pytest.approx(150000.0)
    assert parse_xdr(nmea_line(b"YXXDR,C,11.2,C,WATER,P,150000,P,DEPTH").strip()) == pytest.approx(150000.0)
    assert parse_xdr(nmea_line(b"YXXDR,C,11.2,C,WATER").strip()) is None
    assert parse_xdr(b"$YXXDR,P,1.5,B,DEPTH*00") is None
    assert parse_xdr(nmea_line(b"YXXDR,P,nan,B,DEPTH").strip()) is None


def test_a_sentence_needs_its_dollar_and_its_sum() -> None:
    assert nmea_body(b"$AB*03") == b"AB"  # 0x41 ^ 0x42
    assert nmea_body(b"AB*03") is None
    assert nmea_body(b"$AB*04") is None
    assert nmea_body(b"$AB*3") is None
    assert nmea_body(b"$AB*zz") is None


def test_vnymr_by_hand() -> None:
    reading = parse_vnymr(nmea_line(b"VNYMR,+090.0,-010.0,+005.0,0,0,0,0,0,-9.8,+0.10,+0.0,+0.0").strip(), 1.0)
    assert reading is not None
    assert reading.angles == pytest.approx((math.radians(5), math.radians(-10), math.radians(90)))
    assert reading.rates == pytest.approx((0.1, 0.0, 0.0))
    assert parse_vnymr(nmea_line(b"VNYPR,1,2,3").strip(), 1.0) is None


def test_turning_about_the_bodys_axes_at_a_roll_of_90_degrees() -> None:
    # lying on its right side, turning about the body's right axis (which points down) is yaw
    assert euler_rates((math.pi / 2, 0.0, 0.0), (0.0, 0.2, 0.0)) == pytest.approx((0.0, 0.0, 0.2))


@settings(max_examples=40, deadline=None)
@given(st.tuples(st.floats(-3, 3), st.floats(-1.2, 1.2), st.floats(-3, 3)), st.tuples(small, small, small))
def test_an_attitude_comes_back_from_the_binary_message(
    angles: tuple[float, float, float], turn: tuple[float, float, float]
) -> None:
    message = mtdata2_message(angles, turn)
    assert sum(message[1:]) % 256 == 0
    reading = parse_mtdata2(message[4:-1], 3.0)
    assert reading is not None
    assert reading.angles == pytest.approx(angles, abs=1e-5)
    assert reading.rates == pytest.approx(euler_rates(angles, turn), abs=1e-4)


def test_enu_angles_are_turned_into_ned() -> None:
    # looking east and 10 degrees nose down: in ENU yaw 0 and pitch +10 (about left), in NED yaw 90 and pitch -10
    data = struct.pack(">HBfff", 0x2030, 12, 3.0, 10.0, 0.0)
    reading = parse_mtdata2(data, 0.0)
    assert reading is not None
    assert reading.angles == pytest.approx((math.radians(3), math.radians(-10), math.radians(90)))
    assert reading.rates is None


def test_a_binary_message_without_angles_or_cut_short_says_nothing() -> None:
    assert parse_mtdata2(struct.pack(">HBI", 0x1060, 4, 5), 0.0) is None
    assert parse_mtdata2(struct.pack(">HBff", 0x2034, 12, 1.0, 2.0), 0.0) is None
