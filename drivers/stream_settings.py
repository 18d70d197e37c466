"""What is asked of any camera that streams with a dot projector."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class StreamSettings:
    """``width`` x ``height`` pixels, ``fps`` in 1/s; ``emitter`` is the infrared dot projector; ``exposure_us`` of the infrared
    pair in microseconds, None for automatic; ``laser_power`` as a share 0..1 of the projector's range, None for the camera's
    default; ``serial`` picks one of several cameras. Raises ValueError."""

    width: int = 848
    height: int = 480
    fps: int = 30
    emitter: bool = True
    exposure_us: int | None = None
    laser_power: float | None = None
    serial: str | None = None

    def __post_init__(self) -> None:
        if self.width < 1 or self.height < 1 or self.fps < 1:
            raise ValueError(f"a camera cannot stream {self.width} x {self.height} at {self.fps} pictures a second")
        if self.exposure_us is not None and self.exposure_us < 1:
            raise ValueError(f"exposure must be a positive number of microseconds, got {self.exposure_us}")
        if self.laser_power is not None and not 0.0 <= self.laser_power <= 1.0:
            raise ValueError(f"laser power must be between 0 and 1, got {self.laser_power}")
