"""The cameras of the virtual box, made once: reopening a camera must find the same hardware, and all of them one pipe."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import numpy as np

from drivers.virtual.color import Painter
from drivers.virtual.demo import DemoRig, Description, read_description
from drivers.virtual.depth_camera import STEREO_LENSES, TIME_OF_FLIGHT_LENSES, VirtualBus, VirtualCamera
from drivers.virtual.faults import FaultScript
from drivers.virtual.noise import StereoCamera, TimeOfFlightCamera, TimeOfFlightNoise
from estimators.pinhole import Intrinsics

STEREO_SERIAL, TIME_OF_FLIGHT_SERIAL = "virtual-stereo", "virtual-tof"
TIME_OF_FLIGHT_FPS = 10


def virtual_bus(description: Description, seed: int = 1) -> VirtualBus:
    """An active stereo camera and a time-of-flight camera in one box. The faults of the description befall the first."""
    sewer, rig = description.sewer(), DemoRig(description, seed)

    def stereo(lens: Intrinsics) -> StereoCamera:
        return StereoCamera(lens, description.noise(), description.window(), np.random.default_rng([seed, 1]))

    def time_of_flight(lens: Intrinsics) -> TimeOfFlightCamera:
        return TimeOfFlightCamera(lens, TimeOfFlightNoise(), description.window(), np.random.default_rng([seed, 2]))

    return VirtualBus(
        [
            VirtualCamera(
                "virtual stereo camera",
                STEREO_SERIAL,
                sewer,
                rig,
                stereo,
                STEREO_LENSES,
                Painter(sewer.profile.mean_diameter / 2, seed),
                faults=FaultScript(description.faults),
            ),
            VirtualCamera(
                "virtual time-of-flight camera",
                TIME_OF_FLIGHT_SERIAL,
                sewer,
                rig,
                time_of_flight,
                TIME_OF_FLIGHT_LENSES,
                most_fps=TIME_OF_FLIGHT_FPS,
                line="virtual ToF",
            ),
        ]
    )


@lru_cache(maxsize=4)
def demo_bus(seed: int, description: Path | None) -> VirtualBus:
    """The box of this process that looks into the described sewer. Raises DescriptionBroken."""
    return virtual_bus(Description() if description is None else read_description(description), seed)
