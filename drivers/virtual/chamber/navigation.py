"""The twins of DVL, pressure sensor and AHRS: what they say of the virtual vehicle, as one log in order of time."""

from __future__ import annotations

import numpy as np

from drivers.navigation.readings import Attitude, Depth, NavReading, Velocity
from drivers.virtual.chamber.path import VehiclePath
from drivers.virtual.chamber.structure import Navigation


def navigation_log(path: VehiclePath, settings: Navigation, rng: np.random.Generator) -> list[NavReading]:
    """Readings with noise over the whole path, outages of the DVL included as velocities that are not valid."""
    readings: list[NavReading] = []
    times = np.arange(0.0, path.duration_s, 1.0 / settings.dvl_hz)
    velocities = path.velocity(times) + rng.normal(0.0, settings.dvl_noise_m_s, (len(times), 3))
    for time_s, velocity in zip(times.tolist(), velocities, strict=True):
        out = any(start <= time_s < start + length for start, length in settings.dvl_outages_s)
        readings.append(Velocity(time_s, _three(velocity), settings.dvl_noise_m_s, not out))
    times = np.arange(0.0, path.duration_s, 1.0 / settings.pressure_hz)
    depths = path.pose(times).position[:, 2] + rng.normal(0.0, settings.pressure_noise_m, len(times))
    readings += [Depth(*pair, settings.pressure_noise_m) for pair in zip(times.tolist(), depths.tolist(), strict=True)]
    times = np.arange(0.0, path.duration_s, 1.0 / settings.ahrs_hz)
    sigma = float(np.radians(settings.ahrs_noise_deg))
    noise = rng.normal(0.0, 1.0, (len(times), 2, 3))
    attitudes = path.pose(times).attitude + sigma * noise[:, 0]
    rates = path.attitude_rate(times) + np.radians(settings.ahrs_rate_noise_deg_s) * noise[:, 1]
    readings += [Attitude(t, _three(a), _three(r), sigma) for t, a, r in zip(times.tolist(), attitudes, rates, strict=True)]
    return sorted(readings, key=lambda reading: reading.time_s)


def _three(values: np.ndarray) -> tuple[float, float, float]:
    return float(values[0]), float(values[1]), float(values[2])
