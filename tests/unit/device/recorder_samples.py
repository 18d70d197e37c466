"""Samples to record, and a recording of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from device.recorder import Recorder
from device.recorder.names import Name
from device.recorder.samples import Picture, picture
from drivers.depth.base import DepthFrame
from drivers.encoder.base import Reading
from drivers.grabber.base import VideoFrame
from estimators.pinhole import Intrinsics

CAMERA = Intrinsics(64, 48, 50.5, 51.25, 31.5, 23.5, "inverse_brown_conrady", (0.1, -0.2, 0.001, 0.002, 0.03))


def depth_frame(number: int, color: bool = True) -> DepthFrame:
    """A frame of noise, the same for the same number."""
    rng = np.random.default_rng(number)
    picture = rng.integers(0, 256, (24, 32, 3)).astype(np.uint8) if color else None
    depth = rng.integers(0, 65536, (48, 64)).astype(np.uint16)
    return DepthFrame(depth, CAMERA, 0.001, 1_000_000_007 * number, number, picture, "some camera", 0.004)


def cctv(number: int, size: tuple[int, int] = (48, 64)) -> Picture:
    """A picture of noise."""
    image = np.random.default_rng(number).integers(0, 256, (*size, 3)).astype(np.uint8)
    return picture(VideoFrame(image, 40_000_000 * number, number, number / 25, "grabber"))


def reading(number: int) -> Reading:
    """A counter that goes on."""
    return Reading(0.1 * number, 1000 * number, "m", 0.1, tension=2.5)


def recording(folder: Path, pictures: int = 12, take: int = 1, survey: int = 7) -> Path:
    """A finished recording with so many pictures, each in a chunk of its own, with a reading after each."""
    recorder = Recorder(folder, Name(survey, take, 1), {"kind": "landmarks", "survey_id": survey}).open()
    for number in range(pictures):
        recorder.write("/cctv", cctv(number, (240, 320)))
        recorder.write("/tether", reading(number))
    recorder.close()
    return folder / str(Name(survey, take, 1))
