"""How the box is: what a machine of fakes says, and when somebody is told of it."""

from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from device.health.machine import MachineReader, beacons
from device.health.readings import Health, Limits, Machine, Power, UsbCamera, concerns, power
from device.prompts import PROMPTS
from tests.unit.device.machine_of_fakes import RADIO, FakeMachine

WELL = Health(
    disk_free_mb=20_000,
    disk_total_mb=32_000,
    clock="rtc",
    machine=Machine(48.3, Power(), 2800, (UsbCamera("Intel RealSense D435", 5000, True),), "up", 2),
)


@pytest.fixture
def machine(tmp_path: Path) -> FakeMachine:
    return FakeMachine(tmp_path)


def test_a_machine_in_good_health_is_read_and_says_nothing(machine: FakeMachine) -> None:
    machine.usb("2-1", "8086", "Intel(R) RealSense(TM) D435", "5000", "0e", "0e")
    machine.usb("1-1.2", "1bcf", "USB2.0 grabber", "480", "0e")
    machine.usb("1-1", "2109", "USB hub", "480", "09")
    read = MachineReader(machine.settings).read()
    assert read == Machine(
        temperature_c=48.312,
        power=Power(),
        memory_free_mb=2867,
        usb=(UsbCamera("USB2.0 grabber", 480.0, False), UsbCamera("Intel(R) RealSense(TM) D435", 5000.0, True)),
        hotspot="up",
        wifi_clients=2,
    )
    assert concerns(replace(WELL, machine=read)) == ()


def test_a_machine_that_says_nothing_is_no_fault(tmp_path: Path) -> None:
    machine = FakeMachine(tmp_path)
    empty = machine.settings.model_copy(update={"root": tmp_path / "nothing"})
    for program in ("vcgencmd", "iw", "nmcli"):
        machine.without(program)
    read = MachineReader(empty).read()
    assert read == Machine()
    assert concerns(replace(WELL, machine=read)) == ()


def test_garbage_from_the_machine_counts_as_nothing(machine: FakeMachine) -> None:
    machine.temperature("hot!")
    machine.write("proc/meminfo", "MemAvailable: lots\n")
    machine.says("vcgencmd", "error=1")
    machine.usb("2-1", "8086", "camera", "fast", "0e")
    read = MachineReader(machine.settings).read()
    assert (read.temperature_c, read.memory_free_mb, read.power, read.usb) == (None, None, None, ())


def test_a_helper_that_hangs_does_not_hold_up_the_reading(machine: FakeMachine, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("device.health.machine._PATIENCE_S", 0.1)
    machine.says("vcgencmd", "throttled=0x0", takes_s=5)
    assert MachineReader(machine.settings).run(machine.settings.vcgencmd, "get_throttled", patience_s=0.1) is None


@pytest.mark.parametrize(
    ("word", "code"),
    [("0x1", "under_voltage"), ("0x10000", "was_under_voltage"), ("0x4", "slowed"), ("0x2", "slowed"), ("0x8", "slowed")],
)
def test_the_firmwares_word_becomes_a_prompt(machine: FakeMachine, word: str, code: str) -> None:
    machine.says("vcgencmd", f"throttled={word}")
    assert concerns(replace(WELL, machine=MachineReader(machine.settings).read())) == (code,)


def test_the_bits_are_where_the_firmware_has_them() -> None:
    assert power(0x50005) == Power(True, False, True, False, True, False, True, False)
    assert power(0xE0008) == Power(False, False, False, True, False, True, True, True)


@given(st.integers(0, 2**32 - 1))
def test_any_word_is_understood(word: int) -> None:
    read = power(word)
    assert read.under_voltage == bool(word & 1)
    assert read.soft_temperature_limit_before == bool(word & 0x80000)


@pytest.mark.parametrize(
    ("health", "code"),
    [
        (replace(WELL, disk_free_mb=999), "disk_low"),
        (replace(WELL, clock="none"), "clock_unset"),
        (replace(WELL, machine=replace(WELL.machine, temperature_c=75.1)), "hot"),
        (replace(WELL, machine=replace(WELL.machine, temperature_c=82.1)), "too_hot"),
        (replace(WELL, machine=replace(WELL.machine, memory_free_mb=149)), "memory_low"),
        (replace(WELL, machine=replace(WELL.machine, hotspot="silent")), "hotspot_silent"),
        (replace(WELL, machine=replace(WELL.machine, usb=(UsbCamera("D435", 480, True),))), "usb_slow"),
    ],
)
def test_each_limit_has_its_prompt(health: Health, code: str) -> None:
    assert concerns(health) == (code,)
    assert PROMPTS[code].remedy.endswith(".")


def test_a_grabber_made_for_usb_2_is_not_slow() -> None:
    assert concerns(replace(WELL, machine=replace(WELL.machine, usb=(UsbCamera("grabber", 480, False),)))) == ()


@given(st.lists(st.floats(60, 95), min_size=2, max_size=60))
def test_a_temperature_at_the_edge_does_not_flicker(readings: list[float]) -> None:
    """Between two changes of the warning there are at least the degrees of the hysteresis."""
    before: frozenset[str] = frozenset()
    changed_at: float | None = None
    for value in readings:
        now = frozenset(concerns(replace(WELL, machine=replace(WELL.machine, temperature_c=value)), before))
        if bool(now) != bool(before):
            if changed_at is not None:
                low, high = sorted((value, changed_at))
                assert low <= Limits().hot_c[1]
                assert high > Limits().hot_c[0]
            changed_at = value
        before = now


def test_every_concern_has_its_words_and_the_weightiest_is_first() -> None:
    bad = Health(
        0, 32_000, "none",
        Machine(90, power(0x80005), 10, (UsbCamera("D435", 480, True),), "silent", 0),
    )  # fmt: skip
    codes = concerns(bad)
    assert codes[0] == "under_voltage"
    assert len(codes) == 7
    assert all(code in PROMPTS for code in codes)


# --- the hotspot ---


@pytest.mark.parametrize(
    ("radio", "sends"),
    [
        (RADIO, True),
        (RADIO.replace("type AP", "type managed"), False),
        (RADIO.replace("\tchannel 6 (2437 MHz), width: 20 MHz, center1: 2437 MHz\n", ""), False),
        (RADIO.replace("\tssid borescout-7f3a\n", ""), False),
        ("", False),
    ],
)
def test_an_access_point_that_sends_has_type_name_and_channel(radio: str, sends: bool) -> None:
    assert beacons(radio) == sends


def test_a_hotspot_whose_process_lives_while_the_radio_is_silent(machine: FakeMachine) -> None:
    reader = MachineReader(machine.settings)
    assert reader.hotspot() == "up"
    machine.says("iw", RADIO.replace("type AP", "type managed"))
    assert reader.hotspot() == "silent"
    machine.says("iw", "command failed: No such device (-19)", fails=True)
    assert reader.hotspot() == "silent"
    machine.says("iw", RADIO)
    machine.write("sys/class/net/wlan0/carrier", "0\n")
    assert reader.hotspot() == "silent"
    machine.write("sys/class/net/wlan0/carrier", "1\n")
    assert reader.hotspot() == "up"
    machine.says("nmcli", "lo:lo")
    assert reader.hotspot() == "off"


def test_a_box_without_a_hotspot_is_not_watched(tmp_path: Path) -> None:
    machine = FakeMachine(tmp_path, hotspot="")
    assert MachineReader(machine.settings).hotspot() == "unknown"
    assert not any(call.startswith("nmcli") for call in machine.calls)
