"""A scan of the anomaly survey computed again: the same pairs, inspected and judged the same way."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from device.anomaly.scan import concluded, refused
from device.anomaly.survey import moved
from device.anomaly.work import Inspected, work
from device.recorder.reader import Entry
from device.recorder.samples import Picture
from device.recorder.schemas import topic_name
from device.surveys.topics import PAIRS
from estimators.pinhole import Intrinsics
from estimators.stereo.rig import StereoRig

_SIDES = ("left", "right")


class AnomalyReplay:
    """``head`` as ``surveys.anomaly`` writes it."""

    def __init__(self, head: dict[str, Any]) -> None:
        self.missing = self.frames = 0
        self._head = head
        self._topics = {topic_name("stereo", head["camera"], side): side for side in _SIDES}
        self._newest: dict[str, Picture] = {}
        self._pairs: list[tuple[NDArray[np.uint8], NDArray[np.uint8], StereoRig]] = []
        cv2.setNumThreads(1)

    def take(self, entry: Entry) -> str | None:
        """Two pictures wait for what is noted of them."""
        sample = entry.sample
        if isinstance(sample, Picture) and entry.topic in self._topics:
            self._newest[self._topics[entry.topic]] = sample
        elif entry.topic == PAIRS and isinstance(sample, dict):
            self.frames += 1
            pictures = [self._newest.get(side) for side in _SIDES]
            if any(one is None or one.number != sample["number"] for one in pictures):
                self.missing += 1
                return None
            left, right = (one.frame().image for one in pictures if one is not None)
            self._pairs.append((left, right, _rig(sample)))
            return f"pair {sample['number']}"
        return None

    def finish(self) -> dict[str, Any]:
        """The findings."""
        camera, chainage = self._head["camera"], self._head["chainage_m"]
        if not self._pairs:
            return {"state": "failed", "result": refused("pair_lost", camera, 0, chainage)}
        if moved([left for left, _, _ in self._pairs]):
            return {"state": "saved", "result": refused("pair_moved", camera, len(self._pairs), chainage)}
        results = []
        for pair in self._pairs:
            inspected = work(True, *pair)
            assert isinstance(inspected, Inspected)
            results.append(inspected.result)
        return {"state": "saved", "result": concluded(results, camera, chainage)[0]}

    def close(self) -> None:
        """Nothing is held."""


def _rig(told: dict[str, Any]) -> StereoRig:
    lens = told["intrinsics"]
    return StereoRig(
        Intrinsics(**{**lens, "coeffs": tuple(lens["coeffs"])}),
        told["baseline_m"],
        told["offset_px"],
        told["offset_std_px"],
        told["scale_std"],
        told["known_shift_px"],
    )
