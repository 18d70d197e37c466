"""The twins of DVL, pressure sensor and AHRS on their wires: ptys whose other ends say, byte for byte, what the sensors say."""

from __future__ import annotations

import contextlib
import math
import os
import threading
import time
import tty

import numpy as np

from drivers.navigation.ahrs import mtdata2_message
from drivers.navigation.dvl import wrz_line
from drivers.navigation.pressure import ATMOSPHERE_PA, GRAVITY
from drivers.navigation.sums import nmea_line
from drivers.virtual.chamber.path import VehiclePath
from drivers.virtual.chamber.structure import Navigation
from drivers.virtual.crawler import DriveClock

DENSITY = 998.0
SENSORS = ("dvl", "pressure", "ahrs")


class Wire:
    """One pty; ``port`` is its name. Lost is what is written while nobody reads."""

    def __init__(self) -> None:
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.port = os.ttyname(self._slave)

    def send(self, data: bytes) -> None:
        """Write ``data``, or as much as fits."""
        with contextlib.suppress(BlockingIOError):
            os.write(self._master, data)

    def close(self) -> None:
        """Both ends."""
        os.close(self._master)
        os.close(self._slave)


class NavigationWires:
    """A thread that speaks for the three sensors of the vehicle on ``path``, at the moment that ``clock`` tells.

    ``silent`` holds the names of sensors that say nothing, for who wants to see that. The noise comes from ``rng``.
    """

    def __init__(self, path: VehiclePath, settings: Navigation, clock: DriveClock, rng: np.random.Generator) -> None:
        self.silent: set[str] = set()
        self._wires = {name: Wire() for name in SENSORS}
        self._path, self._settings, self._clock, self._rng = path, settings, clock, rng
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="virtual navigation", daemon=True)

    def port(self, sensor: str) -> str:
        """Where the driver of "dvl", "pressure" or "ahrs" finds it."""
        return self._wires[sensor].port

    def start(self) -> None:
        """Begin to speak."""
        self._thread.start()

    def close(self) -> None:
        """Fall silent, and take the ports away."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join(2.0)
        for wire in self._wires.values():
            wire.close()

    def _run(self) -> None:
        period_s = dict(
            zip(SENSORS, (1 / self._settings.dvl_hz, 1 / self._settings.pressure_hz, 1 / self._settings.ahrs_hz), strict=True)
        )
        due = dict.fromkeys(SENSORS, time.monotonic())
        while not self._stop.is_set():
            now = time.monotonic()
            for name in SENSORS:
                if now >= due[name]:
                    due[name] = max(due[name] + period_s[name], now)
                    message = self._message(name, self._clock.now_s())
                    if name not in self.silent:
                        self._wires[name].send(message)
            self._stop.wait(max(0.001, min(due.values()) - time.monotonic()))

    def _message(self, name: str, t: float) -> bytes:
        settings, rng = self._settings, self._rng
        standing = t >= self._path.duration_s or t <= 0.0
        if name == "dvl":
            velocity = (0.0 if standing else 1.0) * self._path.velocity(t) + rng.normal(0.0, settings.dvl_noise_m_s, 3)
            out = any(start <= t < start + length for start, length in settings.dvl_outages_s)
            x, y, z = (float(v) for v in velocity)
            return wrz_line((x, y, z), not out, settings.dvl_noise_m_s, round(t * 1e6))
        pose = self._path.pose(t)
        if name == "pressure":
            depth = float(pose.position[2] + rng.normal(0.0, settings.pressure_noise_m))
            bar = (ATMOSPHERE_PA + depth * DENSITY * GRAVITY) / 1e5
            return nmea_line(f"YXXDR,P,{bar:.5f},B,DEPTH".encode())
        roll, pitch, yaw = (float(a) for a in pose.attitude + rng.normal(0.0, math.radians(settings.ahrs_noise_deg), 3))
        rates = (0.0 if standing else 1.0) * self._path.attitude_rate(t)
        rates = rates + rng.normal(0.0, math.radians(settings.ahrs_rate_noise_deg_s), 3)
        p = rates[0] - math.sin(pitch) * rates[2]
        q = math.cos(roll) * rates[1] + math.cos(pitch) * math.sin(roll) * rates[2]
        r = -math.sin(roll) * rates[1] + math.cos(pitch) * math.cos(roll) * rates[2]
        return mtdata2_message((roll, pitch, yaw), (float(p), float(q), float(r)))
