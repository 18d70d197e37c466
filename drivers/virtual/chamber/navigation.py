"""The twins of DVL, pressure sensor and AHRS: what they say of the virtual vehicle, as one log in order of time."""

from __future__ import annotations

import numpy as np

from drivers.navigation.readings import Attitude, Depth, NavReading, Velocity
from drivers.virtual.chamber.path import VehiclePath
from drivers.virtual.chamber.structure import Navigation


def navigation_log(path: VehiclePath, settings: Navigation, rng: np.random.Generator) -> list[NavReading]:
    """Readings with noise over the whole path, outages of the DVL included as velocities that are not valid."""
    readings: list[NavReading] = []
    for time_s in _times(path, settings.dvl_hz):
        out = any(start <= time_s < start + length for start, length in settings.dvl_outages_s)
        velocity = path.velocity(time_s) + rng.normal(0.0, settings.dvl_noise_m_s, 3)
        readings.append(Velocity(time_s, _three(velocity), settings.dvl_noise_m_s, not out))
    for time_s in _times(path, settings.pressure_hz):
        depth = float(path.pose(time_s).position[2] + rng.normal(0.0, settings.pressure_noise_m))
        readings.append(Depth(time_s, depth, settings.pressure_noise_m))
    for time_s in _times(path, settings.ahrs_hz):
        attitude = path.pose(time_s).attitude + rng.normal(0.0, np.radians(settings.ahrs_noise_deg), 3)
        rates = path.attitude_rate(time_s) + rng.normal(0.0, np.radians(settings.ahrs_rate_noise_deg_s), 3)
        sigma = float(np.radians(settings.ahrs_noise_deg))
        readings.append(Attitude(time_s, _three(attitude), _three(rates), sigma))
    return sorted(readings, key=lambda reading: reading.time_s)


def _times(path: VehiclePath, hz: float) -> list[float]:
    return [float(t) for t in np.arange(0.0, path.duration_s, 1.0 / hz)]


def _three(values: np.ndarray) -> tuple[float, float, float]:
    return float(values[0]), float(values[1]), float(values[2])
