"""The lamp: its driver on gpiozero's mock pins, its twin, how its level is chosen, and the thread that keeps it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from gpiozero.pins.mock import MockFactory, MockPWMPin
from hypothesis import given
from hypothesis import strategies as st

from device.clock import Clock
from device.errors import Invalid
from device.feeds.feed import EncoderFeed, GrabberFeed
from device.lamp.control import LampControl, LampRules, exposure
from device.lamp.keeper import LampKeeper
from device.landmarks.tether import Tether
from device.store import Store
from drivers.base import SensorLost, SensorMissing
from drivers.lamp.base import Lamp
from drivers.lamp.pwm import PwmLamp
from drivers.lamp.virtual import NOMINAL, VirtualLamp
from drivers.registry import open_lamp
from tests.unit.device.device_doubles import ScriptedEncoder, ScriptedGrabber, eventually

# --- drivers ---


@pytest.fixture
def pins() -> Iterator[MockFactory]:
    factory = MockFactory(pin_class=MockPWMPin)
    yield factory
    factory.reset()


def test_the_pin_carries_the_level(pins: MockFactory) -> None:
    lamp = PwmLamp(pin=18, hz=800, factory=pins)
    lamp.open()
    pin = pins.pin(18)
    assert pin.frequency == 800
    assert pin.state == 0.0
    for level in (1.0, 0.25, 0.0):
        lamp.set(level)
        assert pin.state == pytest.approx(level)
    lamp.set(0.7)
    lamp.close()
    lamp.close()
    assert pin.state == 0.0, "it is dark when nobody looks after it"


def test_a_lamp_that_is_not_there_is_said_in_a_sentence(pins: MockFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    lamp = PwmLamp(factory=pins)
    with pytest.raises(SensorLost, match="not open"):
        lamp.set(0.5)
    other = PwmLamp(factory=pins)
    other.open()
    with pytest.raises(SensorMissing, match="lamp at pin 18 cannot be used"):
        lamp.open()
    other.close()
    lamp.open()
    pins.reset()  # the pin is pulled away from under it
    monkeypatch.setitem(__import__("sys").modules, "gpiozero", None)
    with pytest.raises(SensorMissing, match="gpiozero"):
        PwmLamp(factory=pins).open()


@pytest.mark.parametrize("arguments", [{"pin": 40}, {"pin": -1}, {"hz": 10.0}, {"hz": 1e6}])
def test_settings_that_cannot_be_are_refused(arguments: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=r"\.$"):
        open_lamp("gpiozero", **arguments)


@pytest.mark.parametrize("level", [-0.01, 1.01, float("nan")])
def test_no_lamp_takes_a_level_beyond_its_power(level: float, pins: MockFactory) -> None:
    for lamp in (VirtualLamp(), PwmLamp(factory=pins)):
        lamp.open()
        with pytest.raises(ValueError, match="between 0 and 1"):
            lamp.set(level)
        lamp.close()


def test_the_twin_lights_the_picture() -> None:
    lamp = open_lamp("virtual")
    assert isinstance(lamp, VirtualLamp)
    picture = np.full((40, 60, 3), 120, np.uint8)
    greys = []
    for level in (0.0, 0.1, NOMINAL, 0.75, 1.0):
        lamp.set(level)
        greys.append(int(lamp.light(picture)[0, 0, 0]))
    assert greys[2] == 120
    assert greys[4] == round(120 * 2 ** (1 / 2.2))
    assert greys == sorted(greys)
    assert 0 < greys[0] < 10
    lamp.set(NOMINAL)
    assert lamp.light(picture) is picture, "at its nominal level it costs nothing"


# --- the choice ---


def test_exposure_is_of_the_bright_part() -> None:
    image = np.full((80, 80, 3), 40, np.uint8)
    image[:40] = 200
    assert exposure(image) == 200
    assert exposure(np.zeros((80, 80, 3), np.uint8)) == 0


def lit(level: float, reflectance: float) -> float:
    """A camera's grey value of a wall."""
    return min(255.0, 255 * (reflectance * level) ** (1 / 2.2))


@given(st.floats(0.1, 10), st.floats(0, 1))
def test_it_settles_and_stays(reflectance: float, begin: float) -> None:
    """From any level, for any wall, the lamp settles within a dozen changes, in the band or at its end, and never hunts."""
    rules = LampRules()
    control = LampControl(rules, begin)
    levels = [control.step(i * 1.0, lit(control.level, reflectance), may_rest=False) for i in range(25)]
    assert len(set(levels[15:])) == 1
    grey = lit(levels[-1], reflectance)
    assert rules.dark <= grey <= rules.bright or levels[-1] in (rules.lowest, 1.0)
    steps = np.sign(np.diff([step for step in levels if step > 0]))
    assert not (np.any(steps > 0) and np.any(steps < 0)), "it goes one way only"


