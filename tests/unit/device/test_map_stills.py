"""Stills of a pipe that bends at its joints, by a camera that is panned between them: no flow, only rings and tether."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from device.landmarks.pipeline import LandmarkPipeline, PipelineSetup
from drivers.grabber.base import VideoFrame
from estimators.detections import Detection
from estimators.odometry import Position

FOCAL, RADIUS_M, PIPE_M, STEP_M = 500.0, 0.3, 2.5, 0.2
BELOW_M = 0.03
"""How far the pipe's axis lies below the camera."""
BEYOND_M = (-0.2, 0.22, -0.18)
"""How far to the right the joint after the next lies, from the first pipe, from the second, ..."""
CONNECTION = (3.9, -0.5)
"""Where along (m) and around (rad)."""


class Stills:
    """Pictures, and a detector that sees the connection where it is."""

    name = "truth"

    def __init__(self) -> None:
        rng = np.random.default_rng(4)
        self.centres = np.array([360.0, 288.0]) + rng.uniform(-50, 50, (30, 2))
        self._rng = rng

    def position(self, k: int) -> float:
        return STEP_M * k

    def picture(self, k: int) -> NDArray[np.uint8]:
        passed, into = divmod(self.position(k) + 1e-9, PIPE_M)
        rings = []
        for ahead, aside in ((0, 0.0), (1, BEYOND_M[int(passed)])):
            depth = (ahead + 1) * PIPE_M - into
            if depth > 0.45:
                rings.append((self.centres[k] + FOCAL * np.array([aside, BELOW_M]) / depth, FOCAL * RADIUS_M / depth))
        u, v = np.meshgrid(np.arange(720), np.arange(576))
        image = 150 * (1 - np.exp(-(np.hypot(u - rings[-1][0][0], v - rings[-1][0][1]) ** 2) / 130**2)) + 6
        grain = cv2.GaussianBlur(self._rng.normal(size=image.shape), (0, 0), 2.5)
        picture = np.clip(image * (1 + 0.05 * grain / grain.std()), 0, 255).astype(np.uint8)
        for (x, y), radius in rings:
            shade = int(0.45 * picture[int(y), int(np.clip(x + radius, 0, 719))])
            at = (round(16 * x), round(16 * y))
            cv2.circle(picture, at, round(16 * radius), shade, max(2, round(radius / 40)), cv2.LINE_AA, 4)
        return cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR)

    def detect(self, frame: VideoFrame) -> tuple[Detection, ...]:
        k = frame.number - 1
        depth, angle = CONNECTION[0] - self.position(k), CONNECTION[1]
        if not 0.3 < depth < 1.6:
            return ()
        wall = RADIUS_M * np.array([math.cos(angle), math.sin(angle)]) + (0.0, BELOW_M)
        u, v = self.centres[k] + FOCAL * wall / depth
        return (Detection(float(u), float(v), "connection", 0.9),) if 0 <= u < 720 and 0 <= v < 576 else ()


def test_the_map_of_stills_looks_where_the_crawler_goes_not_where_the_next_pipe_does() -> None:
    stills = Stills()
    setup = PipelineSetup((FOCAL, FOCAL), None, RADIUS_M, sparse=True)
    pipeline = LandmarkPipeline(setup, stills)
    for k in range(25):
        frame = VideoFrame(stills.picture(k), k * 1_000_000_000, k + 1, media_s=float(k))
        pipeline.step(frame, Position(stills.position(k), 0.02, STEP_M, False))
    pipeline.finish()
    (found,) = pipeline.landmarks()
    assert found.chainage == pytest.approx(CONNECTION[0], abs=0.06)
    assert math.degrees(abs(found.angle - CONNECTION[1])) < 4
    off = [np.hypot(*(np.array(seen.view.centre) - stills.centres[seen.frame - 1])) for seen in found.sightings]
    assert len(off) >= 4
    assert np.median(off) < 8
