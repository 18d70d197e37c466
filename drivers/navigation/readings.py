"""What the navigation sensors say, each reading with its time and its own noise."""

from __future__ import annotations

from dataclasses import dataclass

Triple = tuple[float, float, float]


class _Timed:
    """``time_s`` of a live reading is the host's monotonic clock."""

    time_s: float

    @property
    def monotonic_ns(self) -> int:
        """When it was taken on the host's clock."""
        return round(self.time_s * 1e9)


@dataclass(frozen=True)
class Velocity(_Timed):
    """A DVL: velocity over ground (m/s) along the vehicle's axes forward, right, down; ``sigma`` of each."""

    time_s: float
    velocity: Triple
    sigma: float
    valid: bool = True


@dataclass(frozen=True)
class Depth(_Timed):
    """A pressure sensor: metres below the surface."""

    time_s: float
    depth: float
    sigma: float


@dataclass(frozen=True)
class Attitude(_Timed):
    """An AHRS: roll, pitch and yaw (rad) and, where it tells them, their rates (rad/s); ``sigma`` of each angle."""

    time_s: float
    angles: Triple
    rates: Triple | None
    sigma: float


NavReading = Velocity | Depth | Attitude