def test_it_gives_the_camera_time_to_settle() -> None:
    control = LampControl(LampRules(pace_s=0.6), 0.1)
    assert control.step(0.0, 20.0, may_rest=False) == pytest.approx(0.1 * 4 / 3)
    assert control.step(0.3, 20.0, may_rest=False) == pytest.approx(0.1 * 4 / 3)
    assert control.step(0.6, 20.0, may_rest=False) == pytest.approx(0.1 * 16 / 9)


def test_by_hand_the_pictures_have_no_say() -> None:
    control = LampControl(level=0.3, automatic=False)
    assert control.step(0.0, 0.0, may_rest=False) == 0.3
    assert control.step(9.0, 255.0, may_rest=False) == 0.3


def test_it_goes_out_on_standstill_and_comes_back_as_it_was() -> None:
    control = LampControl(LampRules(off_after_s=120.0), 0.4)
    assert control.step(0.0, 150.0, may_rest=True) == 0.4
    assert control.step(119.9, 150.0, may_rest=True) == 0.4
    assert control.step(120.0, 150.0, may_rest=True) == 0.0
    assert control.resting
    assert control.step(500.0, 3.0, may_rest=True) == 0.0, "the dark that it made itself is no reason to shine"
    control.stir(501.0)
    assert control.step(501.0, 3.0, may_rest=True) == 0.4, "the last dark picture is not yet one in the new light"
    assert control.step(502.0, 150.0, may_rest=True) == 0.4


def test_without_anything_that_tells_of_motion_it_never_goes_out() -> None:
    control = LampControl(level=0.4)
    assert [control.step(t, None, may_rest=False) for t in (0.0, 1e3, 1e6)] == [0.4, 0.4, 0.4]


# --- the thread ---


class MoodyLamp(Lamp):
    """Fails while ``broken``."""

    name = "moody lamp"

    def __init__(self) -> None:
        self.broken = False
        self.levels: list[float] = []

    def open(self) -> None:
        self._check()

    def _set(self, level: float) -> None:
        self._check()
        self.levels.append(level)

    def close(self) -> None:
        self.levels.append(0.0)

    def _check(self) -> None:
        if self.broken:
            raise SensorLost("The lamp does not obey.")


@pytest.fixture
def store(tmp_path: Path) -> Iterator[Store]:
    store = Store(tmp_path, Clock(tmp_path / "no-machine"))
    yield store
    store.close()


def test_what_was_set_outlives_a_restart_and_the_end_is_dark(store: Store) -> None:
    lamp = MoodyLamp()
    keeper = LampKeeper(lamp, store.remembered, None, None)
    keeper.start()
    assert eventually(lambda: lamp.levels[-1:] == [0.5])
    assert keeper.set(level=0.8)["automatic"] is False
    assert eventually(lambda: lamp.levels[-1] == 0.8)
    keeper.close()
    assert lamp.levels[-1] == 0.0
    again = LampKeeper(MoodyLamp(), store.remembered, None, None)
    assert (again.state()["level"], again.state()["automatic"]) == (0.8, False)
    assert again.set(automatic=True)["automatic"] is True
    with pytest.raises(Invalid):
        again.set()
    with pytest.raises(Invalid):
        again.set(level=1.5)


def test_a_lamp_that_fails_is_told_and_tried_again(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("device.lamp.keeper.RETRY_S", 0.02)
    lamp = MoodyLamp()
    lamp.broken = True
    keeper = LampKeeper(lamp, store.remembered, None, None)
    keeper.start()
    assert eventually(lambda: keeper.state()["message"] == "The lamp does not obey.")
    assert keeper.state()["shining"] is None
    lamp.broken = False
    assert eventually(lambda: keeper.state()["shining"] == 0.5)
    assert keeper.state()["message"] == ""
    keeper.close()


def test_pictures_steer_it_and_the_tether_wakes_it(store: Store) -> None:
    """Bright noise in the pictures dims it; the counter that stands puts it out, and one that moves lights it again."""
    grabber = GrabberFeed("g", "virtual", lambda: ScriptedGrabber("frame", period_s=0.01))
    counter = ScriptedEncoder("5")
    tether = Tether(EncoderFeed("t", "virtual", lambda: counter), store.remembered, 1.0)
    rules = LampRules(pace_s=0.0, off_after_s=1.5, bright=20.0, dark=5.0, lowest=0.2)
    lamp = MoodyLamp()
    keeper = LampKeeper(lamp, store.remembered, grabber, tether, rules=rules)
    for part in (grabber, tether.feed):
        part.start()
    keeper.start()
    try:
        assert eventually(lambda: 0.2 in lamp.levels)
        assert eventually(lambda: keeper.state()["resting"] and lamp.levels[-1] == 0.0)
        keeper.look()
        assert eventually(lambda: keeper.state()["shining"] == 0.2)
        assert eventually(lambda: keeper.state()["shining"] == 0.0)
        tether.zero(3.0)  # the chainage changes as it does when the crawler moves
        assert eventually(lambda: keeper.state()["shining"] == 0.2)
    finally:
        keeper.close()
        for part in (grabber, tether.feed):
            part.close()
