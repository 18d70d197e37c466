"""A lamp whose driver board takes pulse width modulation from a pin of the Raspberry Pi, through gpiozero."""

from __future__ import annotations

import logging
from typing import Any

from drivers.base import SensorLost, SensorMissing
from drivers.lamp.base import Lamp

log = logging.getLogger(__name__)


class PwmLamp(Lamp):
    """``pin`` is the Broadcom number of the pin; ``hz`` the rate of the pulses, well above a camera's frame rate so that no
    picture catches the lamp in a pause. ``factory`` is gpiozero's pin factory, chosen by gpiozero where it is None."""

    def __init__(self, pin: int = 18, hz: float = 1000.0, factory: Any = None) -> None:
        if not 0 <= pin <= 27:
            raise ValueError(f"The Raspberry Pi has the pins 0 to 27, not {pin}.")
        if not 50 <= hz <= 20_000:
            raise ValueError(f"A lamp is pulsed 50 to 20000 times a second, not {hz:g}.")
        self.name = f"lamp at pin {pin}"
        self._pin, self._hz, self._factory = pin, hz, factory
        self._led: Any = None

    def open(self) -> None:
        """See ``Lamp``."""
        self.close()
        try:
            from gpiozero import PWMLED
        except ImportError:
            raise SensorMissing("The lamp needs gpiozero: pip install 'borescout[lamp]'.") from None
        try:
            self._led = PWMLED(self._pin, frequency=int(self._hz), pin_factory=self._factory)
        except Exception as error:  # noqa: BLE001 - gpiozero, its pin factories and the kernel have errors of their own
            raise SensorMissing(f"The {self.name} cannot be used: {str(error).rstrip('.')}.") from None

    def _set(self, level: float) -> None:
        if self._led is None:
            raise SensorLost(f"The {self.name} is not open.")
        try:
            self._led.value = level
        except Exception as error:  # noqa: BLE001 - as above
            raise SensorLost(f"The {self.name} does not obey: {str(error).rstrip('.')}.") from None

    def close(self) -> None:
        """See ``Lamp``."""
        led, self._led = self._led, None
        if led is None:
            return
        try:
            led.off()
            led.close()
        except Exception as error:  # noqa: BLE001 - close promises not to raise, and the process may be on its way out
            log.warning("%s could not be let go of: %s", self.name, error)
