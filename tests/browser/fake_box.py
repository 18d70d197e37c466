"""The box itself of the device without cameras: its health and its lamp, as a test sets them."""

from typing import Any

from device.errors import Invalid, NotFound
from device.prompts import PROMPTS

Json = dict[str, Any]


class FakeBox:
    """`lamp_state` None: a box without a lamp. `concerns` are codes of `device.prompts`."""

    clock_source: str
    lamp_state: Json | None
    concerns: tuple[str, ...]

    def set_up_box(self) -> None:
        self.lamp_state = {
            "name": "fake lamp",
            "automatic": True,
            "level": 0.5,
            "shining": 0.5,
            "resting": False,
            "message": "",
        }
        self.concerns = ()

    def box_prompts(self) -> list[Json]:
        return [PROMPTS[code].to_json() for code in self.concerns]

    def health(self) -> Json:
        machine = {
            "temperature_c": 51.2,
            "power": {
                "under_voltage": "under_voltage" in self.concerns,
                "frequency_capped": False,
                "throttled": False,
                "soft_temperature_limit": False,
                "under_voltage_before": False,
                "frequency_capped_before": False,
                "throttled_before": False,
                "soft_temperature_limit_before": False,
            },
            "memory_free_mb": 2713,
            "usb": [{"name": "Intel RealSense D435", "mbps": 5000.0, "fast": True}],
            "hotspot": "up",
            "wifi_clients": 2,
        }
        sensor = {
            "role": "camera",
            "name": "front",
            "state": "up",
            "age_s": 0.04,
            "fps": 29.8,
            "drops": 3,
            "bad": 0,
            "reconnects": 1,
        }
        return {
            "disk_free_mb": 11840,
            "disk_total_mb": 29500,
            "clock": self.clock_source,
            "machine": machine,
            "sensors": [sensor, {**sensor, "role": "encoder", "name": "counter", "state": "degraded", "age_s": 4.2}],
            "hotspot_restored": 0,
            "prompts": self.box_prompts(),
        }

    def lamp(self) -> Json:
        if self.lamp_state is None:
            raise NotFound("This box has no lamp that can be dimmed.")
        return dict(self.lamp_state)

    def set_lamp(self, level: float | None = None, automatic: bool | None = None) -> Json:
        state = self.lamp()
        if level is None and automatic is None:
            raise Invalid("Say how bright the lamp should be, or that it is automatic.")
        state["automatic"] = bool(automatic)
        if level is not None:
            state["level"] = state["shining"] = level
        self.lamp_state = state
        return state
