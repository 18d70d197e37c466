"""How the box itself is: the readings, and which of them somebody has to be told of. ``machine`` does the asking."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any, Literal

from device.clock import ClockSource

HotspotState = Literal["up", "silent", "off", "unknown"]


@dataclass(frozen=True)
class Power:
    """``vcgencmd get_throttled``: what is the case now, and whether it was since the box booted."""

    under_voltage: bool = False
    frequency_capped: bool = False
    throttled: bool = False
    soft_temperature_limit: bool = False
    under_voltage_before: bool = False
    frequency_capped_before: bool = False
    throttled_before: bool = False
    soft_temperature_limit_before: bool = False


def power(bits: int) -> Power:
    """From the word of the Raspberry Pi's firmware: bits 0 to 3 now, 16 to 19 since boot."""
    return Power(*(bool(bits >> bit & 1) for bit in (0, 1, 2, 3, 16, 17, 18, 19)))


@dataclass(frozen=True)
class UsbCamera:
    """A camera on the USB bus. ``fast`` says that it is made for USB 3 (5 Gbit/s), ``mbps`` how fast it is connected."""

    name: str
    mbps: float
    fast: bool


@dataclass(frozen=True)
class SensorHealth:
    """One source end to end: ``age_s`` is that of its last good sample, None before the first."""

    role: str
    """"camera", "grabber" or "encoder"."""
    name: str
    state: str
    age_s: float | None
    fps: float
    drops: int
    bad: int
    reconnects: int


@dataclass(frozen=True)
class Machine:
    """What the computer says of itself. None: it does not say."""

    temperature_c: float | None = None
    power: Power | None = None
    memory_free_mb: int | None = None
    usb: tuple[UsbCamera, ...] = ()
    hotspot: HotspotState = "unknown"
    wifi_clients: int | None = None


@dataclass(frozen=True)
class Health:
    """Everything at one moment. ``disk_free_mb`` is 0 where the disk does not answer."""

    disk_free_mb: int
    disk_total_mb: int
    clock: ClockSource
    machine: Machine = field(default_factory=Machine)
    sensors: tuple[SensorHealth, ...] = ()
    hotspot_restored: int = 0
    """How often the hotspot was silent and has been started anew."""

    def to_json(self) -> dict[str, Any]:
        """As the page and the log of a survey want it."""
        return asdict(self)


@dataclass(frozen=True)
class Limits:
    """When somebody is told. Each pair is where a warning begins and where it ends: a value at the edge must not flicker."""

    disk_low_mb: tuple[int, int] = (1000, 1100)
    hot_c: tuple[float, float] = (75.0, 72.0)
    """The firmware slows the processor down from 80 on."""
    too_hot_c: tuple[float, float] = (82.0, 78.0)
    memory_low_mb: tuple[int, int] = (150, 200)
    usb_fast_mbps: float = 5000.0


def concerns(health: Health, before: frozenset[str] = frozenset(), limits: Limits | None = None) -> tuple[str, ...]:
    """Codes of ``device.prompts``, the weightiest first. ``before`` are those of the last time, for the hysteresis."""
    limits = limits or Limits()
    machine, supply = health.machine, health.machine.power or Power()

    def below(code: str, value: float | None, edges: tuple[float, float]) -> bool:
        return value is not None and value < (edges[1] if code in before else edges[0])

    def above(code: str, value: float | None, edges: tuple[float, float]) -> bool:
        return value is not None and value > (edges[1] if code in before else edges[0])

    if "too_hot" in before:
        before = before | {"hot"}  # on its way down it is still hot
    too_hot = above("too_hot", machine.temperature_c, limits.too_hot_c)
    slowed = supply.throttled or supply.frequency_capped or supply.soft_temperature_limit
    found = {
        "under_voltage": supply.under_voltage,
        "too_hot": too_hot,
        "disk_low": below("disk_low", health.disk_free_mb, limits.disk_low_mb),
        "hotspot_silent": machine.hotspot in ("silent", "off"),
        "memory_low": below("memory_low", machine.memory_free_mb, limits.memory_low_mb),
        "usb_slow": any(camera.fast and camera.mbps < limits.usb_fast_mbps for camera in machine.usb),
        "hot": not too_hot and above("hot", machine.temperature_c, limits.hot_c),
        "slowed": slowed and not supply.under_voltage,
        "was_under_voltage": supply.under_voltage_before and not supply.under_voltage,
        "clock_unset": health.clock == "none",
    }
    return tuple(code for code, is_so in found.items() if is_so)
