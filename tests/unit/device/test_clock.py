from pathlib import Path

import pytest

from device.clock import Clock, iso
from device.errors import Invalid

MAY_2026_MS = 1_777_600_000_000


class Machine:
    """A computer whose clocks a test sets."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self.monotonic_ns = 5_000_000_000
        self.system_ms = 0
        self.clock = Clock(root, lambda: self.monotonic_ns, lambda: self.system_ms)

    def battery_clock(self, seconds: str) -> None:
        folder = self.root / "sys/class/rtc/rtc0"
        folder.mkdir(parents=True)
        (folder / "since_epoch").write_text(seconds)

    def network_time(self) -> None:
        (self.root / "run/systemd/timesync").mkdir(parents=True)
        (self.root / "run/systemd/timesync/synchronized").touch()


@pytest.fixture
def machine(tmp_path: Path) -> Machine:
    return Machine(tmp_path)


def test_without_any_source_the_date_is_unknown(machine: Machine) -> None:
    machine.system_ms = MAY_2026_MS  # a plausible date that nobody vouches for
    assert machine.clock.source == "none"
    assert machine.clock.epoch_ms() is None
    assert iso(machine.clock.epoch_ms()) is None


def test_the_browsers_time_runs_on_with_the_monotonic_clock(machine: Machine) -> None:
    assert machine.clock.offer(MAY_2026_MS)
    machine.monotonic_ns += 90 * 10**9
    machine.system_ms = 123  # the system's clock may jump as it likes
    assert machine.clock.source == "browser"
    assert machine.clock.epoch_ms() == MAY_2026_MS + 90_000


def test_a_battery_clock_is_believed_and_the_browser_is_not_needed(machine: Machine) -> None:
    machine.battery_clock(str(MAY_2026_MS // 1000))
    machine.system_ms = MAY_2026_MS
    assert machine.clock.source == "rtc"
    assert not machine.clock.offer(MAY_2026_MS + 10**9)
    assert machine.clock.epoch_ms() == MAY_2026_MS


@pytest.mark.parametrize("reading", ["12", "", "garbage"])
def test_a_battery_clock_that_lost_its_battery_is_not_believed(machine: Machine, reading: str) -> None:
    machine.battery_clock(reading)
    machine.system_ms = MAY_2026_MS
    assert machine.clock.source == "none"


def test_network_time_outranks_the_battery_clock(machine: Machine) -> None:
    machine.battery_clock(str(MAY_2026_MS // 1000))
    machine.network_time()
    machine.system_ms = MAY_2026_MS
    assert machine.clock.source == "ntp"


def test_a_system_clock_in_1970_is_never_believed(machine: Machine) -> None:
    machine.network_time()
    machine.system_ms = 60_000
    assert machine.clock.source == "none"


@pytest.mark.parametrize("offer", [0, -1, 946_684_800_000, 10**15, True])
def test_an_absurd_offer_is_refused(machine: Machine, offer: int) -> None:
    with pytest.raises(Invalid, match="between 2025 and 2100"):
        machine.clock.offer(offer)


def test_iso_is_utc() -> None:
    assert iso(1_777_600_000_000) == "2026-05-01T01:46:40Z"
