"""The FCDD network at work: a picture to one anomaly map and one score per class (CCTV paper, eqs. 8 and 9).

The model is one ONNX file that says itself what it was trained for: its classes, its thresholds and the size of picture that
it wants are in its metadata. It is run by onnxruntime, which has wheels for a Raspberry Pi.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass

import cv2
import numpy as np
import onnxruntime
from numpy.typing import NDArray

from estimators.detections import Detection, from_heatmaps

Picture = NDArray[np.uint8]
Maps = NDArray[np.float32]

KIND = "borescout fcdd 1"
"""What the metadata of a model must say under "kind"."""
LEAST_SHARE = 0.0008
"""A component that covers less of the picture is a speck."""


class ModelBroken(ValueError):
    """A file that is no model of this kind, or not whole."""


@dataclass(frozen=True)
class ModelCard:
    """What a model says of itself. ``size`` is (width, height) of its input. ``thresholds`` are those of a picture's score
    (0..1) per class; ``map_thresholds`` those of its anomaly map (>= 0)."""

    classes: tuple[str, ...]
    size: tuple[int, int]
    thresholds: Mapping[str, float]
    map_thresholds: Mapping[str, float]
    about: Mapping[str, str]

    def metadata(self) -> dict[str, str]:
        """As it is kept in the file."""
        return {
            "kind": KIND,
            "classes": json.dumps(self.classes),
            "size": json.dumps(self.size),
            "thresholds": json.dumps(self.thresholds),
            "map_thresholds": json.dumps(self.map_thresholds),
            "about": json.dumps(self.about),
        }


@dataclass(frozen=True)
class Seen:
    """What the network makes of one picture. ``maps`` A_k (classes, h, w), eq. 8, say where; ``scores`` 0..1 per class whether
    it is in the picture at all."""

    card: ModelCard
    maps: Maps
    scores: Mapping[str, float]

    def heatmap(self, label: str) -> Maps:
        """The map (h, w) of one class."""
        return np.asarray(self.maps[self.card.classes.index(label)], dtype=np.float32)


class Fcdd:
    """A model, ready to run. ``threads`` 0 leaves their number to onnxruntime."""

    def __init__(self, model: bytes, threads: int = 1) -> None:
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = threads
        options.inter_op_num_threads = 1
        options.log_severity_level = 3
        # a thread that spins while it waits takes the core that the rest of the box needs
        options.add_session_config_entry("session.intra_op.allow_spinning", "0")
        try:
            self._session = onnxruntime.InferenceSession(model, options, providers=["CPUExecutionProvider"])
        except Exception as error:  # onnxruntime has no common base for what it raises on a damaged file
            raise ModelBroken("is not a whole ONNX model") from error
        self.sha256 = hashlib.sha256(model).hexdigest()
        """Of the model: what it says can be told again only by the very same one."""
        self.card = card_of(self._session.get_modelmeta().custom_metadata_map)
        self._input = self._session.get_inputs()[0].name

    def see(self, picture: Picture, mirrored: bool = False) -> Seen:
        """``picture`` (h, w, 3) uint8 BGR of any size. ``mirrored`` looks at its mirror image too and takes the mean, at twice
        the cost."""
        maps, scores = self.run(prepared(picture, self.card.size))
        if mirrored:
            other, others = self.run(prepared(np.ascontiguousarray(picture[:, ::-1]), self.card.size))
            maps, scores = _mean(maps, other[:, :, ::-1]), _mean(scores, others)
        return Seen(self.card, maps, {label: float(value) for label, value in zip(self.card.classes, scores, strict=True)})

    def detect(self, picture: Picture) -> list[Detection]:
        """What lies where in ``picture``: the components of the maps of those classes that the picture as a whole shows."""
        seen = self.see(picture)
        shown = {label: seen.heatmap(label) for label, value in seen.scores.items() if value >= self.card.thresholds[label]}
        height, width = picture.shape[:2]
        return from_heatmaps(shown, self.card.map_thresholds, (width, height), LEAST_SHARE * width * height)

    def run(self, x: Maps) -> tuple[Maps, Maps]:
        """Anomaly maps (classes, h, w) and scores (classes,) of a ``prepared`` picture. A model without scores of its own is
        told by eq. 9: 1 - exp(-z), z the mean of the map."""
        maps, *scores = (np.asarray(found[0], dtype=np.float32) for found in self._session.run(None, {self._input: x}))
        return maps, scores[0] if scores else np.asarray(-np.expm1(-maps.mean(axis=(1, 2))), np.float32)


def _mean(one: Maps, other: Maps) -> Maps:
    return np.asarray((one + other) / 2, dtype=np.float32)


def prepared(picture: Picture, size: tuple[int, int]) -> Maps:
    """(1, 3, h, w), RGB, as the trunk was taught: (x - 127) / 128."""
    if picture.ndim != 3 or picture.shape[2] != 3:
        raise ValueError(f"A picture has three colours, this array has the shape {picture.shape}.")
    shrinks = picture.shape[1] >= size[0] and picture.shape[0] >= size[1]
    small = cv2.resize(picture, size, interpolation=cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR)
    planes = (small[:, :, ::-1].astype(np.float32) - np.float32(127)) * np.float32(1 / 128)
    return np.ascontiguousarray(planes.transpose(2, 0, 1))[None]


def card_of(found: Mapping[str, str]) -> ModelCard:
    """What the metadata of a model say. Raises ModelBroken."""
    if found.get("kind") != KIND:
        raise ModelBroken(f"is an ONNX model, but none that says it is a {KIND}")
    try:
        classes = tuple(str(label) for label in json.loads(found["classes"]))
        width, height = (int(side) for side in json.loads(found["size"]))
        thresholds, map_thresholds = (
            {label: float(json.loads(found[name])[label]) for label in classes} for name in ("thresholds", "map_thresholds")
        )
        return ModelCard(classes, (width, height), thresholds, map_thresholds, json.loads(found["about"]))
    except (KeyError, ValueError, TypeError, AttributeError) as error:
        raise ModelBroken("has damaged metadata") from error
