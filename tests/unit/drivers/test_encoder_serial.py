"""The serial encoders over ptys: each against the contract, and what only one of them can do."""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
import time
from collections.abc import Iterator
from functools import reduce
from operator import xor
from pathlib import Path

import pytest

from drivers.base import BadFrame, FrameTimeout, SensorLost, SensorMissing
from drivers.encoder.base import Encoder
from drivers.encoder.lci90 import Lci90Encoder
from drivers.encoder.modbus import ModbusEncoder, Refused
from drivers.encoder.nmea import NmeaEncoder
from drivers.encoder.pattern import PatternEncoder
from drivers.encoder.qsb import QsbEncoder
from drivers.registry import ENCODERS, open_encoder
from tests.unit.drivers.encoder_contract import READ_S, LiveEncoderContract, LiveRig, _settled
from tests.unit.drivers.wheel_on_a_pty import PtyRig, Wire


def rd_line(value: float) -> bytes:
    head = b"RD,00000012,0000.500,%s," % f"{value:08.1f}".encode()
    return head + b"%04d\r\n" % sum(head)


def wlp_line(value: float) -> bytes:
    body = b"SCWLP,%.1f,M,0.5,M" % value
    return b"$%s*%02X\r\n" % (body, reduce(xor, body))


def count_line(value: float) -> bytes:
    return b"\x02CNT=%d;OK\x03\r\n" % (int(value) % 2**32)


def crc16(data: bytes) -> bytes:
    """Modbus over serial line V1.02, 6.2.2."""
    crc = 0xFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0xA001 if crc & 1 else 0)
    return crc.to_bytes(2, "little")


