"""The FCDD network as the detector of the landmarks survey."""

from __future__ import annotations

from pathlib import Path

from device.errors import Invalid
from device.fcdd.model import SHIPPED, SHIPPED_INT8, fastest_model, load_model
from device.landmarks.detectors import EVERY
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
        self.model = network.sha256
        self._pictures = 0

    def detect(self, frame: VideoFrame) -> tuple[Detection, ...] | None:
        """What is seen in ``frame``; None for the pictures in between."""
        self._pictures += 1
        if (self._pictures - 1) % self._every:
            return None
        return tuple(self._network.detect(frame.image))


def same_detector(sha256: str, model: Path | None = None, threads: int = 1) -> FcddDetector:
    """The detector whose model has this checksum, a shipped one or ``model``, looking at every picture that it is shown. Raises
    Invalid with one sentence."""
    for path in (SHIPPED, SHIPPED_INT8) if model is None else (model,):
        found = load_model(path, threads)
        if found.sha256 == sha256:
            return FcddDetector(found, every=1)
    where = "This program does not ship the model" if model is None else f"The file {model} is not the model"
    raise Invalid(f"{where} that this was recorded with ({sha256[:12]}): name it with --model, or use --recorded-detections.")


def shipped_detector(model: Path | None = None, every: int = EVERY, threads: int = 1) -> FcddDetector:
    """A detector with the shipped model, as this machine runs it fastest, or another. Raises Invalid with one sentence."""
    return FcddDetector(fastest_model(threads) if model is None else load_model(model, threads), every)
