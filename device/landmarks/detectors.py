"""Who says what is seen in a picture. The landmarks survey knows one interface, whatever stands behind it."""

from __future__ import annotations

from typing import Protocol

from drivers.grabber.base import VideoFrame
from estimators.detections import Detection

EVERY = 2
"""The network looks at every second picture: a crawler moves a centimetre between two, and the survey predicts in between."""


class Detector(Protocol):
    """Finds landmarks in single pictures."""

    name: str

    def detect(self, frame: VideoFrame) -> tuple[Detection, ...] | None:
        """What is seen in ``frame``; None where it did not look, which is held against nothing."""


class NoDetector:
    """Of a real video without a trained detector only joints are mapped."""

    name = "none"

    def detect(self, frame: VideoFrame) -> tuple[Detection, ...] | None:
        """It never looks."""
        return None
