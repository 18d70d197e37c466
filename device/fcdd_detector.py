"""The FCDD network as the detector of the landmarks survey."""

from __future__ import annotations

from pathlib import Path

from device.detectors import EVERY
from device.fcdd_model import fastest_model, load_model
from drivers.grabber.base import VideoFrame
from estimators.detections import Detection
from estimators.fcdd import Fcdd


class FcddDetector:
    """Looks at every ``every``-th picture."""

    name = "fcdd"

    def __init__(self, network: Fcdd, every: int = EVERY) -> None:
        if every < 1:
            raise ValueError(f"The network looks at every first picture at most, not at every {every}th.")
        self._network, self._every = network, every
        self._pictures = 0

    def detect(self, frame: VideoFrame) -> tuple[Detection, ...] | None:
        """What is seen in ``frame``; None for the pictures in between."""
        self._pictures += 1
        if (self._pictures - 1) % self._every:
            return None
        return tuple(self._network.detect(frame.image))


def shipped_detector(model: Path | None = None, every: int = EVERY, threads: int = 1) -> FcddDetector:
    """A detector with the shipped model, as this machine runs it fastest, or another. Raises Invalid with one sentence."""
    return FcddDetector(fastest_model(threads) if model is None else load_model(model, threads), every)
