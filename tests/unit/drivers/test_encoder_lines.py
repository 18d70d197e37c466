"""What single lines say: golden lines of the makers, hand-derived ones, torn ones, garbage."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.encoder.lci90 import parse_rd
from drivers.encoder.modbus import Refused, position, question, registers_of
from drivers.encoder.nmea import parse_wlp
from drivers.encoder.numerals import number_and_step
from drivers.encoder.pattern import compiled, parse_line
from drivers.encoder.qsb import Answer, parse_answer
from drivers.encoder.serial_line import LineValue
from drivers.encoder.unwrap import Unwrapper

LOGGED_RD = b"03RD,2022-05-14T16:17:36.502,-0000168,00000000,-00004.8,2839"
WLP = b"$SCWLP,12.3,M,0.5,M*6E"


class TestLci90:
    def test_the_logged_line(self) -> None:
        assert parse_rd(LOGGED_RD) == LineValue(-4.8, "m", 0.1, speed=0.0, tension=-168.0)

    def test_without_its_prefix_the_sum_is_wrong(self) -> None:
        assert parse_rd(LOGGED_RD.removeprefix(b"03")) is None

    def test_a_bare_line(self) -> None:
        # R 82 + D 68 + four commas 176 + 24 zeros 1152, and for four of them 1.25: 49 + 46 + 50 + 53 - 192 = 6; together 1484
        assert parse_rd(b"RD,00000000,00000000,00001.25,1484") == LineValue(1.25, "m", 0.01, speed=0.0, tension=0.0)
        assert parse_rd(b"RD,00000000,00000000,00001.25,1483") is None

    def test_feet(self) -> None:
        value = parse_rd(LOGGED_RD, 0.3048)
        assert value is not None
        assert value.value == pytest.approx(-1.46304)
        assert value.quantum == pytest.approx(0.03048)

    def test_lines_with_one_byte_wrong_are_refused(self) -> None:
        for place in range(len(LOGGED_RD)):
            for byte in (LOGGED_RD[place] ^ 1, ord("9"), ord(" ")):
                line = LOGGED_RD[:place] + bytes([byte]) + LOGGED_RD[place + 1 :]
                if line != LOGGED_RD:
                    assert parse_rd(line) is None, line

    def test_every_torn_line_is_refused(self) -> None:
        for cut in range(len(LOGGED_RD)):
            assert parse_rd(LOGGED_RD[:cut]) is None
            assert cut == 0 or parse_rd(LOGGED_RD[cut:]) is None

    def test_two_lines_run_together_are_refused(self) -> None:
        assert parse_rd(LOGGED_RD[:20] + LOGGED_RD) is None

    @given(st.integers(-99_999, 999_999), st.integers(-9_999_999, 99_999_999))
    def test_what_it_writes_is_what_is_read(self, tenths: int, tension: int) -> None:
        body = f"RD,{tension:08d},00000000,{tenths / 10:08.1f},".encode()
        assert parse_rd(body + b"%04d" % sum(body)) == LineValue(tenths / 10, "m", 0.1, speed=0.0, tension=float(tension))


class TestNmea:
    def test_the_makers_line(self) -> None:
        assert parse_wlp(WLP) == LineValue(12.3, "m", 0.1, speed=0.5)

    def test_another_talker_and_feet(self) -> None:
        # Y^X = 01, ^W = 56, ^L = 1A, ^P = 4A; the two commas cancel; ^1 = 7B, ^0 = 4B, ^F = 0D
        assert parse_wlp(b"$YXWLP,10,F*0d") == LineValue(pytest.approx(3.048), "m", pytest.approx(0.3048))

    def test_lines_with_one_byte_wrong_are_refused(self) -> None:
        for place in range(len(WLP)):
            assert parse_wlp(WLP[:place] + bytes([WLP[place] ^ 2]) + WLP[place + 1 :]) is None

    def test_every_torn_line_is_refused(self) -> None:
        for cut in range(1, len(WLP)):
            assert parse_wlp(WLP[:cut]) is None
            assert parse_wlp(WLP[cut:]) is None

    @pytest.mark.parametrize("body", [b"GPGGA,12.3,M", b"SCWLP", b"SCWLP,12.3", b"SCWLP,,M", b"SCWLP,12.3,K", b"SCWLP,1e3,M"])
    def test_other_sentences_are_refused(self, body: bytes) -> None:
        total = 0
        for byte in body:
            total ^= byte
        assert parse_wlp(b"$%s*%02X" % (body, total)) is None


class TestQsb:
    @pytest.mark.parametrize(
        ("line", "said"),
        [
            (b"r0E000000100000ABCD!", Answer("r", 0x0E, 0x10, 0xABCD)),
            (b"r0EFFFFFFFF!", Answer("r", 0x0E, 0xFFFFFFFF, None)),
            (b"w 03 00000003 00000200 !", Answer("w", 0x03, 3, 0x200)),
            (b"x2200000000!", Answer("x", 0x22, 0, None)),
        ],
    )
    def test_answers(self, line: bytes, said: Answer) -> None:
        assert parse_answer(line) == said

    @pytest.mark.parametrize(
        "line", [b"", b"!", b"r0E00000010", b"0E00000010!", b"r0E0000010!", b"r0E000000100!", b"r0E00000010!!", b"R0E00000010!"]
    )
    def test_no_answers(self, line: bytes) -> None:
        assert parse_answer(line) is None

    def test_every_torn_answer_is_refused(self) -> None:
        line = b"r0E000000100000ABCD!"
        assert all(parse_answer(line[:cut]) is None and parse_answer(line[cut + 1 :]) is None for cut in range(len(line)))


class TestModbus:
    ASKED = bytes.fromhex("01 03 00 00 00 02 C4 0B")
    # 0x00012345 from device 1; the CRC of 01 03 04 00 01 23 45 after Modbus over serial line V1.02, 6.2.2
    ANSWER = bytes.fromhex("01 03 04 00 01 23 45 73 30")

    def test_the_question(self) -> None:
        assert question(1, 0) == self.ASKED

    def test_the_answer(self) -> None:
        assert registers_of(self.ANSWER, self.ASKED) == (0x0001, 0x2345)
        assert position((0x0001, 0x2345), "big") == 0x00012345
        assert position((0x0001, 0x2345), "little") == 0x23450001

    def test_an_echo_and_noise_ahead_of_the_answer(self) -> None:
        assert registers_of(self.ASKED + self.ANSWER, self.ASKED) == (0x0001, 0x2345)
        assert registers_of(b"\xff\x00\x01" + self.ANSWER, self.ASKED) == (0x0001, 0x2345)

    def test_the_answer_of_another_device_or_of_another_size(self) -> None:
        assert registers_of(self.ANSWER, question(2, 0)) is None
        # one register of device 1: 01 03 02 00 05 78 47
        assert registers_of(bytes.fromhex("01 03 02 00 05 78 47"), self.ASKED) is None

    def test_every_torn_or_bent_answer_is_refused(self) -> None:
        assert all(registers_of(self.ANSWER[:cut], self.ASKED) is None for cut in range(len(self.ANSWER)))
        for place in range(len(self.ANSWER)):
            bent = self.ANSWER[:place] + bytes([self.ANSWER[place] ^ 0x10]) + self.ANSWER[place + 1 :]
            assert registers_of(bent, self.ASKED) is None

    def test_a_refusal(self) -> None:
        with pytest.raises(Refused, match="exception 2"):
            registers_of(bytes.fromhex("01 83 02 C0 F1"), self.ASKED)


class TestPattern:
    @pytest.mark.parametrize(
        ("pattern", "line", "said"),
        [
            (r"(?P<distance>\d+\.\d+)", b"DIST: 012.35 M", LineValue(12.35, "m", 0.01)),
            (r"(?P<distance>-?\d+,\d)", b"Strecke -0,5 m", LineValue(-0.5, "m", 0.1)),
            (r"^C(?P<count>[+-]?\d+)$", b"C-000042", LineValue(-42.0)),
            (r"^C(?P<count>[+-]?\d+)$", b"xC-000042", None),
            (r"(?P<count>[\d.]+)", b"1.5", None),
            (r"(?P<distance>\S+)", b"nan", None),
            (r"(?P<distance>\d+)?m", b"m", None),
        ],
    )
    def test_lines(self, pattern: str, line: bytes, said: LineValue | None) -> None:
        assert parse_line(line, compiled(pattern)) == said

    @pytest.mark.parametrize(
        "pattern", ["(", "(?P<x>1)", "", "(?P<count>1)(?P<distance>2)", "(?P<count", "a{99999999999999999999}"]
    )
    def test_patterns_that_are_none_are_refused_with_a_sentence(self, pattern: str) -> None:
        with pytest.raises(ValueError, match=r"^The pattern .*\.$"):
            compiled(pattern)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("-00004.8", (-4.8, 0.1)),
        ("12", (12.0, 1.0)),
        ("+.25", (0.25, 0.01)),
        ("3.", (3.0, 1.0)),
        (" 7,5", (7.5, 0.1)),
        ("", None),
        (".", None),
        ("-", None),
        ("1e5", None),
        ("inf", None),
        ("٣", None),
        ("1.2.3", None),
        ("--1", None),
        ("9" * 400, None),
    ],
)
def test_numbers_as_counters_write_them(text: str, said: tuple[float, float] | None) -> None:
    found = number_and_step(text)
    assert found == (None if said is None else pytest.approx(said))


@given(st.binary(max_size=80))
def test_garbage_never_raises(line: bytes) -> None:
    parse_rd(line)
    parse_wlp(line)
    parse_answer(line)
    registers_of(line, TestModbus.ASKED)
    parse_line(line, compiled(r"(?P<distance>[\d.,+-]+)"))


@given(st.binary(max_size=20), st.binary(max_size=20))
def test_garbage_around_an_answer_never_raises(before: bytes, after: bytes) -> None:
    registers_of(before + TestModbus.ANSWER[:5] + after, TestModbus.ASKED)
    parse_rd(before + LOGGED_RD + after)
    parse_wlp(before + WLP + after)


class TestUnwrapper:
    def test_over_the_edges_of_32_bits(self) -> None:
        unwrapper = Unwrapper()
        assert [unwrapper.add(raw) for raw in (0, 0xFFFFFFFF, 0, 1)] == [0, -1, 0, 1]
        unwrapper = Unwrapper()
        assert [unwrapper.add(raw) for raw in (0x7FFFFFFF, 0x80000000, 0x80000001)] == [2**31 - 1, 2**31, 2**31 + 1]

    @given(st.integers(-(2**31), 2**31 - 1), st.lists(st.integers(-(2**31) + 1, 2**31 - 1), max_size=30))
    def test_it_follows_every_walk_of_less_than_half_its_range(self, start: int, steps: list[int]) -> None:
        unwrapper = Unwrapper()
        value = start
        assert unwrapper.add(value % 2**32) == value
        for step in steps:
            value += step
            assert unwrapper.add(value % 2**32) == value
