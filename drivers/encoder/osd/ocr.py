"""rapidocr as it is used here: models from its own wheel, one thread, nothing fetched, nothing sent."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.base import SensorMissing
from drivers.library import library

Corners = tuple[int, int, int, int]
"""left, top, right, bottom in pixels."""

DETECTOR = "PP-OCRv6_det_small.onnx"
RECOGNISER = "PP-OCRv6_rec_small.onnx"

SEARCHED_PIXELS = 450_000
"""Size to which a picture is scaled before lines are looked for, within half and twice its own: the time goes with it."""


class Ocr:
    """The text of a picture, or of one strip of it. Raises SensorMissing where the extra ``osd`` is not installed."""

    def __init__(self) -> None:
        library("onnxruntime").disable_telemetry_events()
        rapidocr = library("rapidocr")
        models = Path(rapidocr.__file__).parent / "models"
        absent = [name for name in (DETECTOR, RECOGNISER) if not (models / name).is_file()]
        if absent:
            raise SensorMissing(
                f"The installed rapidocr has no model {' and '.join(absent)} in it: run pip install --upgrade 'borescout[osd]'."
            )
        # models by path: rapidocr then never asks the network for them. One thread: a pool would spin on the box's few cores.
        self._engine: Any = rapidocr.RapidOCR(
            params={
                "Global.log_level": "critical",
                "Global.use_cls": False,
                "Global.text_score": 0.3,
                "EngineConfig.onnxruntime.intra_op_num_threads": 1,
                "EngineConfig.onnxruntime.inter_op_num_threads": 1,
                "Det.limit_type": "max",
                "Det.limit_side_len": 4096,
                "Det.model_path": str(models / DETECTOR),
                "Rec.model_path": str(models / RECOGNISER),
            }
        )

    def lines(self, image: NDArray[np.uint8]) -> list[tuple[str, float, Corners]]:
        """All lines of text of ``image`` (H, W, 3) BGR: text, confidence 0 to 1, and where."""
        height, width = image.shape[:2]
        scale = min(2.0, max(0.5, math.sqrt(SEARCHED_PIXELS / (height * width))))
        scaled = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR)
        seen = self._engine(scaled, use_det=True, use_cls=False, use_rec=True)
        if getattr(seen, "boxes", None) is None or seen.txts is None:
            return []
        lines: list[tuple[str, float, Corners]] = []
        for text, score, corners in zip(seen.txts, seen.scores, seen.boxes, strict=True):
            low, high = np.floor(np.min(corners, axis=0) / scale), np.ceil(np.max(corners, axis=0) / scale)
            left, top = (int(max(0, value)) for value in low)
            right, bottom = int(min(width, high[0])), int(min(height, high[1]))
            lines.append((str(text), float(score), (left, top, right, bottom)))
        return lines

    def strip(self, image: NDArray[np.uint8]) -> tuple[str, float]:
        """The text of one line cut out (h, w, 3) BGR, and its confidence 0 to 1."""
        seen = self._engine(image, use_det=False, use_cls=False, use_rec=True)
        if getattr(seen, "txts", None) is None or not seen.txts:
            return "", 0.0
        return str(seen.txts[0]), float(seen.scores[0])
