"""Cameras and estimates that do as a test says. In a module of its own, since worker processes import it by name."""

from __future__ import annotations

import itertools
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.base import BadFrame, FrameTimeout, RecordingBroken, SensorLost, SensorMissing
from drivers.depth.base import DepthCamera, DepthFrame
from drivers.encoder.base import Encoder, Reading
from drivers.grabber.base import FrameGrabber, VideoFrame
from estimators.frame import FrameEstimate
from estimators.pinhole import Intrinsics

INTRINSICS = Intrinsics(64, 48, 50.0, 50.0, 32.0, 24.0)
_counter = itertools.count(1)


def frame(number: int, *, depth: NDArray[np.uint16] | None = None, source: str = "fake") -> DepthFrame:
    """A picture unlike every other one."""
    if depth is None:
        depth = np.random.default_rng(next(_counter)).integers(300, 400, (48, 64)).astype(np.uint16)
    return DepthFrame(depth, INTRINSICS, 0.001, time.monotonic_ns(), number, source=source)


class ScriptedCamera(DepthCamera):
    """Answers each read by the next word of ``script`` and goes on with its last one.

    Words: frame, skip (four numbers), timeout, bad, broken, lost, crash, freeze (the same picture), empty, stuck (until
    ``release`` is set). The first ``missing`` openings fail with SensorMissing. What is asked of it is kept in ``calls``.
    """

    name = "scripted camera"

    def __init__(self, script: str | Callable[[], str], missing: int = 0, period_s: float = 0.002) -> None:
        self.calls: list[str] = []
        self.release = threading.Event()
        self._words: Iterator[str] | None = None
        self._next = script if callable(script) else self._from(script.split())
        self._missing = missing
        self._period_s = period_s
        self._number = 0
        self._still = np.full((48, 64), 500, np.uint16)

    def _from(self, words: list[str]) -> Callable[[], str]:
        iterator = itertools.chain(words, itertools.repeat(words[-1]))
        return lambda: next(iterator)

    def _open(self) -> None:
        self.calls.append("open")
        if self._missing > 0:
            self._missing -= 1
            raise SensorMissing("No camera is plugged in.")

    def _read(self, timeout_s: float) -> DepthFrame:
        time.sleep(self._period_s)
        word = self._next()
        self._number += 1
        if word == "timeout":
            raise FrameTimeout("Nothing came.")
        if word == "bad":
            raise BadFrame("The picture has the wrong size.")
        if word == "lost":
            raise SensorLost("The camera is gone.")
        if word == "broken":
            raise RecordingBroken("depth_7.png is missing.")
        if word == "crash":
            raise RuntimeError("segmentation fault, nearly")
        if word == "stuck":
            self.release.wait()
            raise SensorLost("Back from the dead.")
        if word == "freeze":
            return frame(self._number, depth=self._still)
        if word == "empty":
            return frame(self._number, depth=np.zeros((48, 64), np.uint16))
        if word == "skip":
            self._number += 4
        return frame(self._number)

    def reset(self) -> None:
        self.calls.append("reset")

    def close(self) -> None:
        self.calls.append("close")


def eventually(condition: Callable[[], Any], within_s: float = 5.0) -> bool:
    """Whether ``condition`` becomes true in time. Generous: the machine may be busy with other things."""
    deadline = time.monotonic() + within_s
    while time.monotonic() < deadline:
        if condition():
            return True
        time.sleep(0.005)
    return bool(condition())


def no_fit(depth: NDArray[np.uint16], intrinsics: Intrinsics, unit: float, seed: int, resamples: int) -> FrameEstimate:
    """An estimate that found nothing; its ``points`` are the seed, so that a test can tell them apart."""
    return FrameEstimate(None, None, 0.5, seed, intrinsics)


def slow_no_fit(depth: NDArray[np.uint16], intrinsics: Intrinsics, unit: float, seed: int, resamples: int) -> FrameEstimate:
    time.sleep(0.2)
    return no_fit(depth, intrinsics, unit, seed, resamples)


def dies_on_400(depth: NDArray[np.uint16], intrinsics: Intrinsics, unit: float, seed: int, resamples: int) -> FrameEstimate:
    """Kills its process on seed 400, hangs on 401, raises on 402."""
    if seed == 400:
        os.kill(os.getpid(), signal.SIGKILL)
    if seed == 401:
        time.sleep(60)
    if seed == 402:
        raise ValueError("cannot fit this")
    return no_fit(depth, intrinsics, unit, seed, resamples)


def thread_counts(depth: NDArray[np.uint16], intrinsics: Intrinsics, unit: float, seed: int, resamples: int) -> FrameEstimate:
    """``points`` tells how many threads OpenCV may use in the worker."""
    import cv2

    assert os.environ["OPENBLAS_NUM_THREADS"] == "1"
    return FrameEstimate(None, None, 0.0, cv2.getNumThreads(), intrinsics)


class ScriptedGrabber(FrameGrabber):
    """As ``ScriptedCamera``, with words: frame, skip, timeout, lost, freeze, blue (no signal)."""

    name = "scripted grabber"

    def __init__(self, script: str, period_s: float = 0.002) -> None:
        self.calls: list[str] = []
        words = script.split()
        self._words = itertools.chain(words, itertools.repeat(words[-1]))
        self._period_s = period_s
        self._number = 0

    def _open(self) -> None:
        self.calls.append("open")

    def _read(self, timeout_s: float) -> VideoFrame:
        time.sleep(self._period_s)
        word = next(self._words)
        self._number += 4 if word == "skip" else 1
        if word == "timeout":
            raise FrameTimeout("Nothing came.")
        if word == "lost":
            raise SensorLost("The grabber is gone.")
        seed = 0 if word == "freeze" else next(_counter)
        blocks = np.random.default_rng(seed).integers(20, 200, (6, 8, 3)).astype(np.uint8)
        image = blocks.repeat(8, axis=0).repeat(8, axis=1)  # a picture, where neighbours are alike
        if word == "blue":
            image[:] = (200, 30, 10)
        return VideoFrame(image, time.monotonic_ns(), self._number)

    def close(self) -> None:
        self.calls.append("close")


class ScriptedEncoder(Encoder):
    """Says the next number of ``script`` (the last one for ever), or times out on "timeout", or is gone on "lost"."""

    name = "scripted encoder"

    def __init__(self, script: str, period_s: float = 0.002) -> None:
        self.calls: list[str] = []
        words = script.split()
        self._words = itertools.chain(words, itertools.repeat(words[-1]))
        self._period_s = period_s

    def _open(self) -> None:
        self.calls.append("open")

    def _read(self, timeout_s: float) -> Reading:
        time.sleep(self._period_s)
        word = next(self._words)
        if word == "timeout":
            raise FrameTimeout("The encoder said nothing.")
        if word == "lost":
            raise SensorLost("The encoder was unplugged.")
        return Reading(float(word), time.monotonic_ns())

    def close(self) -> None:
        self.calls.append("close")