class QsbRig(PtyRig):
    """A QSB that minds its setup: it counts modulo 500 until it is told otherwise."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder, period_s=0.002)
        self.encoder = QsbEncoder(self.wire.port)
        self.registers = {0x00: 0, 0x03: 1, 0x06: 0, 0x15: 0}
        self.asked: list[bytes] = []

    def answer(self, asked: bytes) -> bytes:
        answers = b""
        for command in asked.split():
            self.asked.append(command)
            letter, register = command[:1], int(command[1:3], 16)
            if letter == b"W":
                self.registers[register] = int(command[3:], 16)
            value = int(self.value)
            modulo = 2**32 if self.registers[0x03] == 3 else 500
            data = value % modulo if register == 0x0E else self.registers[register]
            stamp = b"%08X" % 7 if self.registers[0x15] & 8 else b""
            answers += b"%s%02X%08X%s!\r\n" % (letter.lower(), register, data, stamp)
        return answers


class ModbusRig(PtyRig):
    """Device 1 with its position in registers 0 and 1, the high word first; ``echo`` is a two-wire line."""

    echo = False
    refuses = False

    def __init__(self, folder: Path) -> None:
        super().__init__(folder, period_s=0.002)
        self.encoder = ModbusEncoder(self.wire.port)
        self.asked = b""

    def answer(self, asked: bytes) -> bytes:
        self.asked = asked
        body = b"\x01\x83\x02" if self.refuses else b"\x01\x03\x04" + (int(self.value) % 2**32).to_bytes(4, "big")
        return (asked if self.echo else b"") + body + crc16(body)


def line_rig(folder: Path, kind: str) -> PtyRig:
    lines = {"lci90": rd_line, "nmea": wlp_line, "pattern": count_line}
    rig = PtyRig(folder, lines[kind])
    extra = {"pattern": r"CNT=(?P<count>\d+);"} if kind == "pattern" else {}
    rig.encoder = open_encoder(kind, port=rig.wire.port, **extra)
    return rig


class TestQsb(LiveEncoderContract):
    @pytest.fixture
    def rig(self, tmp_path: Path) -> Iterator[QsbRig]:
        made = QsbRig(tmp_path)
        yield made
        made.close()

    def test_it_is_set_up_and_its_count_is_not_cleared(self, rig: QsbRig) -> None:
        rig.encoder.open()
        rig.encoder.read(READ_S)
        assert rig.asked[:3] == [b"W000", b"W033", b"W15F"]
        assert not any(command.startswith(b"W09") for command in rig.asked)
        assert rig.asked[-1] == b"R0E"

    def test_power_loss_is_told(self, rig: QsbRig) -> None:
        rig.encoder.open()
        assert rig.encoder.notice == ""
        rig.registers[0x06] = 0x02
        rig.encoder.open()
        assert "power" in rig.encoder.notice

    def test_something_else_on_the_port_is_told_at_once(self, rig: QsbRig, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(rig, "answer", lambda asked: b"login: \r\n")
        started = time.monotonic()
        with pytest.raises(SensorLost, match="does not answer like one"):
            rig.encoder.open()
        assert time.monotonic() - started < 3.0
        monkeypatch.setattr(rig, "answer", lambda asked: b"e" + asked[1:3] + b"00000001!\r\n")
        with pytest.raises(SensorLost, match="refused"):
            rig.encoder.open()

    def test_the_rate_is_kept(self, rig: QsbRig) -> None:
        rig.encoder.open()
        rig.encoder.read(READ_S)
        started = time.monotonic()
        for _ in range(10):
            rig.encoder.read(READ_S)
        assert time.monotonic() - started > 0.19


class TestModbus(LiveEncoderContract):
    @pytest.fixture
    def rig(self, tmp_path: Path) -> Iterator[ModbusRig]:
        made = ModbusRig(tmp_path)
        yield made
        made.close()

    def test_it_asks_as_the_makers_write(self, rig: ModbusRig) -> None:
        rig.encoder.open()
        rig.encoder.read(READ_S)
        assert rig.asked == bytes.fromhex("01 03 00 00 00 02 C4 0B")

    def test_a_line_that_echoes(self, rig: ModbusRig) -> None:
        rig.echo = True
        rig.encoder.open()
        rig.turn_to(70_000)
        assert _settled(rig.encoder, 70_000).value == 70_000
        assert rig.encoder.rejected == 0

    def test_a_refusal_is_told(self, rig: ModbusRig) -> None:
        rig.refuses = True
        rig.encoder.open()
        with pytest.raises(Refused, match="exception 2"):
            rig.encoder.read(READ_S)

    def test_a_torn_answer_is_asked_again(self, rig: ModbusRig, monkeypatch: pytest.MonkeyPatch) -> None:
        answers = iter([b"\x01\x03\x04\x00", b"\x01\x03\x04\x00\x00\x00\x07\x00\x00", b""])
        whole = rig.answer
        monkeypatch.setattr(rig, "answer", lambda asked: next(answers, whole(asked)))
        rig.turn_to(7)
        rig.encoder.open()
        assert rig.encoder.read(READ_S).value == 7
        assert rig.encoder.rejected == 2

    @pytest.mark.parametrize("wrong", [{"word_order": "middle"}, {"rate_hz": 0}, {"device_id": 0}, {"address": 65535}])
    def test_impossible_settings_are_refused(self, wrong: dict[str, object]) -> None:
        with pytest.raises(ValueError, match="got"):
            open_encoder("modbus", port="/dev/null", **wrong)


class LineContract(LiveEncoderContract):
    """Encoders that send lines by themselves."""

    kind: str
    line: bytes

    @pytest.fixture
    def rig(self, tmp_path: Path) -> Iterator[PtyRig]:
        made = line_rig(tmp_path, self.kind)
        yield made
        made.close()

    def test_garbage_around_a_line_is_counted_and_passed_over(self, rig: PtyRig) -> None:
        rig.fall_silent()
        rig.encoder.open()
        _empty(rig.encoder)
        rejected = rig.encoder.rejected
        rig.wire.send(b"\x00\xff\x80garbage\r\n\r\n" + self.line)
        assert rig.encoder.read(READ_S).value == 42.0
        assert rig.encoder.rejected == rejected + 1

    def test_nothing_but_garbage_is_a_bad_frame_that_shows_it(self, rig: PtyRig) -> None:
        rig.fall_silent()
        rig.encoder.open()
        _empty(rig.encoder)
        rig.wire.send(b"LOGIN\x00:\r\n")
        with pytest.raises(BadFrame, match=r'"LOGIN\?:".*baud rate\.$'):
            rig.encoder.read(0.3)

    def test_a_line_that_comes_in_parts_is_one_line(self, rig: PtyRig) -> None:
        rig.fall_silent()
        rig.encoder.open()
        _empty(rig.encoder)
        rig.wire.send(self.line[:9])
        with pytest.raises(FrameTimeout):
            rig.encoder.read(0.2)
        rig.wire.send(self.line[9:])
        assert rig.encoder.read(READ_S).value == 42.0

    def test_of_lines_that_piled_up_the_newest_counts(self, rig: PtyRig) -> None:
        rig.fall_silent()
        rig.encoder.open()
        _empty(rig.encoder)
        rig.wire.send(self.line.replace(b"42", b"41") + b"#\r\n" + self.line)
        time.sleep(0.05)
        assert rig.encoder.read(READ_S).value == 42.0
        with pytest.raises(FrameTimeout):
            rig.encoder.read(0.1)

    def test_an_endless_line_does_not_grow_without_end(self, rig: PtyRig) -> None:
        rig.fall_silent()
        rig.encoder.open()
        _empty(rig.encoder)
        for _ in range(4):
            rig.wire.send(b"\xaa" * 1000)
            with pytest.raises(FrameTimeout):
                rig.encoder.read(0.1)
        rig.wire.send(b"\r\n" + self.line)
        assert rig.encoder.read(READ_S).value == 42.0


class TestLci90(LineContract):
    kind = "lci90"
    line = rd_line(42.0)

    def test_of_lines_that_piled_up_the_newest_counts(self, rig: PtyRig) -> None:
        rig.fall_silent()
        rig.encoder.open()
        _empty(rig.encoder)
        rig.wire.send(rd_line(40.9) + rd_line(41.3) + rd_line(42.0))
        time.sleep(0.05)
        assert rig.encoder.read(READ_S).value == 42.0

    def test_tension_and_speed_come_with_it(self, rig: PtyRig) -> None:
        rig.encoder.open()
        reading = rig.encoder.read(READ_S)
        assert (reading.unit, reading.quantum, reading.speed, reading.tension) == ("m", 0.1, 0.5, 12.0)


class TestNmea(LineContract):
    kind = "nmea"
    line = wlp_line(42.0)

    def test_of_lines_that_piled_up_the_newest_counts(self, rig: PtyRig) -> None:
        rig.fall_silent()
        rig.encoder.open()
        _empty(rig.encoder)
        rig.wire.send(wlp_line(40.9) + wlp_line(41.3) + wlp_line(42.0))
        time.sleep(0.05)
        assert rig.encoder.read(READ_S).value == 42.0


class TestPattern(LineContract):
    kind = "pattern"
    line = count_line(42)

    def test_a_count_that_wraps_goes_on(self, rig: PtyRig) -> None:
        rig.turn_to(2**31 - 100)
        rig.encoder.open()
        assert _settled(rig.encoder, 2**31 - 100).value == 2**31 - 100
        rig.turn_to(2**31 + 100)
        assert _settled(rig.encoder, 2**31 + 100).value == 2**31 + 100
        rig.encoder.close()
        rig.encoder.open()
        rig.turn_to(2**31 + 300)
        assert _settled(rig.encoder, 2**31 + 300).value == 2**31 + 300


@pytest.mark.parametrize("make", [QsbRig, ModbusRig])
def test_a_count_that_wraps_goes_on(make: type[PtyRig], tmp_path: Path) -> None:
    rig = make(tmp_path)
    try:
        rig.encoder.open()
        for value in (2**31 - 5, 2**31 + 5, 2**32 - 1, 2**32 + 70, 3 * 2**30, 2**31 - 5, 2**30, 0, -9):
            rig.turn_to(value)
            assert _settled(rig.encoder, value).value == value
    finally:
        rig.close()


@pytest.mark.parametrize("kind", ["qsb", "lci90", "modbus", "nmea"])
def test_only_a_port_that_is_free_is_opened(kind: str, tmp_path: Path) -> None:
    wire = Wire(tmp_path)
    first, second = (Lci90Encoder(wire.port), open_encoder(kind, port=wire.port))
    first.open()
    try:
        with pytest.raises(SensorMissing, match="another program"):
            second.open()
    finally:
        first.close()
        second.close()
        wire.unplug()


def test_a_port_without_permission_names_the_group(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> int:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(os, "open", refuse)
    with pytest.raises(SensorMissing, match="dialout"):
        NmeaEncoder("/dev/ttyUSB0").open()


@pytest.mark.parametrize("port", ["socket://127.0.0.1:1", "nonsense://x", "", "/dev", "/dev/null"])
def test_what_is_no_port_is_missing(port: str) -> None:
    with pytest.raises(SensorMissing) as caught:
        NmeaEncoder(port).open()
    assert str(caught.value).endswith(".")


def test_a_port_may_be_a_socket() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        encoder = NmeaEncoder(f"socket://127.0.0.1:{server.getsockname()[1]}")
        encoder.open()
        peer, _ = server.accept()
        peer.sendall(wlp_line(12.3))
        reading = encoder.read(READ_S)
        assert (reading.value, reading.unit, reading.speed) == (12.3, "m", 0.5)
        peer.close()
        with pytest.raises(SensorLost, match="gone"):
            encoder.read(2.0)
        encoder.close()


class SocatRig(LiveRig):
    """Two ptys joined by socat: ending it is an unplug."""

    def __init__(self, folder: Path) -> None:
        self._ends = [folder / "box", folder / "encoder"]
        self._socat: subprocess.Popen[bytes] | None = None
        self._peer = -1
        self.plug_in()
        self.encoder: Encoder = PatternEncoder(str(self._ends[0]), r"^DIST\s+(?P<distance>-?\d+[.,]\d)\s*m$")

    def plug_in(self) -> None:
        ends = [f"pty,raw,echo=0,link={end}" for end in self._ends]
        self._socat = subprocess.Popen(["socat", *ends], stderr=subprocess.DEVNULL)
        deadline = time.monotonic() + READ_S
        while not all(end.exists() for end in self._ends) and time.monotonic() < deadline:
            time.sleep(0.01)
        self._peer = os.open(self._ends[1], os.O_RDWR | os.O_NOCTTY)

    def send(self, data: bytes) -> None:
        os.write(self._peer, data)

    def turn_to(self, value: float) -> None:
        self.send(f"DIST {value:.1f} m\n".encode())

    def fall_silent(self) -> None: ...

    def unplug(self) -> None:
        if self._socat is not None:
            self._socat.terminate()
            self._socat.wait()
            os.close(self._peer)
        self._socat = None

    def close(self) -> None:
        self.encoder.close()
        self.unplug()


@pytest.mark.skipif(shutil.which("socat") is None, reason="socat is not installed")
def test_over_socat_it_reads_is_unplugged_and_comes_back(tmp_path: Path) -> None:
    rig = SocatRig(tmp_path)
    try:
        rig.encoder.open()
        rig.turn_to(12.3)
        assert rig.encoder.read(READ_S).value == 12.3
        rig.send(b"DIST 12,")
        with pytest.raises(FrameTimeout):
            rig.encoder.read(0.2)
        rig.send(b"4 m\r\n")
        assert rig.encoder.read(READ_S).value == 12.4
        rig.unplug()
        with pytest.raises(SensorLost, match="gone"):
            rig.encoder.read(2.0)
        with pytest.raises(SensorMissing):
            rig.encoder.open()
        rig.plug_in()
        rig.encoder.open()
        rig.turn_to(12.5)
        assert rig.encoder.read(READ_S).value == 12.5
    finally:
        rig.close()


def test_the_registry_knows_its_kinds() -> None:
    with pytest.raises(SensorMissing, match="qsb, lci90, modbus, nmea, pattern, csv"):
        open_encoder("abacus")
    assert isinstance(open_encoder("qsb", port="/dev/null"), QsbEncoder)
    assert {"qsb", "lci90", "modbus", "nmea", "pattern", "csv"} <= set(ENCODERS)


def _empty(encoder: Encoder) -> None:
    """Read what was under way when the wheel fell silent."""
    for _ in range(100):
        try:
            encoder.read(0.1)
        except FrameTimeout:
            return
    pytest.fail("the encoder goes on sending readings")
